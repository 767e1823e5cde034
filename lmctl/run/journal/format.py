"""The form of a run journal on disk, and reading it: JSON lines, chained by their hashes.

    {"prev": <SHA-256 of the line before>, "seq": 7, "t": 12.5, "kind": "path", ...}

`prev` of the first line is 64 zeros. A sealed journal ends with a record of kind "seal" whose
last field, `sha256`, is the hash of its own text before that field, so that it is covered too.
What may differ between two equal runs (wall clock, run id, process id, port names) is under
the key `local` of a record and nowhere else: a fingerprint leaves it out.

The chain finds damage and careless editing. It carries no secret: anyone who rewrites the whole
file can also compute new hashes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from lmctl.errors import JournalError, MissingFileError

#: What a journal calls itself, in its first record; a reader refuses any other version.
FORMAT_VERSION = 3
FORMAT_NAME = f"lmctl-journal-{FORMAT_VERSION}"

#: Fields renamed since a format: what a tool made for it has to be changed to.
_RENAMED_SINCE = {2: {"lit_line": "beam_on_line", "stands_mm": "standstill_mm",
                      "stands": "active"}}

FIRST_PREVIOUS_HASH = "0" * 64

#: A longer line is none of ours: reading it would only take memory.
MAX_LINE_BYTES = 1_000_000

_ENCODE = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_LISTS = "`lmctl jobs` lists runs"
_SEAL_MARK = b',"sha256":"'
_ANY_FORMAT = re.compile(r"lmctl-journal-([0-9]{1,9})")


class UnsupportedFormatError(JournalError):
    """A journal of another version than this software reads, whose rules it does not know."""

    def __init__(self, path: Path, version: int, software: object) -> None:
        stated = isinstance(software, str) and software.isprintable()
        by = f"{str(software)[:60]} wrote it; " if stated else ""
        renamed = "".join(f"; {old} is now {new}"
                          for old, new in _RENAMED_SINCE.get(version, {}).items())
        super().__init__(
            f"{path} is a journal of format {version}",
            where=f"{by}this lmctl reads format {FORMAT_VERSION}{renamed}",
            hint="read it with the lmctl that wrote it, or a later one that still reads it",
        )
        self.version = version


def line_hash(line: bytes) -> str:
    """Hash of a line as the next record's `prev` carries it. line : without its newline."""
    return hashlib.sha256(line).hexdigest()


def encode_record(prev: str, seq: int, t_s: float, kind: str, fields: dict[str, Any]) -> bytes:
    """One line of a journal, without its newline. Raises ValueError for NaN or infinity."""
    body = _ENCODE({"seq": seq, "t": round(t_s, 6), "kind": kind, **fields})
    return f'{{"prev":"{prev}",{body[1:]}'.encode("ascii")


def encode_seal(prev: str, seq: int, t_s: float, fields: dict[str, Any]) -> bytes:
    """The last line of a journal, without its newline."""
    line = encode_record(prev, seq, t_s, "seal", fields)[:-1]
    return line + _SEAL_MARK + line_hash(line).encode("ascii") + b'"}'


@dataclass(frozen=True)
class JournalVerification:
    """What a journal's own hashes prove about it.

    sealed : it ends with its seal, so nothing can be missing
    broken_line : number (from 1) of the first line that cannot be what was written, or None
    reason : in words, why that line is broken, or why the journal is not sealed; "" if it is
    records : sound records before that line
    dropped_bytes : length of a half-written last line, which is not counted as broken
    """

    sealed: bool
    broken_line: int | None
    reason: str
    records: int
    dropped_bytes: int

    @property
    def intact(self) -> bool:
        """Every line that was finished is as it was written."""
        return self.broken_line is None


def verify_journal(path: Path) -> JournalVerification:
    """Check the chain and the seal of a journal, in constant memory.

    Any byte changed, added or removed in a sealed journal makes it broken or unsealed.
    A line that was altered shows in the line after it, which is the one reported. Raises
    JournalError where the file is missing, cannot be read, or is of another version.
    """
    prev, seq, sealed, dropped = FIRST_PREVIOUS_HASH, 0, False, 0
    for line, finished in _lines(path):
        if not finished:
            dropped = len(line)
            break
        if seq == 0:
            _check_version(path, _parse(line))
        reason, sealed = _check_line(line, _parse(line), prev, seq, sealed=sealed)
        if reason:
            return JournalVerification(False, seq + 1, reason, seq, 0)
        prev, seq = line_hash(line), seq + 1
    return _unbroken(sealed, seq, dropped)


def read_and_verify(path: Path, take: Callable[[dict[str, Any]], None]) -> JournalVerification:
    """Hand every record of a journal to `take`, in order, and check chain and seal on the way.

    What `read_records` and `verify_journal` do, in one pass: large journals are read once. Records
    behind a broken line are handed over too. Raises what both of them raise.
    """
    prev, seq, sealed, dropped = FIRST_PREVIOUS_HASH, 0, False, 0
    broken: JournalVerification | None = None
    for number, (line, finished) in enumerate(_lines(path), start=1):
        if not finished:
            dropped = len(line)
            break
        record = _record(path, number, line)
        if broken is None:
            reason, sealed = _check_line(line, record, prev, seq, sealed=sealed)
            if reason:
                broken = JournalVerification(False, number, reason, seq, 0)
            prev, seq = line_hash(line), seq + 1
        take(record)
    return broken or _unbroken(sealed, seq, dropped)


