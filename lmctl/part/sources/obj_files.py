"""OBJ files: corners, polygons and the groups that polygons belong to.

Corners are counted through the whole file, from its start (1 is the first) or back from the line
at hand (−1 is the latest), however many objects there are. Only what makes a solid is read: curves,
texture places, normals and materials are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.config.materials import suggest_name
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.polygons import triangulate_polygons
from lmctl.part.sources.recognition import unreadable_file
from lmctl.part.sources.table_style import is_number

Names = frozenset[str]


@dataclass(frozen=True)
class ObjModel:
    """vertices : (n, 3) float64; triangles : (m, 3) int64; group : (m,) row of `groups` of each.

    groups : of each `g` or `o` line the names it gives, with those of the object it belongs to
    """

    vertices: FloatArray
    triangles: IntArray
    group: IntArray
    groups: tuple[Names, ...]


def read_obj(file: DataFile) -> ObjModel:
    """The polygons of an OBJ file as triangles. Raises InputError with the line that is wrong."""
    if b"\0" in file.data:
        raise unreadable_file(file, "it is not text")
    coordinates: list[list[str]] = []
    corner_lines: list[int] = []
    corners: list[int] = []
    sizes: list[int] = []
    face_lines: list[int] = []
    group_of_face: list[int] = []
    of_object: Names = frozenset()
    groups: list[Names] = [frozenset()]
    for number, words in _lines(file):
        keyword = words[0]
        if keyword == "v":
            if len(words) < 4:
                raise _bad_line(file, number, words, "a corner has x, y and z")
            coordinates.append(words[1:4])
            corner_lines.append(number)
        elif keyword == "f":
            face = _face(file, number, words, len(coordinates))
            corners += face
            sizes.append(len(face))
            face_lines.append(number)
            group_of_face.append(len(groups) - 1)
        elif keyword == "o":
            of_object = _names(words)
            groups.append(of_object)
        elif keyword == "g":
            groups.append(of_object | _names(words))
    vertices = _numbers(file, coordinates, corner_lines)
    if corners and max(corners) >= len(vertices):
        bad = next(n for n, corner in enumerate(corners) if corner >= len(vertices))
        line = face_lines[int(np.searchsorted(np.cumsum(sizes), bad, side="right"))]
        raise unreadable_file(file, f"line {line} names corner {corners[bad] + 1:,}, there are "
                         f"{len(vertices):,}")
    triangles, owner = triangulate_polygons(
        file, vertices, np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64))
    group = np.array(group_of_face, dtype=np.int64)[owner]
    return ObjModel(vertices, triangles, group, tuple(groups))


def triangle_rows_of_group(file: DataFile, model: ObjModel, group: str) -> IntArray:
    """Triangles (k, 3) of a group. Raises InputError, with the nearest name, where it has none."""
    numbers = [number for number, names in enumerate(model.groups) if group in names]
    triangles = model.triangles[np.isin(model.group, numbers)]
    if len(triangles) == 0:
        names = sorted({name for held in model.groups for name in held})
        guess = suggest_name(group,
                             names) or f"its groups are {', '.join(names[:20]) or 'not named'}"
        raise InputError(f"{file.path} has no faces in a group {group!r}", where=guess,
                         hint="name one of its groups")
    return triangles


def _lines(file: DataFile) -> Iterator[tuple[int, list[str]]]:
    """Lines as words, without comments and blank lines; a backslash joins a line to the next."""
    begun = ""
    for number, line in enumerate(file.data.decode("utf-8", "replace").splitlines(), start=1):
        joined = begun + line.partition("#")[0]
        if joined.endswith("\\"):
            begun = joined[:-1] + " "
            continue
        begun = ""
        if words := joined.split():
            yield number, words


def _face(file: DataFile, number: int, words: list[str], count: int) -> list[int]:
    """The corners of a face as rows from 0; those counted from the start may come later."""
    try:
        stated = [int(word.partition("/")[0]) for word in words[1:]]
    except ValueError:
        raise _bad_line(file, number, words, "corners are whole numbers") from None
    if len(stated) < 3:
        raise _bad_line(file, number, words, "a face has three corners or more")
    rows = [corner - 1 if corner > 0 else count + corner for corner in stated]
    if 0 in stated or min(rows) < 0 or max(rows) >= 2**62:
        raise _bad_line(file, number, words, "it names a corner that is not there")
    return rows


def _names(words: list[str]) -> Names:
    """Each word of a `g` or `o` line names a group, and so do all together."""
    return frozenset(words[1:]) | ({" ".join(words[1:])} - {""})


def _numbers(file: DataFile, coordinates: list[list[str]], lines: list[int]) -> FloatArray:
    try:
        return np.array(coordinates, dtype=np.float64).reshape(-1, 3)
    except ValueError:
        bad = next((row for row, words in enumerate(coordinates)
                    if not all(map(is_number, words))), 0)
        raise _bad_line(file, lines[bad], ["v", *coordinates[bad]],
                        "three numbers are wanted") from None


def _bad_line(file: DataFile, number: int, words: list[str], why: str) -> InputError:
    return unreadable_file(file, f"line {number}: {why}: {' '.join(words)[:60]!r}",
                      "the file is damaged there; export it again")
