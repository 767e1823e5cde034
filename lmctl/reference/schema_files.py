"""JSON schemas as they ship, and how a file names its own."""

from __future__ import annotations

from pathlib import Path

#: The schemas, made from the models by `python -m tests.house.reference`.
SCHEMA_FOLDER = Path(__file__).parent / "schemas"


def schema_file(kind: str) -> Path:
    """Where the schema of a kind of file ships; kinds are those of `FILE_KINDS`."""
    return SCHEMA_FOLDER / f"{kind}.json"
