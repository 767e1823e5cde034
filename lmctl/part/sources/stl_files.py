"""STL files of both forms. Their length distinguishes them; how they begin does not.

A binary STL has 84 bytes plus 50 per triangle, whatever its head holds, even the word `solid`. No
text file has just the length that its bytes would declare as a count: it would be gigabytes.
"""

from __future__ import annotations

import re
import struct

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.recognition import unreadable_file
from lmctl.part.sources.table_style import is_number

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD_BYTES = 84

#: Text is read in pieces of about so many bytes, each cut after a facet.
_PIECE_BYTES = 8_000_000


def read_stl(file: DataFile) -> FloatArray:
    """Corners (3m, 3) float64 of m triangles, three in a row each. Raises InputError."""
    data = file.data
    long_enough = len(data) >= _HEAD_BYTES
    promised = struct.unpack_from("<I", data, 80)[0] if long_enough else 0
    if long_enough and len(data) == _HEAD_BYTES + _FACET.itemsize * promised:
        facets = np.frombuffer(data, dtype=_FACET, offset=_HEAD_BYTES)
        with np.errstate(invalid="ignore"):  # what is no number is refused by all readers alike
            return facets["corners"].astype(np.float64).reshape(-1, 3)
    if b"\0" not in data:
        return _from_text(file)
    if not long_enough:
        raise unreadable_file(file, f"{len(data)} bytes; the shortest has {_HEAD_BYTES}")
    held = (len(data) - _HEAD_BYTES) / _FACET.itemsize
    raise unreadable_file(
        file, f"its head promises {promised:,} triangles, its {len(data):,} bytes hold "
        f"{held:,.8g}", "it is not whole, or of another kind; export or copy it again",
    )


def _from_text(file: DataFile) -> FloatArray:
    text = file.data.lower()
    if not text.lstrip().startswith(b"solid") or b"facet" not in text:
        raise unreadable_file(file, "it is text that does not begin with `solid` and facets")
    if not re.search(rb"endsolid[^\n]*\s*$", text[-2000:]):
        raise InputError(
            f"{file.path} is truncated", where="a text STL ends with `endsolid`, this one does not",
            hint="export or copy it again",
        )
    names = re.compile(rb"^[ \t]*(end)?solid\b[^\r\n]*", re.MULTILINE)
    corners, start = [], 0
    while start < len(text):
        end = text.find(b"endfacet", start + _PIECE_BYTES)
        end = len(text) if end < 0 else end + len(b"endfacet")
        corners.append(_facets(file, names.sub(b"", text[start:end])))
        start = end
    return np.concatenate(corners)


def _facets(file: DataFile, text: bytes) -> FloatArray:
    """The corners of the facets of a piece of text without `solid` lines."""
    words = np.array(text.split())
    if len(words) == 0:
        return np.empty((0, 3))
    at = np.flatnonzero(words == b"vertex")
    ends = int(np.count_nonzero(words == b"endfacet"))
    begins = int(np.count_nonzero(words == b"facet"))
    if begins != ends or len(at) != 3 * ends or (len(at) and at[-1] + 3 >= len(words)):
        raise unreadable_file(file,
                              f"{begins:,} facets begin, {ends:,} end, with {len(at):,} corners")
    try:
        corners: FloatArray = words[at[:, None] + np.arange(1, 4)].astype(np.float64)
        return corners
    except ValueError:
        raise unreadable_file(file, _wrong_corner(words, at)) from None


def _wrong_corner(words: NDArray[np.bytes_], at: NDArray[np.int64]) -> str:
    corners = [b" ".join(words[place + 1 : place + 4].tolist()).decode("ascii", "replace")
               for place in at.tolist()]
    bad = next((corner for corner in corners if not all(map(is_number, corner.split()))),
               corners[0])
    return f"a corner is not three numbers: {bad[:60]!r}"
