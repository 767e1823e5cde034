"""Follows a run journal from near its end, however long it is, while another process writes it.

Nothing is verified here: a live page shows what a run writes, and `lmctl log` proves it. Damaged or
overlong lines are left out and counted.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

from lmctl.run.journal.format import MAX_LINE_BYTES

#: A follower begins so far before the end [bytes]: some minutes of an ordinary run.
BACKLOG_BYTES = 2_000_000

#: More than this is not read in one step; of more than the second, all but the end is passed over.
_STEP_BYTES, _MOST_BEHIND_BYTES = 1_000_000, 8_000_000


class TailBatch(NamedTuple):
    """What has come since the last look.

    records : whole records, in order
    skipped : earlier ones were passed over, so that what follows from them is not known
    more : the file holds more than one step reads
    """

    records: list[dict[str, Any]]
    skipped: bool
    more: bool


class JournalTail:
    """One journal, followed. The file may not exist yet.

    unreadable : lines so far that were no record
    """

    def __init__(self, path: Path, backlog_bytes: int = BACKLOG_BYTES) -> None:
        self._path = path
        self._backlog_bytes = backlog_bytes
        self._position: int | None = None
        self._rest = b""
        self._in_overlong_line = False
        self.unreadable = 0

    def has_grown(self) -> bool:
        """Whether the file has another size than what was read; cheap."""
        try:
            return os.stat(self._path).st_size != (self._position or 0)
        except OSError:
            return False

    def read_new(self) -> TailBatch:
        """The records since the last call, at most a megabyte of them. Never raises OSError."""
        try:
            with self._path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                skipped = self._place(size)
                assert self._position is not None
                file.seek(self._position)
                data = file.read(_STEP_BYTES)
        except OSError:
            return TailBatch([], False, False)
        self._position += len(data)
        return TailBatch(self._records(data), skipped, self._position < size)

    def _place(self, size: int) -> bool:
        """Choose where to read on; whether lines were passed over."""
        if self._position is None:
            self._position = max(0, size - self._backlog_bytes)
        elif self._position > size:  # another file, or one cut short
            self._position, self._rest = 0, b""
            return True
        elif size - self._position > _MOST_BEHIND_BYTES:
            self._position = size - self._backlog_bytes
        else:
            return False
        self._rest, self._in_overlong_line = b"", self._position > 0
        return self._position > 0

    def _records(self, data: bytes) -> list[dict[str, Any]]:
        *lines, rest = (self._rest + data).split(b"\n")
        if self._in_overlong_line and lines:
            lines, self._in_overlong_line = lines[1:], False
        if len(rest) > MAX_LINE_BYTES or self._in_overlong_line:
            rest, self._in_overlong_line = b"", True
        self._rest = rest
        return [record for line in lines if (record := self._parsed(line)) is not None]

    def _parsed(self, line: bytes) -> dict[str, Any] | None:
        try:
            record = json.loads(line, parse_constant=_refuse)
            if isinstance(record, dict) and "kind" in record and "t" in record:
                return record
        except (ValueError, RecursionError):
            pass
        self.unreadable += 1
        return None


def first_record(path: Path) -> dict[str, Any]:
    """The header of a journal, empty where there is none; reads one line, of bounded length."""
    try:
        with path.open("rb") as file:
            record = json.loads(file.readline(MAX_LINE_BYTES), parse_constant=_refuse)
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _refuse(constant: str) -> None:
    raise ValueError(constant)
