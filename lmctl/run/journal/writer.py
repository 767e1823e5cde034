"""Writing a run journal: append-only, chained, one owner, durable when it must be."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lmctl.errors import JournalError
from lmctl.run.journal.format import (
    FIRST_PREVIOUS_HASH,
    FORMAT_NAME,
    encode_record,
    encode_seal,
    line_hash,
)


class JournalWriter:
    """The one writer of a run's journal. Use as a context manager.

    Records wait in memory until `flush` gives them to the operating system (they then outlive
    this process) or `sync` puts them on the disk (they then outlive the power). Closing
    flushes, but only `seal` seals: a journal without a seal is one whose run ended badly.
    """

    def __init__(self, path: Path, header: dict[str, Any], *, local: dict[str, Any]) -> None:
        """Create the journal and write its header durably.

        header, local : fields of the first record; `local` holds what differs between equal
            runs. Raises JournalError where the file exists, or cannot be created.
        """
        self.path = path
        self.sealed = False
        self._prev = FIRST_PREVIOUS_HASH
        self._seq = 0
        self._waiting: list[bytes] = []
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except FileExistsError:
            raise JournalError(f"there already is a journal {path}", where=_owner(path),
                               hint="choose another folder of runs with --runs") from None
        except OSError as error:
            raise JournalError.cannot_write(path, error) from None
        # Others may read a journal while it grows; who would write it must hold this lock. Only
        # `is_owned` elsewhere can hold it now, for an instant, so waiting is right.
        fcntl.flock(self._fd, fcntl.LOCK_EX)
        self.append(0.0, "header", format=FORMAT_NAME, **header, local=local)
        self.sync()
        _sync_folder(path.parent)

    def append(self, t_s: float, kind: str, **fields: Any) -> None:
        """Add a record. t_s : machine time since the run began [s].

        Raises ValueError for a value JSON cannot hold (NaN), and for a sealed journal.
        """
        if self.sealed:
            raise ValueError("the journal is sealed")
        self._take(encode_record(self._prev, self._seq, t_s, kind, fields))

    def flush(self) -> None:
        """Hand the waiting records to the operating system."""
        if self._waiting:
            data = b"".join(self._waiting)
            self._waiting.clear()
            try:
                while data:
                    data = data[os.write(self._fd, data):]
            except OSError as error:
                raise JournalError.cannot_write(self.path, error) from None

    def sync(self) -> None:
        """Return when every record so far is on the disk."""
        self.flush()
        try:
            os.fdatasync(self._fd)
        except OSError as error:
            raise JournalError.cannot_write(self.path, error) from None

    def seal(self, t_s: float, **fields: Any) -> None:
        """Add the last record and make the whole journal durable."""
        self._take(encode_seal(self._prev, self._seq, t_s, fields))
        self.sealed = True
        self.sync()

    def _take(self, line: bytes) -> None:
        self._waiting.append(line + b"\n")
        self._prev = line_hash(line)
        self._seq += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.flush()
        finally:
            os.close(self._fd)


def is_owned(path: Path) -> bool:
    """Whether a living process is writing this journal."""
    fd = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


def _owner(path: Path) -> str:
    return "a process that is still running writes it" if is_owned(path) else "of an earlier run"


def _sync_folder(folder: Path) -> None:
    """Make the new file's name durable, not only its content."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
