"""Data files of a part: where they may lie, how large they may be, and their bytes and digest.

A part file may come from another user. It may name files below its own folder, or give an absolute
path, which is visible to its reader; it may not leave its folder with `..` or a link.
"""

from __future__ import annotations

import codecs
import hashlib
import stat
from dataclasses import dataclass
from pathlib import Path

from lmctl.errors import InputError, MissingFileError

#: More than this is not read into memory: about eight million triangles of binary STL.
MAX_DATA_BYTES = 400_000_000

#: Endings of files that hold triangles, and points. A PLY may hold either.
MESH_SUFFIXES = ("stl", "ply", "obj", "off", "3mf")
CLOUD_SUFFIXES = ("xyz", "csv", "txt", "asc", "pts", "ply")


@dataclass(frozen=True)
class DataFile:
    """A data file, read once: what is parsed is what was hashed.

    data : its bytes, without the byte-order mark that Windows editors put before text
    sha256 : of the file as it is
    """

    path: Path
    data: bytes
    sha256: str

    @property
    def suffix(self) -> str:
        """Its type as its name states it: lower case, without the dot."""
        return self.path.suffix.lower().removeprefix(".")


def read_data_file(name: str, folder: Path) -> DataFile:
    """The bytes of a data file named in a part file that lies in `folder`.

    Raises InputError where it is missing, empty, huge, not a plain file, or outside the folder.
    """
    path = _resolve(name, folder)
    try:
        found = path.stat()
        if stat.S_ISDIR(found.st_mode):
            raise InputError(f"{path} is a folder, not a file", hint="name the file in it")
        if not stat.S_ISREG(found.st_mode):
            raise InputError(f"{path} is not a plain file", hint="copy the data into a file")
        if found.st_size == 0:
            raise InputError(f"{path} is empty", hint="export it again")
        if found.st_size > MAX_DATA_BYTES:
            raise InputError(
                f"{path} is too large",
                where=f"{found.st_size:,} bytes; at most {MAX_DATA_BYTES:,}",
                hint="thin out the mesh or cloud: detail far below the bead width is lost anyway",
            )
        data = path.read_bytes()
    except FileNotFoundError:
        raise MissingFileError.for_path(
            path, "names in a part file are relative to its folder"
        ) from None
    except OSError as error:
        raise InputError.cannot_read(path, error) from None
    return DataFile(path, _unmarked(data), hashlib.sha256(data).hexdigest())


def _unmarked(data: bytes) -> bytes:
    """Text without its byte-order mark; a binary STL may begin with any bytes, and keeps them."""
    text = data.removeprefix(codecs.BOM_UTF8)
    return data if b"\0" in text[:84] else text


def _resolve(name: str, folder: Path) -> Path:
    if "\0" in name:
        raise InputError(f"{name!r} is not a file name", hint="name a file beside the part file")
    asked = Path(name)
    if asked.is_absolute():
        return asked
    try:
        home = folder.resolve()
        resolved = (home / asked).resolve()
    except (OSError, RuntimeError):  # RuntimeError: links that run in a circle
        raise InputError(f"cannot follow the path {name}",
                         hint="its links run in a circle: name the file itself") from None
    if not resolved.is_relative_to(home):
        raise InputError(
            f"{name} leads out of the part file's folder",
            where=f"to {resolved}",
            hint="put the file beside the part file, or give its absolute path",
        )
    return folder / asked
