"""Triangles from STL, PLY, OBJ, OFF and 3MF files, unrepaired.

Each format has a reader of its own, which reports errors in the terms of that format. This module
makes the checks that all formats share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.config.quantities import MAX_COORDINATE_MM, MM_PER_UNIT
from lmctl.errors import InputError
from lmctl.part.sources.files import MESH_SUFFIXES, DataFile
from lmctl.part.sources.recognition import unreadable_file

#: More triangles than this would take minutes and gigabytes to bring onto any grid.
MAX_TRIANGLES = 5_000_000

#: A part smaller or larger than this was most likely written in other units.
SMALLEST_PART_MM, LARGEST_PART_MM = 1.0, 2000.0


@dataclass(frozen=True)
class Mesh:
    """Triangles and their corners. vertices: (n, 3) float64 [mm]; triangles: (m, 3) int64.

    notes : what of its file was left out, for the user
    """

    vertices: FloatArray
    triangles: IntArray
    notes: tuple[str, ...] = ()


def read_mesh(
    file: DataFile, units: str | None, group: str | None = None, *, may_be_flat: bool = False
) -> Mesh:
    """The triangles of a mesh file, unrepaired, in mm.

    units : None for a 3MF file, which states its own
    group : the name of a group of an OBJ file, to read that alone
    may_be_flat : it is a surface that is measured from or deposited on, not a solid

    Raises InputError where it cannot be read, holds no triangles, coordinates that are not numbers,
    corners that are not there, or a size no part of this machine's kind has.
    """
    if file.suffix not in MESH_SUFFIXES:
        raise InputError(
            f"{file.path} is not a kind of mesh file that can be read",
            hint="STL, PLY, OBJ, OFF and 3MF files can; the ending must say which it is",
        )
    if units is None and file.suffix != "3mf":
        raise InputError(f"{file.path} does not state its units",
                         hint="say them in the part file: units = \"mm\"")
    if group is not None and file.suffix != "obj":
        raise InputError(f"{file.path} has no named groups", where=f"group = {group!r}",
                         hint="only OBJ files name groups; leave `group` out")
    vertices, triangles, notes = _read(file, units, group)
    if len(triangles) == 0:
        raise InputError(
            f"{file.path} holds no triangles", where=notes,
            hint='is it a point cloud? then write kind = "cloud"' if file.suffix == "ply" else
            "export the part as a mesh",
        )
    if len(triangles) > MAX_TRIANGLES:
        raise InputError(
            f"{file.path} has {len(triangles):,} triangles; at most {MAX_TRIANGLES:,} are read",
            hint="reduce the mesh: detail far below the bead width is lost anyway",
        )
    used = np.zeros(len(vertices), dtype=bool)
    used[triangles] = True
    in_mm = "mm" if units is None or file.suffix == "3mf" else units
    vertices = checked_points(file, vertices, in_mm, used=np.flatnonzero(used), what="corner",
                              may_be_flat=may_be_flat)
    return Mesh(vertices, triangles, notes)


def _read(
    file: DataFile, units: str | None, group: str | None
) -> tuple[FloatArray, IntArray, tuple[str, ...]]:
    match file.suffix:  # only the reader that is needed is loaded
        case "3mf":
            from lmctl.part.sources.threemf import read_3mf

            return read_3mf(file, units)
        case "stl":
            from lmctl.part.sources.stl_files import read_stl

            corners = read_stl(file)
            return corners, np.arange(len(corners)).reshape(-1, 3), ()
        case "off":
            from lmctl.part.sources.off_files import read_off

            return *read_off(file), ()
        case "ply":
            return *_from_ply(file), ()
    from lmctl.part.sources.obj_files import read_obj, triangle_rows_of_group

    model = read_obj(file)
    if group is not None:
        return model.vertices, triangle_rows_of_group(file, model, group), ()
    return model.vertices, model.triangles, ()


def _from_ply(file: DataFile) -> tuple[FloatArray, IntArray]:
    from lmctl.part.sources.ply_files import read_ply
    from lmctl.part.sources.polygons import triangulate_polygons

    elements = read_ply(file)
    vertex = elements.get("vertex")
    if vertex is None or not all(axis in vertex.numbers for axis in "xyz"):
        raise unreadable_file(file, "its head names no element vertex with x, y and z")
    vertices = np.stack([vertex.numbers[axis] for axis in "xyz"], axis=1)
    lists = elements["face"].lists if "face" in elements else {}
    named = lists.get("vertex_indices", lists.get("vertex_index"))
    if named is None:
        if any(name in elements for name in ("face", "tristrips")):
            raise unreadable_file(file, "its faces are not lists of corners (vertex_indices)",
                             "export it as plain polygons")
        return vertices, np.empty((0, 3), dtype=np.int64)
    sizes, corners = named
    there = (corners >= 0) & (corners < len(vertices)) & (corners == np.floor(corners))
    if not there.all():
        wrong = float(corners[int(np.argmin(there))])
        raise unreadable_file(file, f"a face names corner {wrong:g}, there are {len(vertices):,}, "
                         "counted from 0")
    triangles, _ = triangulate_polygons(file, vertices, corners.astype(np.int64), sizes)
    return vertices, triangles


def checked_points(
    file: DataFile, points: FloatArray, units: str, *, used: IntArray | None,
    what: str, may_be_flat: bool = False,
) -> NDArray[np.float64]:
    """Points in mm, known to be finite and of the size of a part.

    used : indices that matter, None for all. what : what to call a point in messages.
    """
    seen = points if used is None else points[used]
    bad = np.flatnonzero(~np.isfinite(seen).all(axis=1))
    if len(bad):
        first = int(bad[0] if used is None else used[bad[0]])
        raise InputError(
            f"{file.path} has coordinates that are not numbers",
            where=f"{len(bad)} of {len(seen)} {what}s; the first is {what} {first + 1}: "
            f"{points[first].tolist()}",
            hint="export it again, or remove them",
        )
    scaled = points * MM_PER_UNIT[units]
    seen = scaled if used is None else scaled[used]
    low, high = seen.min(axis=0), seen.max(axis=0)
    size = float((high - low).max())
    if not SMALLEST_PART_MM <= size <= LARGEST_PART_MM:
        _refuse_size(file, size, units)
    if (high - low).min() <= 0 and not may_be_flat:
        axis = "xyz"[int(np.argmin(high - low))]
        raise InputError(
            f"{file.path} is flat: all {what}s have the same {axis}", hint="a part needs a volume"
        )
    if max(abs(low).max(), abs(high).max()) > MAX_COORDINATE_MM:
        raise InputError(
            f"{file.path} lies too far from its origin",
            where=f"{max(abs(low).max(), abs(high).max()):.4g} mm; "
                  f"at most {MAX_COORDINATE_MM:g} mm",
            hint="move it to the origin in the program it came from",
        )
    if used is not None:  # unused corners may hold anything; they must not disturb later steps
        scaled = np.where(np.isfinite(scaled), scaled, 0.0)
    return np.asarray(scaled, dtype=np.float64)


def _refuse_size(file: DataFile, size_mm: float, units: str) -> None:
    fitting = [
        unit
        for unit, factor in MM_PER_UNIT.items()
        if SMALLEST_PART_MM <= size_mm / MM_PER_UNIT[units] * factor <= LARGEST_PART_MM
    ]
    raise InputError(
        f"{file.path} is {size_mm:.4g} mm across when read in {units}",
        where=f"a part is between {SMALLEST_PART_MM:g} mm and {LARGEST_PART_MM / 1000:g} m",
        hint=f"is it in {' or '.join(fitting)}? say so with `units`, or --units where there is no "
        "part file" if fitting else
        "scale it in the program it came from",
    )
