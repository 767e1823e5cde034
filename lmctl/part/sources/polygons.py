"""Polygons of a mesh file cut into triangles that cover them once.

A convex polygon is cut into a fan. A concave one cannot be: some triangles of a fan lie outside
it. manifold3d cuts those by ears, in the plane that fits them best.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile

#: Corners may turn the wrong way by this share of the polygon's area: rounding of a straight side.
STRAIGHT_SHARE = 1e-9

#: Triangles may cover this much more than their polygon: rounding.
COVER_SHARE = 1e-6


def triangulate_polygons(
    file: DataFile, vertices: FloatArray, corners: IntArray, sizes: IntArray
) -> tuple[IntArray, IntArray]:
    """Triangles of polygons, and which polygon each belongs to.

    file : for messages
    vertices : (n, 3) float64; corners : (k,) int64 rows of `vertices`, polygon after polygon, all
        of them there; sizes : (f,) int64 ≥ 0, corners of each polygon, summing to k. Those of
        fewer than three have no area and give nothing
    returns : triangles (m, 3) int64, facing as their polygon does; polygon (m,) int64, ascending
    raises : InputError where a polygon crosses itself, with its number and place
    """
    first = np.cumsum(sizes) - sizes
    pieces, owners = [], []
    for size in np.unique(sizes[sizes >= 3]).tolist():
        rows = np.flatnonzero(sizes == size)
        polygons = corners[first[rows, None] + np.arange(size)]
        if size > 3:
            with np.errstate(invalid="ignore", over="ignore"):  # no numbers: refused later
                concave = ~_is_convex(vertices[polygons])
            concave &= np.isfinite(vertices[polygons]).all(axis=(1, 2))
            for row in np.flatnonzero(concave).tolist():
                cut = _ears(file, vertices[polygons[row]], int(rows[row]))
                pieces.append(polygons[row][cut])
                owners.append(np.full(len(cut), rows[row]))
            rows, polygons = rows[~concave], polygons[~concave]
        fan = np.stack([np.zeros(size - 2, int), np.arange(1, size - 1), np.arange(2, size)], 1)
        pieces.append(polygons[:, fan].reshape(-1, 3))
        owners.append(np.repeat(rows, size - 2))
    if not pieces:
        return np.empty((0, 3), dtype=np.int64), np.empty(0, dtype=np.int64)
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(pieces)[order].astype(np.int64), owner[order]


def _normals(points: FloatArray) -> FloatArray:
    """Twice the area of polygons (f, s, 3) along their normal, (f, 3) (Newell)."""
    relative = points - points[:, :1]
    normals: FloatArray = np.cross(relative, np.roll(relative, -1, axis=1)).sum(axis=1)
    return normals


def _is_convex(points: FloatArray) -> NDArray[np.bool_]:
    """Whether polygons (f, s, 3) turn one way at all corners, and once in all, or are lines."""
    normals = _normals(points)
    area = np.linalg.norm(normals, axis=1)
    units = normals / np.maximum(area, 1e-300)[:, None]
    sides = np.roll(points, -1, axis=1) - points
    before = np.roll(sides, 1, axis=1)
    around = np.cross(before, sides)
    turn = np.einsum("fsk,fk->fs", around, units)
    angle = np.arctan2(turn, (before * sides).sum(axis=2)).sum(axis=1)
    turns_consistently = (
        (turn >= -STRAIGHT_SHARE * area[:, None]).all(axis=1) & (angle < 3.0 * np.pi))
    longest = (sides**2).sum(axis=2).max(axis=1)
    line = np.linalg.norm(around, axis=2).max(axis=1) <= STRAIGHT_SHARE * longest
    convex: NDArray[np.bool_] = (turns_consistently & (area > STRAIGHT_SHARE * longest)) | line
    return convex


def _ears(file: DataFile, points: FloatArray, number: int) -> IntArray:
    """Triangles (s − 2, 3) of one concave polygon (s, 3)."""
    from manifold3d import triangulate  # only few files need it

    normal = _normals(points[None])[0]
    area = float(np.linalg.norm(normal))
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    normal, across = normal / max(area, 1e-300), across / max(np.linalg.norm(across), 1e-300)
    flat = np.stack([points @ across, points @ np.cross(normal, across)], axis=1)
    flat -= flat.mean(axis=0)
    cut = np.asarray(triangulate([flat]), dtype=np.int64).reshape(-1, 3)
    least = STRAIGHT_SHARE * float(((points - np.roll(points, 1, axis=0)) ** 2).sum(axis=1).max())
    a, b, c = (flat[cut[:, k]] for k in range(3))
    u, v = b - a, c - a
    covered = float(np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())
    if len(cut) != len(points) - 2 or area <= least or covered > (1.0 + COVER_SHARE) * area:
        at = ", ".join(f"{x:.4g}" for x in points.mean(axis=0))
        raise InputError(
            f"{file.path} has a polygon that crosses itself",
            where=f"polygon {number + 1}, with {len(points)} corners around ({at})",
            hint="export it again, cut into triangles",
        )
    return cut
