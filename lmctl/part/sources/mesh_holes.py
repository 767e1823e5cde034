"""Holes of a mesh: small ones and those in a flat face are closed, others are refused.

A hole no larger than a bead cannot be deposited, however it is closed. A larger one is closed where
its rim lies in a plane and the face beside it goes on in that plane, so that a piece of a face is
missing. Anything else may be an opening that is meant: closing it would be a guess.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.mesh_topology import connected_components, directed_edges, edge_numbers

#: How far a rim may leave its plane: rounding of coordinates [mm].
FLATNESS_TOLERANCE_MM = 1e-3

#: Cosine between a flat hole and a face beside it that goes on in its plane, about 25°: a facet of
#: a round wall, too.
COPLANAR_MIN_COSINE = 0.9


def close_holes(
    vertices: FloatArray, triangles: IntArray, name: str, hole_mm: float, remarks: list[str]
) -> tuple[FloatArray, IntArray]:
    """Every edge in an even number of triangles.

    name : of the mesh, for messages; hole_mm : holes up to this size are closed whatever their form
    remarks : what was done is appended to it
    raises : InputError, with the place, where a hole is larger and nothing shows how to close it
    """
    number, counts = edge_numbers(triangles)
    is_open = np.flatnonzero((counts % 2 == 1)[number])
    _, first = np.unique(number[is_open], return_index=True)
    is_open = is_open[np.sort(first)]
    if len(is_open) == 0:
        return vertices, triangles
    rim = directed_edges(triangles)[is_open]
    holes = _loops(rim, len(vertices))
    beside = _normals(vertices[triangles[is_open // 3]])
    middles: list[FloatArray] = []
    caps: list[IntArray] = []
    refused: list[tuple[float, FloatArray]] = []
    sizes: list[float] = []
    flat = False
    for edges in holes:
        corners = vertices[rim[edges, 0]]
        size = float(np.linalg.norm(np.ptp(vertices[np.unique(rim[edges])], axis=0)))
        cap = _flat_cap(vertices, rim[edges], beside[edges])
        if cap is not None:
            caps.append(cap)
            flat = flat or size > hole_mm
        elif size <= hole_mm:
            middle = np.full(len(edges), len(vertices) + len(middles))
            middles.append(corners.mean(axis=0))
            caps.append(np.stack([rim[edges, 1], rim[edges, 0], middle], axis=1))
        else:
            refused.append((size, corners.mean(axis=0)))
        sizes.append(size)
    if refused:
        size, place = max(refused, key=lambda hole: hole[0])
        at = ", ".join(f"{v:.2f}" for v in place)
        raise InputError(
            f"the mesh {name} is open",
            where=(
                f"{len(holes)} hole{'s' if len(holes) > 1 else ''}, {len(rim)} open edges of "
                f"{len(triangles)} triangles",
                f"the largest hole is {size:.3g} mm across, near ({at}) mm; up to "
                f"{hole_mm:g} mm (a bead) is closed here, and what is missing of a flat face",
            ),
            hint="close it in a mesh program, or export the solid again",
        )
    largest = int(np.argmax(sizes))
    at = ", ".join(f"{v:.2f}" for v in vertices[rim[holes[largest], 0]].mean(axis=0))
    remarks.append(
        f"{len(holes)} hole{'s' if len(holes) > 1 else ''} closed, "
        f"{'the largest ' if len(holes) > 1 else ''}{sizes[largest]:.2g} mm across near ({at}) mm"
        + ("; facets were missing from flat faces" if flat else ""))
    return np.vstack([vertices, *middles]), np.vstack([triangles, *caps])


def _loops(rim: IntArray, count: int) -> list[IntArray]:
    """Rim edges (k, 2) as holes: rows of `rim` of each, in order where they run in one round.

    Where several holes meet in a corner they are parted there. Where triangles face opposite ways
    edges do not follow each other; what hangs together is then one hole.
    """
    follows: dict[int, list[int]] = {}
    for row, start in enumerate(rim[:, 0].tolist()):
        follows.setdefault(start, []).append(row)
    group = connected_components(rim, count)[rim[:, 0]]
    holes: list[IntArray] = []
    for which in np.unique(group).tolist():
        own = np.flatnonzero(group == which)
        starts, ends = np.sort(rim[own, 0]), np.sort(rim[own, 1])
        if np.array_equal(starts, ends):
            holes += _rounds(rim, follows, own.tolist())
        else:
            holes.append(own)
    return holes


def _rounds(rim: IntArray, follows: dict[int, list[int]], rows: list[int]) -> list[IntArray]:
    """Closed walks over rim edges, each cut off where it comes back to a corner it has passed."""
    found, left = [], set(rows)
    while left:
        path: list[int] = []
        passed: dict[int, int] = {}
        corner = int(rim[min(left), 0])
        while True:
            if corner in passed:
                first = passed[corner]
                found.append(np.array(path[first:], dtype=np.int64))
                passed = {c: n for c, n in passed.items() if n < first}
                del path[first:]
                if not path:
                    break
            passed[corner] = len(path)
            row = next(row for row in follows[corner] if row in left)
            left.remove(row)
            path.append(row)
            corner = int(rim[row, 1])
    return found


def _flat_cap(vertices: FloatArray, edges: IntArray, beside: FloatArray) -> IntArray | None:
    """Triangles across a flat hole whose plane goes on beside it; None where it is no such hole.

    edges : (k, 2) the rim in order; beside : (k, 3) normals of the triangles at it
    """
    if not np.array_equal(edges[1:, 0], edges[:-1, 1]) or edges[-1, 1] != edges[0, 0]:
        return None
    corners = edges[::-1, 1]  # the other way round than the triangles beside it run
    points = vertices[corners]
    relative = points - points.mean(axis=0)
    normal = np.cross(relative, np.roll(relative, -1, axis=0)).sum(axis=0)
    area = float(np.linalg.norm(normal))
    if area <= 0.0:
        return None
    normal /= area
    if np.abs(relative @ normal).max(
        ) > FLATNESS_TOLERANCE_MM or (beside @ normal).max() < COPLANAR_MIN_COSINE:
        return None
    if len(corners) == 3:
        return corners[None]
    from manifold3d import triangulate  # only few meshes need it

    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    flat = np.stack([relative @ across, relative @ np.cross(normal, across)], axis=1)
    cut = np.asarray(triangulate([flat]), dtype=np.int64).reshape(-1, 3)
    u, v = flat[cut[:, 1]] - flat[cut[:, 0]], flat[cut[:, 2]] - flat[cut[:, 0]]
    covered = float(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())
    if len(cut) != len(corners) - 2 or covered > (1.0 + 1e-6) * area:
        return None  # the rim crosses itself
    cap: IntArray = corners[cut]
    return cap


def _normals(corners: FloatArray) -> FloatArray:
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    units: FloatArray = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    return units
