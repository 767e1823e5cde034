"""One face of a mesh: the smooth patch around a place, or a group that an OBJ file names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.quantities import MM_PER_UNIT
from lmctl.errors import InputError
from lmctl.field.triangles import closest_points_on_rows
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.mesh_topology import connected_components, edge_numbers, remove_slivers
from lmctl.part.sources.obj_files import read_obj, triangle_rows_of_group

#: A place farther from the mesh than this names no face of it.
MAX_DISTANCE_FRACTION = 0.05


def smooth_patch_around(mesh: Mesh, at_mm: Sequence[float], angle_deg: float) -> FloatArray:
    """The triangles that hang together with the one nearest to a place, over blunt edges only.

    angle_deg : between two triangles' normals, up to which they are of one face
    returns : (m, 3, 3) float64 [mm]
    raises : InputError where the place is far from the mesh
    """
    corners = mesh.vertices[mesh.triangles]
    place = np.asarray(at_mm, dtype=np.float64)
    rows = np.arange(len(corners), dtype=np.int32)
    found = closest_points_on_rows(
        np.ascontiguousarray(corners), rows, np.tile(place, (len(corners), 1)))
    away = np.linalg.norm(found - place, axis=1)
    nearest = int(np.argmin(away))
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if away[nearest] > MAX_DISTANCE_FRACTION * size:
        where = ", ".join(f"{v:g}" for v in place)
        raise InputError(
            f"there is no face at ({where}) mm",
            where=f"the mesh is {away[nearest]:.3g} mm away from there",
            hint="give a place on the face, in the mesh's own coordinates",
        )
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    number, counts = edge_numbers(mesh.triangles)
    order = np.argsort(number, kind="stable")
    pairs = order[(counts == 2)[number[order]]].reshape(-1, 2) // 3
    cosine = (normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(axis=1)
    is_smooth = cosine >= np.cos(np.deg2rad(angle_deg))
    patch = connected_components(pairs[is_smooth], len(corners))
    return remove_slivers(corners[patch == patch[nearest]])


def triangles_of_group(file: DataFile, group: str, units: str | None) -> FloatArray:
    """The triangles of a `g` or `o` group of an OBJ file.

    returns : (m, 3, 3) float64 [mm]
    raises : InputError where the file is of another kind, has no such group, or cannot be read
    """
    if file.suffix != "obj":
        raise InputError(f"{file.path} has no named faces",
                         hint="only OBJ files name groups; choose the face by at_mm instead")
    model = read_obj(file)
    corners_mm = model.vertices[triangle_rows_of_group(file, model,
                                                       group)] * MM_PER_UNIT[units or "mm"]
    if not np.isfinite(corners_mm).all():
        raise InputError(f"{file.path} has coordinates that are not numbers",
                         hint="export it again")
    return remove_slivers(corners_mm)
