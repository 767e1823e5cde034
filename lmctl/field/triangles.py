"""Triangles: the point of one that is nearest, and the way across edges to a nearer one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel

# over edges; more are needed only where triangles are far smaller than the pitch
MAX_WALK_STEPS = 64
FAR_PITCHES = 8.0  # beyond, the triangle of the nearest seed is as good to 0.01 pitches


def refine_to_closest(
    sources: NDArray[np.int32], distance: NDArray[np.float32], triangle: NDArray[np.int32],
    corners_mm: FloatArray, grid: Grid,
) -> None:
    """Make swept distances exact, in place: each node walks from its source to what is nearest.

    sources : (nz, ny, nx) int32, row of `triangle`; on return the triangle nearest to each node
    distance : (nz, ny, nx) float32 [mm], made anew
    triangle : (n,) int32, the triangle each surface point lies on
    corners_mm : (m, 3, 3) float64
    """
    relative = np.ascontiguousarray((corners_mm - np.asarray(grid.origin_mm)) / grid.pitch_mm)
    _walk_kernel(
        sources, distance, triangle, relative, edge_neighbours(corners_mm), grid.pitch_mm
    )


def edge_neighbours(corners_mm: FloatArray) -> NDArray[np.int32]:
    """The triangle on the other side of each edge, (m, 3) int32, edge e from corner e to e + 1.

    −1 where there is none. Corners are one where their coordinates are; where more than two
    triangles share an edge they are taken in pairs.
    """
    mixed = _corner_keys(corners_mm)
    edge = (mixed + np.roll(mixed, -1, axis=1)).reshape(-1)
    order = np.argsort(edge, kind="stable")
    same = edge[order[1:]] == edge[order[:-1]]
    # In a run of equal edges the first goes with the second, the third with the fourth.
    run = np.arange(len(same)) - np.maximum.accumulate(np.where(same, -1, np.arange(len(same))))
    first = np.flatnonzero(same & (run % 2 == 1))
    neighbours = np.full(edge.size, -1, dtype=np.int32)
    one, other = order[first], order[first + 1]
    neighbours[one], neighbours[other] = other // 3, one // 3
    return neighbours.reshape(-1, 3)


def unique_triangles(corners_mm: FloatArray) -> tuple[FloatArray, int]:
    """Each triangle (m, 3, 3) once, whichever way it is wound, and how many were left out."""
    keys = _corner_keys(corners_mm).sum(axis=1)
    _, first = np.unique(keys, return_index=True)
    if len(first) == len(keys):
        return corners_mm, 0
    first.sort()
    return corners_mm[first], len(keys) - len(first)


def _corner_keys(corners_mm: FloatArray) -> NDArray[np.uint64]:
    """A number for each corner, (m, 3) uint64, the same where the coordinates are."""
    bits = np.ascontiguousarray(corners_mm + 0.0).view(np.uint64).reshape(-1, 3, 3)
    mixed = np.zeros(bits.shape[:2], dtype=np.uint64)
    for axis, odd in enumerate((0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)):
        mixed = (mixed ^ bits[:, :, axis]) * np.uint64(odd)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def closest_points_on_rows(
    surface_mm: FloatArray, rows: NDArray[np.int32], points: FloatArray
) -> FloatArray:
    """The point nearest to points (n, 3) on what their rows (n,) of a surface name.

    surface_mm : points (m, 3), which are their own nearest, or triangles (m, 3, 3)
    returns : (n, 3) float64 [mm]
    """
    if surface_mm.ndim == 2:
        return np.asarray(surface_mm[rows])
    closest = np.empty((len(points), 3))
    _closest_kernel(surface_mm, rows, points, closest)
    return closest


@kernel
def _closest_kernel(
    triangles: FloatArray, rows: NDArray[np.int32], points: FloatArray, closest: FloatArray
) -> None:
    for n in range(len(points)):
        closest[n, 0], closest[n, 1], closest[n, 2], _ = closest_on_triangle(
            triangles, int(np.int64(rows[n])), points[n, 0], points[n, 1], points[n, 2]
        )


@inner_kernel
def closest_on_triangle(
    t: FloatArray, n: int, px: float, py: float, pz: float
) -> tuple[float, float, float, int]:
    """The point of triangle n of t (m, 3, 3) nearest to p, and where on the triangle it is.

    The last number is a set of bits: 1, 2, 4 for being on the edge from corner 0, 1, 2 to the
    next; on a corner both its edges; 0 within. After Ericson, Real-Time Collision Detection
    (2005), 5.1.5: by the Voronoi region p lies in. A triangle of no width is its longest edges.
    """
    ax, ay, az = t[n, 0, 0], t[n, 0, 1], t[n, 0, 2]
    abx, aby, abz = t[n, 1, 0] - ax, t[n, 1, 1] - ay, t[n, 1, 2] - az
    acx, acy, acz = t[n, 2, 0] - ax, t[n, 2, 1] - ay, t[n, 2, 2] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    bb = abx * abx + aby * aby + abz * abz
    bc = abx * acx + aby * acy + abz * acz
    cc = acx * acx + acy * acy + acz * acz
    if bb * cc - bc * bc <= 1e-10 * bb * cc:
        # Its corners lie on one line, which one or both of the edges at corner 0 cover.
        sb = min(1.0, max(0.0, d1 / bb)) if bb > 0.0 else 0.0
        sc = min(1.0, max(0.0, d2 / cc)) if cc > 0.0 else 0.0
        b2 = (apx - sb * abx) ** 2 + (apy - sb * aby) ** 2 + (apz - sb * abz) ** 2
        c2 = (apx - sc * acx) ** 2 + (apy - sc * acy) ** 2 + (apz - sc * acz) ** 2
        if b2 < c2:
            return ax + sb * abx, ay + sb * aby, az + sb * abz, 7
        return ax + sc * acx, ay + sc * acy, az + sc * acz, 7
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, 5
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return t[n, 1, 0], t[n, 1, 1], t[n, 1, 2], 3
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / (d1 - d3)
        return ax + s * abx, ay + s * aby, az + s * abz, 1
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return t[n, 2, 0], t[n, 2, 1], t[n, 2, 2], 6
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        s = d2 / (d2 - d6)
        return ax + s * acx, ay + s * acy, az + s * acz, 4
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        s = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return (
            t[n, 1, 0] + s * (t[n, 2, 0] - t[n, 1, 0]),
            t[n, 1, 1] + s * (t[n, 2, 1] - t[n, 1, 1]),
            t[n, 1, 2] + s * (t[n, 2, 2] - t[n, 1, 2]),
            2,
        )
    v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    return ax + v * abx + w * acx, ay + v * aby + w * acy, az + v * abz + w * acz, 0


@kernel
def _walk_kernel(
    sources: NDArray[np.int32], distance: NDArray[np.float32], triangle: NDArray[np.int32],
    triangles: FloatArray, neighbours: NDArray[np.int32], pitch: float,
) -> None:
    nz, ny, nx = sources.shape
    for k in range(nz):
        for j in range(ny):
            for i in range(nx):
                x, y, z = float(i), float(j), float(k)
                n = int(np.int64(triangle[sources[k, j, i]]))
                qx, qy, qz, edges = closest_on_triangle(triangles, n, x, y, z)
                least = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
                came, steps = -1, 0
                while edges != 0 and steps < MAX_WALK_STEPS and least < FAR_PITCHES**2:
                    steps += 1
                    # Across an edge only what is nearer will do; around a corner, where all
                    # triangles are as near, the way goes on to the next.
                    best, best_edges, best_d2 = -1, 0, least
                    corner = edges & (edges - 1) != 0
                    for e in range(3):
                        m = int(np.int64(neighbours[n, e]))
                        if edges & (1 << e) == 0 or m < 0 or m == came:
                            continue
                        qx, qy, qz, there = closest_on_triangle(triangles, m, x, y, z)
                        d2 = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
                        if d2 < best_d2 or (corner and best < 0 and d2 == least):
                            best, best_edges, best_d2 = m, there, d2
                    if best < 0:
                        break
                    came, n, edges, least = n, best, best_edges, best_d2
                sources[k, j, i] = n
                distance[k, j, i] = np.float32(pitch * np.sqrt(least))
