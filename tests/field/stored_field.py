"""A body with an exact distance, stored as a field: what tests of fields measure against."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.features import length
from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid

SLAB_PLANES = 8
BAND_PITCHES = 4.0  # nodes this near the surface hold their closest point
STEP = 1e-5  # of the differences, in pitches
ASIDE = np.array([0.37, 0.61, 0.23])  # a direction no body is likely to be symmetric in


def stored_field(distance: Callable[[FloatArray], FloatArray], grid: Grid) -> DistanceField:
    """Store an exact signed distance, with the closest points that make reading it back precise.

    distance : points (n, 3) float64 [mm] -> (n,) float64 [mm], positive inside, a true distance
    returns : Field whose nodes within four pitches of the surface have sources, others −1
    """
    values = np.empty(grid.shape, dtype=np.float32)
    sources = np.full(grid.shape, -1, dtype=np.int32)
    surface, inwards, count = [np.empty((0, 3))], [np.empty((0, 3))], 0
    for window in grid.slabs(SLAB_PLANES):
        points = window.node_points()
        exact = distance(points)
        values[window.z_first : window.z_last] = exact.reshape(window.shape)
        near = np.abs(exact) < BAND_PITCHES * grid.pitch_mm
        closest, slope = _closest(distance, points[near], exact[near], grid.pitch_mm)
        rows = np.full(len(points), -1, dtype=np.int32)
        rows[near] = count + np.arange(len(closest))
        sources[window.z_first : window.z_last] = rows.reshape(window.shape)
        surface.append(closest)
        inwards.append(slope)
        count += len(closest)
    return DistanceField(
        grid, values, sources, np.vstack(surface), inwards=np.vstack(inwards), exact=True
    )


def _closest(
    distance: Callable[[FloatArray], FloatArray], points: FloatArray, exact: FloatArray,
    pitch_mm: float,
) -> tuple[FloatArray, FloatArray]:
    """p − d ∇d and ∇d; where several surface points are nearest, a little aside, at one of them."""
    step = STEP * pitch_mm
    slope = _slope(distance, points, step)
    # On an edge of the distance the difference straddles two directions and is too short.
    torn = np.abs(length(slope) - 1.0) > 1e-4
    if torn.any():
        aside = points[torn] + 10.0 * step * ASIDE
        slope[torn] = _slope(distance, aside, step)
    slope /= np.maximum(length(slope), 1e-12)[:, None]
    return points - exact[:, None] * slope, slope


def _slope(
    distance: Callable[[FloatArray], FloatArray], points: FloatArray, step: float
) -> FloatArray:
    slope = np.empty_like(points)
    for axis in range(3):
        ahead, behind = points.copy(), points.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        slope[:, axis] = (distance(ahead) - distance(behind)) / (2.0 * step)
    return slope
