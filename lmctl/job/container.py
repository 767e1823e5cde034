"""The container of a job file: a zip archive whose last bytes are the digest of all before them.

It is a zip, so that common tools can open it. Members are *stored*, never compressed, so that
stated sizes are real, and equal jobs are equal bytes with any version of zlib. The archive
comment is the trailer::

    lmctl-job 1 sha256 <64 hexadecimal digits>

and the digest covers every byte of the file before those digits, zip structures included, so
a change anywhere shows. (It guards against damage, not against forgery: what is read is still
checked as untrusted input.)
"""

from __future__ import annotations

import hashlib
import re
import struct
import zipfile
from typing import BinaryIO

from lmctl.errors import JobError
from lmctl.job.schema import FORMAT_VERSION

MANIFEST_MEMBER = "manifest.json"
PART_MEMBER = "part.toml"

#: What a layer consists of, in the order in which it is hashed.
LAYER_MEMBERS = ("program.txt", "lines.npy", "flow_s.npy", "flow_g_s.npy")

#: A zip without the 64-bit count holds 65,534 members.
MAX_LAYERS = 16_000
MAX_MEMBER_BYTES = 256 * 2**20
MAX_TEXT_BYTES = 32 * 2**20
MAX_DIRECTORY_BYTES = 16 * 2**20

_DIGEST_LENGTH = 64
_TRAILER_LENGTH = len(f"lmctl-job {FORMAT_VERSION} sha256 ") + _DIGEST_LENGTH
_TRAILER = re.compile(rb"lmctl-job (\d) sha256 ([0-9a-f]{64})")
_END_RECORD = struct.Struct("<4s4H2LH")  # APPNOTE 4.3.16
_END_RECORD_64 = struct.Struct("<4sQ2H2L4Q")  # APPNOTE 4.3.14
_LOCATOR_64_LENGTH = 20
_CHUNK = 2**20

REPLAN_HINT = "plan the part again"


def layer_member_names(index: int) -> tuple[str, ...]:
    """The names of a layer's members, in the order of `LAYER_MEMBERS`."""
    return tuple(f"layer-{index:05d}/{member}" for member in LAYER_MEMBERS)


def new_member(name: str) -> zipfile.ZipInfo:
    """A stored member without anything that depends on when or where it is written."""
    info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
    info.create_system = 3
    info.external_attr = 0o644 << 16
    return info


def unsigned_trailer() -> bytes:
    """The archive comment as first written; `sign` replaces the zeros."""
    return f"lmctl-job {FORMAT_VERSION} sha256 {'0' * _DIGEST_LENGTH}".encode()


def write_digest(file: BinaryIO) -> str:
    """Write the digest of all bytes before it at the end of an open, complete archive."""
    size = file.seek(0, 2)
    digest = _digest(file, size - _DIGEST_LENGTH)
    file.seek(size - _DIGEST_LENGTH)
    file.write(digest.encode())
    return digest


def verify_digest(file: BinaryIO, name: str) -> str:
    """The digest of a job file, found true.

    Raises JobError: not a job file, of another version, truncated, or altered.
    """
    size = file.seek(0, 2)
    if size == 0:
        raise JobError(f"{name} is empty", hint=REPLAN_HINT)
    file.seek(max(0, size - _TRAILER_LENGTH))
    trailer = _TRAILER.fullmatch(file.read(_TRAILER_LENGTH))
    if trailer is None:
        file.seek(0)
        if file.read(4) == b"PK\x03\x04":
            raise JobError(f"{name} is truncated, or is no job file",
                           where="it does not end as a job file does", hint=REPLAN_HINT)
        raise JobError(f"{name} is not a job file", hint="`lmctl plan` makes job files")
    version, wanted = int(trailer[1]), trailer[2].decode()
    if version != FORMAT_VERSION:
        raise JobError(f"{name} is a job of format {version}",
                       where=f"this lmctl reads format {FORMAT_VERSION}", hint=REPLAN_HINT)
    if _digest(file, size - _DIGEST_LENGTH) != wanted:
        raise JobError(f"{name} was damaged or altered after it was planned",
                       where="its bytes do not match its digest", hint=REPLAN_HINT)
    _check_directory(file, size, name)
    return wanted


def layer_digest(members: tuple[bytes, ...]) -> str:
    """SHA-256 over a layer's members, each preceded by its length."""
    digest = hashlib.sha256()
    for data in members:
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def _digest(file: BinaryIO, length: int) -> str:
    digest = hashlib.sha256()
    file.seek(0)
    while length > 0:
        chunk = file.read(min(_CHUNK, length))
        if not chunk:
            break
        digest.update(chunk)
        length -= len(chunk)
    return digest.hexdigest()


def _check_directory(file: BinaryIO, size: int, name: str) -> None:
    """Refuse a directory too large to be a job's before `zipfile` reads it into memory."""
    end = size - _TRAILER_LENGTH - _END_RECORD.size
    before = _LOCATOR_64_LENGTH + _END_RECORD_64.size
    if end < 0:
        raise JobError(f"{name} is not a job file", hint=REPLAN_HINT)
    file.seek(end)
    signature, _, _, _, count, length, _, comment = _END_RECORD.unpack(
        file.read(_END_RECORD.size))
    if end >= before:
        file.seek(end - before)
        record = _END_RECORD_64.unpack(file.read(_END_RECORD_64.size))
        if record[0] == b"PK\x06\x06":
            count, length = record[7], record[8]
    if (
        signature != b"PK\x05\x06" or comment != _TRAILER_LENGTH
        or count > MAX_LAYERS * len(LAYER_MEMBERS) + 2 or length > MAX_DIRECTORY_BYTES
    ):
        raise JobError(f"{name} is not a job file lmctl made",
                       where="its archive directory is not a job's", hint=REPLAN_HINT)
