"""Slopes and greatest values of distances that are known only by evaluation.

A signed distance changes by at most 1 mm per mm. So the value at the middle of a cell bounds the
whole cell, and the search can close in on the greatest depth.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmctl.array_types import FloatArray

Distance = Callable[[FloatArray], FloatArray]

#: Half the span that slopes are taken over; far above rounding, far below any detail.
SLOPE_STEP_MM = 1e-4

#: Where a slope is not of length 1 (at the middle of a ball) it is taken this far beside.
SIDESTEP_MM = np.array([0.57, 0.31, 0.76]) * 1e-3

#: Cells looked into at a time while closing in on the deepest place.
MAX_CELLS = 4096
FIRST_CELLS = 16


def unit_gradient(at: Distance, points: FloatArray, step_mm: float = SLOPE_STEP_MM) -> FloatArray:
    """The direction in which a distance grows, length 1; (n, 3) -> (n, 3).

    Where several directions are as good (on a medial axis), one of them.
    """
    slope, size = _slope(at, points, step_mm)
    split = size < 0.9
    if split.any():
        aside = SIDESTEP_MM * (step_mm / SLOPE_STEP_MM)
        slope[split], size[split] = _slope(at, points[split] + aside, step_mm)
    return slope / np.maximum(size, 1e-12)[:, None]


def _slope(at: Distance, points: FloatArray, step_mm: float) -> tuple[FloatArray, FloatArray]:
    slope = np.empty((len(points), 3))
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = step_mm
        slope[:, axis] = (at(points + step) - at(points - step)) / (2 * step_mm)
    return slope, np.linalg.norm(slope, axis=1)


def unit_rows(vectors: FloatArray) -> FloatArray:
    """Rows (n, 3) at length 1; those of no length stay."""
    size = np.linalg.norm(vectors, axis=1)
    unit: FloatArray = vectors / np.maximum(size, 1e-12)[:, None]
    return unit


def project_to_surface(
    at: Distance, slope: Distance, points: FloatArray, rounds: int = 2
) -> FloatArray:
    """Where the way along the slope meets the surface: the nearest point of a true distance."""
    closest = points.copy()
    for _ in range(rounds):
        closest -= at(closest)[:, None] * slope(closest)
    return closest


def maximum_in_box(
    at: Distance, low: FloatArray, high: FloatArray, tolerance_mm: float = 1e-4,
    enough_mm: float | None = None,
) -> float:
    """The greatest value of a distance in a box, by halving cells that may still hold it.

    at : changes by at most 1 mm per mm
    enough_mm : stop once a value greater than this is found, and return the greatest value found
        so far
    returns : at most `tolerance_mm` below the greatest; where thousands of cells are as good (the
        middle plane of a plate) the best of them are followed
    """
    size = (high - low) / FIRST_CELLS
    steps = np.stack(np.meshgrid(*[np.arange(FIRST_CELLS)] * 3, indexing="ij"), axis=-1)
    middles = low + (steps.reshape(-1, 3) + 0.5) * size
    halves = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 4
    best = -np.inf
    while True:
        values = at(middles)
        best = max(best, float(values.max()))
        reach = 0.5 * float(np.linalg.norm(size))
        if reach <= tolerance_mm or (enough_mm is not None and best > enough_mm):
            return best
        least = best + tolerance_mm if enough_mm is None else max(best + tolerance_mm, enough_mm)
        kept = np.flatnonzero(values + reach > least)
        if len(kept) > MAX_CELLS:
            kept = kept[np.argsort(-values[kept], kind="stable")[:MAX_CELLS]]
        middles = (middles[kept, None] + halves * size).reshape(-1, 3)
        size = size / 2
        if len(middles) == 0:
            return best
