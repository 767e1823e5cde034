"""Which places have a point of a track near: points in square bins, looked up by kernels."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel


def reaches_missed(
    places_mm: FloatArray, points_mm: FloatArray, reach_mm: FloatArray
) -> IntArray:
    """Of several distances, how many are too short to reach a point from each place. (n,)

    places_mm : (n, 2); points_mm : (m, 2); reach_mm : (k,), ascending, above 0
    """
    low = points_mm.min(axis=0)
    bin_mm = float(reach_mm[-1])
    cell = np.floor((points_mm - low) / bin_mm).astype(np.int64)
    nx, ny = (int(most) + 1 for most in cell.max(axis=0))
    number = cell[:, 1] * nx + cell[:, 0]
    order = np.argsort(number, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(number, minlength=nx * ny))])
    return _missed_kernel((places_mm - low) / bin_mm, (points_mm[order] - low) / bin_mm, starts, nx,
                          reach_mm / bin_mm)


@kernel
def _missed_kernel(
    places: FloatArray, points: FloatArray, starts: IntArray, nx: int, reach: FloatArray
) -> IntArray:
    """In bins; the longest reach is 1, so that it ends in a neighbour's bin."""
    ny = (len(starts) - 1) // nx
    missed = np.empty(len(places), np.int64)
    for n in range(len(places)):
        x, y = places[n, 0], places[n, 1]
        i, j = int(np.floor(x)), int(np.floor(y))
        least = np.inf
        for row in range(max(j - 1, 0), min(j + 2, ny)):
            first, last = max(i - 1, 0), min(i + 1, nx - 1)
            if first > last:
                continue
            for k in range(starts[row * nx + first], starts[row * nx + last + 1]):
                u, v = points[k, 0] - x, points[k, 1] - y
                least = min(least, u * u + v * v)
            if least <= reach[0] * reach[0]:
                break
        count = 0
        while count < len(reach) and least > reach[count] * reach[count]:
            count += 1
        missed[n] = count
    return missed
