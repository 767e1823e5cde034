"""Restore sharp corners of contours where the raster has cut them off.

Between nodes on either side of a ridge of the depth a contour is interpolated across the kink, so
that it cuts the corner by about a node. There its two sides are drawn on until they meet.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel
from lmctl.plan.geometry.medial_axis import closest_point_on_segment

#: Sides that differ by less than 20° in direction count as no corner.
_STRAIGHT = np.cos(np.radians(20.0))
#: How far a corner may lie from what it replaces, in nodes.
_REACH_NODES = 4.0


@inner_kernel
def with_sharp_corners(
    closed: FloatArray, segments: FloatArray, nearest: NDArray[np.int32], node: float,
    at_edge: NDArray[np.int32], is_central: NDArray[np.bool_],
) -> FloatArray:
    """A closed contour (k, 2) of the raster, with its corners on the medial axis.

    Points from the raster's origin [mm], the first repeated last
    """
    points = closed[:-1]
    n = len(points)
    ny, nx = nearest.shape
    kink = np.zeros(n, np.bool_)
    for k in range(n):
        u, v = points[k, 0] / node, points[k, 1] / node
        i, j = int(np.floor(u + 1e-6)), int(np.floor(v + 1e-6))
        if i < 0 or j < 0 or i >= nx or j >= ny:
            continue
        along_x = abs(v - np.round(v)) <= abs(u - np.round(u))
        if along_x:
            j = int(np.round(v))
        else:
            i = int(np.round(u))
        point = at_edge[0 if along_x else 1, min(j, ny - 1), min(i, nx - 1)]
        kink[k] = point >= 0 and not is_central[point]
    result = np.empty((2 * n + 1, 2))
    count = 0
    first = 0
    while first < n and kink[first]:
        first += 1
    if first == n:
        return closed
    k = 0
    while k < n:
        here = (first + k) % n
        if not kink[here]:
            result[count, 0], result[count, 1] = points[here, 0], points[here, 1]
            count += 1
            k += 1
            continue
        length = 0
        while kink[(here + length) % n]:
            length += 1
        before, after = points[(here - 1) % n], points[(here + length) % n]
        ax, ay = _inward(segments, nearest, node, before)
        bx, by = _inward(segments, nearest, node, after)
        cross = ax * by - ay * bx
        replaced = False
        if ax * bx + ay * by < _STRAIGHT and abs(cross) > 1e-6 and length <= 4:
            # on both lines: (x − before) · a = 0 and (x − after) · b = 0
            p = before[0] * ax + before[1] * ay
            q = after[0] * bx + after[1] * by
            x, y = (p * by - q * ay) / cross, (q * ax - p * bx) / cross
            middle = points[(here + length // 2) % n]
            if np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2) <= _REACH_NODES * node:
                result[count, 0], result[count, 1] = x, y
                count += 1
                replaced = True
        if not replaced:
            for m in range(length):
                of = (here + m) % n
                result[count, 0], result[count, 1] = points[of, 0], points[of, 1]
                count += 1
        k += length
    if count < 3:
        return closed
    result[count, 0], result[count, 1] = result[0, 0], result[0, 1]
    return result[: count + 1]


@inner_kernel
def _inward(
    segments: FloatArray, nearest: NDArray[np.int32], node: float, point: FloatArray
) -> tuple[float, float]:
    """Direction from the outline to a point: from the edge nearest to the nearest node."""
    i, j = int(np.round(point[0] / node)), int(np.round(point[1] / node))
    i, j = min(max(i, 0), nearest.shape[1] - 1), min(max(j, 0), nearest.shape[0] - 1)
    x, y, away = closest_point_on_segment(segments, nearest[j, i], point[0], point[1])
    if away <= 1e-12:
        return 0.0, 0.0
    return (point[0] - x) / away, (point[1] - y) / away
