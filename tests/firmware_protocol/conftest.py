"""What the real firmwares said, for every codec test."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

import pytest

TRANSCRIPTS = {
    "grbl": Path(__file__).parent / "transcripts" / "grbl-1.1h.jsonl",
    "grblhal": Path(__file__).parent / "transcripts" / "grblhal.jsonl",
}


class Scenario(NamedTuple):
    """One exchange: `sent` writes and `received` lines, each in order, without timing."""

    dialect: str
    name: str
    sent: list[bytes]
    received: list[str]


@pytest.fixture(scope="session")
def scenarios() -> list[Scenario]:
    """Every scenario of both transcripts."""
    found = []
    for dialect, path in TRANSCRIPTS.items():
        for text in path.read_text().splitlines():
            row = json.loads(text)
            sent = [write.encode("latin-1") for write in row["sent"]]
            found.append(Scenario(dialect, row["scenario"], sent, row["received"]))
    return found
