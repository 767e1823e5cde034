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
    return np.asarray(_missed_kernel(places_mm, points_mm, reach_mm))


@kernel
def _missed_kernel(places: FloatArray, points: FloatArray, reach: FloatArray) -> IntArray:
    """Bins are as wide as the longest reach, so that it ends in a neighbour's bin."""
    side = reach[-1]
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for k in range(len(points)):
        low_x, high_x = min(low_x, points[k, 0]), max(high_x, points[k, 0])
        low_y, high_y = min(low_y, points[k, 1]), max(high_y, points[k, 1])
    nx, ny = int((high_x - low_x) / side) + 1, int((high_y - low_y) / side) + 1
    home = np.empty(len(points), np.int64)
    starts = np.zeros(nx * ny + 1, np.int64)
    for k in range(len(points)):
        home[k] = int((points[k, 1] - low_y) / side) * nx + int((points[k, 0] - low_x) / side)
        starts[home[k] + 1] += 1
    for cell in range(nx * ny):
        starts[cell + 1] += starts[cell]
    place = starts.copy()
    sorted_points = np.empty((len(points), 2))
    for k in range(len(points)):
        sorted_points[place[home[k]], 0] = points[k, 0]
        sorted_points[place[home[k]], 1] = points[k, 1]
        place[home[k]] += 1
    near = reach[0] * reach[0]
    missed = np.empty(len(places), np.int64)
    for n in range(len(places)):
        x, y = places[n, 0], places[n, 1]
        i, j = int(np.floor((x - low_x) / side)), int(np.floor((y - low_y) / side))
        least = np.inf
        for turn in range(9):  # its own bin first
            column = i + (turn + 1) % 3 - 1 if turn % 3 else i
            row = j + (turn // 3 + 1) % 3 - 1 if turn // 3 else j
            if column < 0 or row < 0 or column >= nx or row >= ny:
                continue
            for k in range(starts[row * nx + column], starts[row * nx + column + 1]):
                u, v = sorted_points[k, 0] - x, sorted_points[k, 1] - y
                least = min(least, u * u + v * v)
                if least <= near:
                    break
            if least <= near:
                break
        count = 0
        while count < len(reach) and least > reach[count] * reach[count]:
            count += 1
        missed[n] = count
    return missed
