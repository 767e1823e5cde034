"""A journal that many commands add to over time, and that is never sealed.

The form is that of a run journal (`lmctl.run.journal.format`): JSON lines, each with the hash of
the one before. `t` counts from the first record by the wall clock.
"""

from __future__ import annotations

import fcntl
import os
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from lmctl.errors import JournalError
from lmctl.run.journal.format import (
    FIRST_PREVIOUS_HASH,
    FORMAT_NAME,
    encode_record,
    last_record,
    line_hash,
    read_records,
    verify_journal,
)


class SharedJournal:
    """One such file. header : fields of its first record, beside the format"""

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        self.path = path
        self._header = header

    def append(self, kind: str, **fields: Any) -> None:
        """Add a record, on the disk when this returns; the file is begun where it is missing.

        A half-written last line, left by a crash, is dropped. Raises JournalError where the file
        was altered or cannot be written.
        """
        wall = datetime.now(UTC)
        local = {"wall": wall.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
                 "uid": os.getuid(), "pid": os.getpid()}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            fd = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
            try:
                fcntl.flock(fd, fcntl.LOCK_EX)
                prev, seq = self._end(fd)
                if seq == 0:
                    line = encode_record(prev, 0, 0.0, "header",
                                         {"format": FORMAT_NAME, **self._header, "local": local})
                    _write(fd, line + b"\n")
                    prev, seq = line_hash(line), 1
                t_s = max(0.0, (wall - self._began()).total_seconds())
                line = encode_record(prev, seq, t_s, kind, {**fields, "local": local})
                _write(fd, line + b"\n")
                os.fdatasync(fd)
            finally:
                os.close(fd)
        except OSError as error:
            raise JournalError(f"cannot write {self.path}", where=str(error.strerror),
                               hint="nothing was done: acts are written down first") from None

    def last_record(self) -> dict[str, Any] | None:
        """The last record, or None where there is none. Raises JournalError."""
        return last_record(self.path) if self.path.exists() else None

    def _end(self, fd: int) -> tuple[str, int]:
        """Hash of the last line and number of lines, a torn last one cut off."""
        found = verify_journal(self.path)
        if not found.intact:
            raise JournalError(
                f"{self.path} was damaged or altered",
                where=f"line {found.broken_line}: {found.reason}",
                hint="keep it under another name; a new one is begun where it is missing",
            )
        if found.dropped_bytes:
            os.ftruncate(fd, os.fstat(fd).st_size - found.dropped_bytes)
        if not found.records:
            return FIRST_PREVIOUS_HASH, 0
        with self.path.open("rb") as file:
            last = file.read().rstrip(b"\n").rpartition(b"\n")[2]
        return line_hash(last), found.records

    def _began(self) -> datetime:
        wall = str(next(read_records(self.path))["local"]["wall"])
        return datetime.fromisoformat(wall)


def _write(fd: int, data: bytes) -> None:
    """Write all of it: a nearly full disk takes a part first, and fails only at the next write."""
    while data:
        data = data[os.write(fd, data):]

