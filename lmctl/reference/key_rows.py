"""The rows of all keys, as they ship: read from a file, so that help loads no models."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from lmctl.errors import UsageError
from lmctl.reference.key_row import FILE_KINDS, KeyRow

#: Made from the models by `python -m tests.house.reference`.
KEYS_FILE = Path(__file__).parent / "keys.json"


def load_key_rows(path: Path = KEYS_FILE) -> tuple[KeyRow, ...]:
    """Every row, in the order of the models."""
    return tuple(KeyRow(*row) for row in json.loads(path.read_text(encoding="utf-8")))


def rows_under(rows: Sequence[KeyRow], path: str) -> list[KeyRow]:
    """The row of a path, or the rows of the keys directly in it; the kinds of a table included.

    A path may leave out the kind of the file, and of a table that has kinds.
    Raises UsageError with a guess where there is no such key.
    """
    wanted = path.strip(".").split(".")
    exact = [row for row in rows if row.path.split(".") == wanted]
    if exact:
        inner = _within(rows, exact[0].path.split("."))
        return [*exact, *inner]
    if inner := _within(rows, wanted):
        return inner
    loose = [row for row in rows if _matches(row.path.split("."), wanted)]
    if loose:
        return loose
    raise _unknown(rows, path)


def _within(rows: Sequence[KeyRow], prefix: list[str]) -> list[KeyRow]:
    """Rows directly below a path."""
    n = len(prefix)
    return [row for row in rows
            if (steps := row.path.split("."))[:n] == prefix and len(steps) == n + 1]


def _matches(steps: list[str], wanted: list[str]) -> bool:
    """Whether the wanted steps are the path's, in order and to its end, others left out."""
    at = iter(steps)
    return steps[-1] == wanted[-1] and all(step in at for step in wanted)


def _unknown(rows: Sequence[KeyRow], path: str) -> UsageError:
    from difflib import get_close_matches  # needed for mistakes only

    known = {row.path for row in rows} | {row.path.partition(".")[2] for row in rows}
    near = get_close_matches(path, sorted(known), n=3)
    if not near:
        last = path.rpartition(".")[2]
        keys = get_close_matches(last, sorted({row.key for row in rows}), n=1)
        near = [row.path for row in rows if keys and row.key == keys[0]][:3]
    hint = f"did you mean {' or '.join(near)}?" if near else (
        f"`lmctl help` lists the files: {', '.join(FILE_KINDS)}")
    return UsageError(f"there is no key {path!r}", hint=hint)
