"""Several polylines, or other stretches, one after the other in one array."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel


def indices_within_stretches(sizes: IndexArray) -> IndexArray:
    """For stretches of so many items, the number of each item within its own, from 0."""
    total = int(sizes.sum())
    return np.asarray(np.arange(total) - np.repeat(np.cumsum(sizes) - sizes, sizes))


def arc_lengths_mm(points_mm: FloatArray, starts: IndexArray, gap_mm: float = 0.0) -> FloatArray:
    """Length from the first vertex of its polyline to each vertex, (n,) float64.

    points_mm : (n, 2) float64; starts : (m + 1,) polyline k is points starts[k] to starts[k + 1]
    gap_mm : above 0, lengths go on from so far beyond the end of the polyline before
    """
    return np.asarray(_arc_lengths_kernel(np.ascontiguousarray(points_mm), starts, gap_mm))


def greatest_differences(one: FloatArray, other: FloatArray) -> FloatArray:
    """Greatest difference in each row of two arrays (n, m), (n,) float64."""
    return np.asarray(_differences_kernel(
        np.ascontiguousarray(one), np.ascontiguousarray(other)))


@kernel
def _arc_lengths_kernel(points: FloatArray, starts: IndexArray, gap: float) -> FloatArray:
    along = np.empty(len(points))
    length = 0.0
    for line in range(len(starts) - 1):
        length = length + gap if gap > 0.0 and line > 0 else 0.0
        for k in range(starts[line], starts[line + 1]):
            if k > starts[line]:
                dx, dy = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
                length += np.sqrt(dx * dx + dy * dy)
            along[k] = length
    return along


@kernel
def _differences_kernel(one: FloatArray, other: FloatArray) -> FloatArray:
    greatest = np.empty(len(one))
    for k in range(len(one)):
        most = 0.0
        for c in range(one.shape[1]):
            most = max(most, abs(one[k, c] - other[k, c]))
        greatest[k] = most
    return greatest
