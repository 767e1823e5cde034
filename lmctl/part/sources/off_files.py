"""OFF files: a count of corners and polygons, and these, as text."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.polygons import triangulate_polygons
from lmctl.part.sources.recognition import unreadable_file

#: What may come before the counts. What `C`, `N` and `ST` add to a corner follows x, y, z.
_KEYWORDS = ("OFF", "COFF", "NOFF", "STOFF", "CNOFF", "NCOFF", "STCOFF", "STNOFF", "STCNOFF")


def read_off(file: DataFile) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3) float64 and triangles (m, 3) int64. Raises InputError."""
    if b"\0" in file.data:
        raise unreadable_file(file, "it is not text")
    text = file.data.decode("utf-8", "replace")
    rows = [words for line in text.splitlines() if (words := line.partition("#")[0].split())]
    if rows and rows[0][0].upper() in _KEYWORDS:
        rows = [rows[0][1:], *rows[1:]] if len(rows[0]) > 1 else rows[1:]
    if not rows or len(rows[0]) < 2 or not all(w.isdigit() and len(w) < 18 for w in rows[0][:2]):
        raise unreadable_file(file,
                              "it does not begin with `OFF` and the numbers of corners and faces")
    corners, faces = int(rows[0][0]), int(rows[0][1])
    if len(rows) - 1 < corners + faces:
        raise unreadable_file(
            file, f"its head promises {corners:,} corners and {faces:,} faces, {len(rows) - 1:,} "
            "lines follow", "it is truncated; export or copy it again")
    try:
        vertices = np.array(
            [row[:3] for row in rows[1 : 1 + corners]], dtype=np.float64).reshape(-1, 3)
    except ValueError:
        raise unreadable_file(file, "a corner is not three numbers") from None
    sizes, named = [], []
    for row in rows[1 + corners : 1 + corners + faces]:
        try:
            size = int(row[0])
            polygon = [int(word) for word in row[1 : 1 + size]]
        except ValueError:
            polygon, size = [], -1
        if size < 0 or len(polygon) != size or any(not 0 <= c < corners for c in polygon):
            raise unreadable_file(file,
                                  f"a face is not a list of its corners: {' '.join(row)[:60]!r}")
        sizes.append(size)
        named += polygon
    triangles, _ = triangulate_polygons(
        file, vertices, np.array(named, dtype=np.int64), np.array(sizes, dtype=np.int64))
    return vertices, triangles