def read_records(path: Path) -> Iterator[dict[str, Any]]:
    """Every record of a journal in order, one in memory at a time.

    A half-written last line is left out; `verify` reports it, and broken hashes, which
    reading does not check. Raises JournalError where the file is missing, no journal, or one of
    another version.
    """
    for number, (line, finished) in enumerate(_lines(path), start=1):
        if not finished:
            return
        yield _record(path, number, line)


def line_hashes(path: Path) -> Iterator[tuple[int, str]]:
    """For every finished line of a journal, how many lines there are up to it, and its hash.

    Raises JournalError where the file is missing, empty or altered, and cannot be read.
    """
    found = verify_journal(path)
    if not found.intact or not found.records:
        raise JournalError(f"{path} is not what was written",
                           where="it holds no record" if found.intact else found.reason,
                           hint="restore it from a copy; `lmctl log --verify` shows how much is "
                                "whole")
    for number, (line, finished) in enumerate(_lines(path), start=1):
        if finished:
            yield number, line_hash(line)


def last_record(path: Path) -> dict[str, Any] | None:
    """The last whole record of a journal, or None; reads only the end of the file.

    Raises JournalError where the file is missing or cannot be read.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - MAX_LINE_BYTES))
            tail = file.read()
    except FileNotFoundError:
        raise MissingFileError.for_path(path, _LISTS) from None
    except OSError as error:
        raise JournalError.cannot_read(path, error) from None
    end = tail.rfind(b"\n")
    return _parse(tail[tail.rfind(b"\n", 0, end) + 1 : end]) if end >= 0 else None


def run_fingerprint(path: Path) -> str:
    """SHA-256 of what the run did: equal for two runs that did the same at the same times.

    Leaves out the chain and every record's `local` part (wall clock, run id, process id, ports).
    """
    digest = hashlib.sha256()
    for record in read_records(path):
        record.pop("prev", None)
        record.pop("local", None)
        record.pop("sha256", None)
        digest.update(_ENCODE(record).encode("ascii") + b"\n")
    return digest.hexdigest()


def _check_version(path: Path, header: dict[str, Any] | None) -> None:
    """Raises OtherFormat where a first record is the header of another version's journal."""
    stated = _ANY_FORMAT.fullmatch(str((header or {}).get("format")))
    if stated and int(stated[1]) != FORMAT_VERSION:
        raise UnsupportedFormatError(path, int(stated[1]), (header or {}).get("software"))


def _record(path: Path, number: int, line: bytes) -> dict[str, Any]:
    """The record in a line. Raises JournalError where it holds none, or is no journal's first."""
    record = _parse(line)
    if number == 1:
        _check_version(path, record)
    if record is None or (number == 1 and record.get("format") != FORMAT_NAME):
        raise JournalError(f"{path} is not a run journal", where=f"line {number}",
                           hint="name the folder of a run, or its journal.jsonl")
    return record


def _unbroken(sealed: bool, records: int, dropped: int) -> JournalVerification:
    if dropped:
        return JournalVerification(False, None, "its last line was half written", records, dropped)
    return JournalVerification(sealed, None, "" if sealed else "it has no seal", records, 0)


def _check_line(
    line: bytes, record: dict[str, Any] | None, prev: str, seq: int, *, sealed: bool
) -> tuple[str, bool]:
    """Why this line cannot be the one after `prev` ("" if it can), and whether it is a seal.

    record : what the line holds; sealed : the line before it is a seal
    """
    if sealed:
        return ("there is a line after the seal", True)
    if not line.startswith(b'{"prev":"' + prev.encode("ascii") + b'",'):
        return ("it does not carry the hash of the line before it", False)
    if record is None:
        return ("it is not a record", False)
    if record.get("seq") != seq:
        return (f"it is record {record.get('seq')} where {seq} is due", False)
    if seq == 0 and record.get("format") != FORMAT_NAME:
        return ("it is not the header of a run journal", False)
    if record.get("kind") != "seal":
        return ("", False)
    text, mark, seal = line.rpartition(_SEAL_MARK)
    if not mark or seal != line_hash(text).encode("ascii") + b'"}':
        return ("the seal does not match", False)
    return ("", True)


def _parse(line: bytes) -> dict[str, Any] | None:
    try:
        record = json.loads(line.decode("ascii"), parse_constant=_refuse)
    except (ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) else None


def _refuse(constant: str) -> None:
    raise ValueError(constant)


def _lines(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Each line without its newline, and whether it had one."""
    try:
        with path.open("rb") as file:
            yield from _lines_of(file, path)
    except FileNotFoundError:
        raise MissingFileError.for_path(path, _LISTS) from None
    except OSError as error:
        raise JournalError.cannot_read(path, error) from None


def _lines_of(file: BinaryIO, path: Path) -> Iterator[tuple[bytes, bool]]:
    while line := file.readline(MAX_LINE_BYTES):
        if line.endswith(b"\n"):
            yield line[:-1], True
        elif len(line) == MAX_LINE_BYTES:
            raise JournalError(f"{path} is not a run journal",
                               where=f"a line is longer than {MAX_LINE_BYTES:,} bytes",
                               hint="name the folder of a run, or its journal.jsonl")
        else:
            yield line, False
