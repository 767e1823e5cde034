"""The surface of a field at any level, as triangles for viewing and export.

Source: docs/explanation/multi-colour-distance-field.md, Geometry field.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.field import DistanceField, sample_distance, sample_gradient

Triangles = IntArray

PROJECTION_ROUNDS = 2  # of moving vertices onto the level
MAX_MOVE_PITCHES = 0.5  # pitches; a larger move means an edge is near and the slope is no guide


def iso_surface(field: DistanceField, level_mm: float = 0.0) -> tuple[FloatArray, Triangles]:
    """The surface on which a field is `level_mm` deep, closed, its triangles wound outwards.

    Marching cubes (Lewiner et al. 2003, doi:10.1080/10867651.2003.10487582) on the nodes, then
    every vertex is moved to where the field, read between its nodes, has that level.

    level_mm : > 0 inside, < 0 outside the body
    returns : (n, 3) float64 [mm]; (m, 3) int64, rows of it
    raises : InputError where no place has that depth, or the surface would leave the grid
    """
    values, grid = field.values, field.grid
    nz, ny, nx = grid.shape
    where = f"level {level_mm:g} mm; grid of {nx} x {ny} x {nz} nodes, pitch {grid.pitch_mm:g} mm"
    if not np.isfinite(level_mm) or not float(values.min()) < level_mm < float(values.max()):
        raise InputError(
            "the field has no surface at this level", where=where,
            hint=f"its levels are from {values.min():.3g} to {values.max():.3g} mm",
        )
    faces = (values[0], values[-1], values[:, 0], values[:, -1], values[:, :, 0], values[:, :, -1])
    if max(float(face.max()) for face in faces) >= level_mm:
        raise InputError(
            "the surface at this level leaves the field's grid", where=where,
            hint="give the grid more nodes of padding, or choose a level farther inside",
        )
    from skimage.measure import marching_cubes  # takes a second, which few need to spend

    corners, triangles, _, _ = marching_cubes(values, level_mm)
    points = corners[:, ::-1] * grid.pitch_mm + np.asarray(grid.origin_mm)
    return weld_points(_onto_level(field, level_mm, points), triangles.astype(np.int64))


def weld_points(points: FloatArray, triangles: Triangles) -> tuple[FloatArray, Triangles]:
    """A closed surface that is still closed once a file has rounded its points to 32 bits.

    Points moved onto an edge or a corner meet there. Readers take those that are equal in the
    file for one; triangles between them, and pairs that then lie back to back, would be left over.

    points : (n, 3) float64; triangles : (m, 3) int64
    returns : both anew, points at what 32 bits hold
    """
    places, number = np.unique(points.astype(np.float32) + 0.0, axis=0, return_inverse=True)
    joined = number.reshape(-1)[triangles]
    a, b, c = joined.T
    joined = joined[(a != b) & (b != c) & (c != a)]
    order = np.argsort(joined, axis=1)
    turns = (order[:, 1] - order[:, 0]) % 3 == 1  # corners rise the way round it is wound
    _, group = np.unique(np.sort(joined, axis=1), axis=0, return_inverse=True)
    group = group.reshape(-1)
    first = np.zeros(len(joined), dtype=np.bool_)
    first[np.unique(group, return_index=True)[1]] = True
    balance = np.bincount(group, weights=np.where(turns, 1, -1))
    return places.astype(np.float64), joined[first & (balance != 0)[group]]


def _onto_level(field: DistanceField, level_mm: float, points: FloatArray) -> FloatArray:
    farthest = MAX_MOVE_PITCHES * field.grid.pitch_mm
    moved = points
    for _ in range(PROJECTION_ROUNDS):
        slope = sample_gradient(field, moved)
        slope /= np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-12)
        step = np.clip(level_mm - sample_distance(field, moved), -farthest, farthest)
        moved = moved + step[:, None] * slope
    better = np.abs(sample_distance(
        field, moved) - level_mm) < np.abs(sample_distance(field, points) - level_mm)
    return np.where(better[:, None], moved, points)
