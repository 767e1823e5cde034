"""A part for other programs: its multi-colour field for ParaView, its surface with colours."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.field.surface import iso_surface, weld_points
from lmctl.field.surface_files import Kind, surface_bytes
from lmctl.part.bodies.mesh_solid import MeshSolid
from lmctl.part.part import Part
from lmctl.part.resolution import PADDING_NODES, finest_pitch_for_nodes
from lmctl.report.composition_colours import composition_colours
from lmctl.report.vti_file import VTI_TAIL, vti_head

Progress = Callable[[int, int], None]

#: Planes of a field written at a time.
SLAB_PLANES = 8

#: Nodes of the grid a surface is found on; its vertices are then moved onto the part itself.
MAX_SURFACE_NODES = 30_000_000

#: A field file above this many bytes is refused.
MAX_BYTES = 20_000_000_000


def write_field(part: Part, target: Path, progress: Progress | None = None) -> None:
    """The pair d(S), F(r) on the part's grid as a VTK image (.vti), for ParaView.

    Source: Zhou et al. 2009, Eq. (3).

    Point data: `distance` [mm], positive inside, and one array a material with its volume
    fraction. Written slab by slab, so that memory does not grow with the grid.

    Raises InputError where the file would be too large, OSError where it cannot be written.
    """
    grid, names = part.grid, [m.name for m in part.materials]
    block = 4 * grid.n_nodes
    if (total := block * (1 + len(names))) > MAX_BYTES:
        raise InputError(
            f"the field would take {total / 1e9:.3g} GB",
            where=f"{grid.n_nodes:.3g} nodes at a pitch of {grid.pitch_mm:g} mm; at most "
            f"{MAX_BYTES / 1e9:g} GB", hint="raise pitch_mm in the part file",
        )
    head = vti_head(grid.shape, grid.origin_mm, [grid.pitch_mm] * 3, array_names(names))
    partial = target.with_name(f".{target.name}.partial")
    try:
        with partial.open("wb") as file:
            file.write(head)
            starts = [len(head) + n * (8 + block) for n in range(1 + len(names))]
            for start in starts:
                file.seek(start)
                file.write(np.uint64(block).tobytes())
            plane = 4 * grid.shape[1] * grid.shape[2]
            for window in grid.slabs(SLAB_PLANES):
                offset = 8 + window.z_first * plane
                file.seek(starts[0] + offset)
                file.write(np.ascontiguousarray(part.distance(window), dtype="<f4").tobytes())
                fractions = part.composition(window.node_points())
                for start, column in zip(starts[1:], fractions.T, strict=True):
                    file.seek(start + offset)
                    file.write(np.ascontiguousarray(column, dtype="<f4").tobytes())
                if progress is not None:
                    progress(window.z_last, grid.shape[0])
            file.seek(0, os.SEEK_END)
            file.write(VTI_TAIL)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def array_names(materials: Sequence[str]) -> list[str]:
    """`distance`, and an array's name for each material, no two alike.

    Nothing is in them that XML or ParaView would take otherwise.

    >>> array_names(["316L", "Fe & C", "distance"])
    ['distance', '316L', 'Fe _ C', 'distance 2']
    """
    names = ["distance"]
    for material in materials:
        plain = name = re.sub(r"[^A-Za-z0-9 .+/_-]", "_", material)
        number = 2
        while name in names:
            name, number = f"{plain} {number}", number + 1
        names.append(name)
    return names


def write_surface(part: Part, target: Path) -> None:
    """The surface of a part as PLY (coloured by composition), STL or 3MF, by its ending.

    Raises OSError where the file cannot be written.
    """
    kinds: dict[str, Kind] = {".ply": "ply", ".stl": "stl", ".3mf": "3mf"}
    kind = kinds[target.suffix.lower()]
    vertices, triangles = part_surface(part)
    colours = None
    if kind == "ply":
        shades = composition_colours(part.composition(vertices))
        colours = np.rint(255 * shades).astype(np.uint8)
    target.write_bytes(surface_bytes(kind, vertices, triangles, colours))


def part_surface(part: Part) -> tuple[FloatArray, NDArray[np.int64]]:
    """A mesh's own triangles; of any other body its zero level, moved onto the body itself."""
    if isinstance(part.body, MeshSolid):
        return part.body.mesh.vertices, part.body.mesh.triangles
    low, high = part.bounds_mm
    pitch = max(part.grid.pitch_mm, finest_pitch_for_nodes(low, high, MAX_SURFACE_NODES))
    grid = Grid.enclosing(low, high, pitch, PADDING_NODES)
    values = np.empty(grid.shape, dtype=np.float32)
    for window in grid.slabs(SLAB_PLANES):
        values[window.z_first : window.z_last] = part.distance(window)
    vertices, triangles = iso_surface(DistanceField(grid, values, None, np.empty((0, 3))))
    step = part.body.distance_at(vertices)[:, None] * part.body.inward_directions(vertices)
    near = np.linalg.norm(step, axis=1) <= 0.5 * pitch
    vertices[near] -= step[near]
    return weld_points(vertices, triangles)
