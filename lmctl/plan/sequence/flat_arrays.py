"""Several polylines, or other stretches, one after the other in one array."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IndexArray


def indices_within_stretches(sizes: IndexArray) -> IndexArray:
    """For stretches of so many items, the number of each item within its own, from 0."""
    total = int(sizes.sum())
    return np.asarray(np.arange(total) - np.repeat(np.cumsum(sizes) - sizes, sizes))


def arc_lengths_mm(points_mm: FloatArray, starts: IndexArray) -> FloatArray:
    """Length from the first vertex of its polyline to each vertex, (n,) float64.

    points_mm : (n, 2) float64; starts : (m + 1,) polyline k is points starts[k] to starts[k + 1]
    """
    if len(points_mm) == 0:
        return np.empty(0)
    steps = np.zeros(len(points_mm))
    np.sqrt((np.diff(points_mm, axis=0) ** 2).sum(axis=1), out=steps[1:])
    steps[starts[:-1]] = 0.0
    total = np.cumsum(steps)
    return np.asarray(total - np.repeat(total[starts[:-1]], np.diff(starts)))
