"""Where two closed tracks lie side by side, so that bridges may join them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.section_raster import SectionRaster

#: Places on a track are at least so far apart, in pitches; short tracks have so many at least.
_SPACING, _LEAST_PLACES = 0.1, 80
#: Points are sorted into cells of this part of the longest bridge.
_CELL = 1 / 3


@dataclass(frozen=True)
class BridgePlaces:
    """(p,) each, for vertices of closed tracks that another closed track lies beside.

    vertex, other : int64, rows of all tracks' points: on a track, and nearest to that on another
    gap_mm : float64, distance of the two
    skew : float64, by what part two bridges there are longer than the gap that they span
    """

    vertex: IntArray
    other: IntArray
    gap_mm: FloatArray
    skew: FloatArray


def bridge_places(
    points_mm: FloatArray, starts: IntArray, closed: int, raster: SectionRaster,
    pitch_mm: float, longest_mm: float, least_depth_mm: float,
) -> BridgePlaces:
    """Places at which bridges no longer than `longest_mm` stay deep enough inside the outline.

    points_mm : (n, 2), of all tracks, the `closed` first ones closed; starts : (m + 1,) rows
    """
    found, gaps = _places_kernel(
        points_mm - np.array(raster.grid.origin_mm), np.asarray(starts, np.int64), closed,
        longest_mm, _SPACING * pitch_mm, _LEAST_PLACES, _CELL * longest_mm, raster.depth_mm,
        raster.grid.pitch_mm, least_depth_mm)
    return BridgePlaces(found[0], found[1], gaps[0], gaps[1])


@inner_kernel
def _beside(
    points: FloatArray, along: FloatArray, first: int, last: int, vertex: int, by: float
) -> tuple[float, float]:
    """The point of a closed track (rows first to last) that lies `by` farther along."""
    whole = along[last]
    at = along[vertex] + by
    k = vertex
    if at >= whole:
        at -= whole
        k = first
    elif at < 0.0:
        at += whole
        k = last - 1
    while k + 1 < last and along[k + 1] < at:
        k += 1
    while k > first and along[k] > at:
        k -= 1
    step = along[k + 1] - along[k]
    t = (at - along[k]) / step if step > 0.0 else 0.0
    return (points[k, 0] + t * (points[k + 1, 0] - points[k, 0]),
            points[k, 1] + t * (points[k + 1, 1] - points[k, 1]))


@inner_kernel
def _span(a: tuple[float, float], b: tuple[float, float]) -> float:
    return float(np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2))


@kernel
def _places_kernel(
    points: FloatArray, starts: IntArray, closed: int, reach: float, spacing: float,
    least_places: int, cell: float, depth: NDArray[np.float32], node: float, least_depth: float,
) -> tuple[IntArray, FloatArray]:
    """Rows `vertex` and `other`, and rows `gap` and `skew`; points from the raster's origin."""
    n = len(points)
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for k in range(n):
        low_x, high_x = min(low_x, points[k, 0]), max(high_x, points[k, 0])
        low_y, high_y = min(low_y, points[k, 1]), max(high_y, points[k, 1])
    nx, ny = int((high_x - low_x) / cell) + 1, int((high_y - low_y) / cell) + 1
    home = np.empty(n, np.int64)
    first = np.zeros(nx * ny + 1, np.int64)
    for k in range(n):
        home[k] = int((points[k, 1] - low_y) / cell) * nx + int((points[k, 0] - low_x) / cell)
        first[home[k] + 1] += 1
    for c in range(nx * ny):
        first[c + 1] += first[c]
    place = first.copy()
    row, owner = np.empty(n, np.int64), np.empty(n, np.int64)
    x, y = np.empty(n), np.empty(n)
    along = np.zeros(n)
    for track in range(len(starts) - 1):
        for k in range(starts[track], starts[track + 1]):
            e = place[home[k]]
            place[home[k]] += 1
            row[e], owner[e], x[e], y[e] = k, track, points[k, 0], points[k, 1]
            if k > starts[track]:
                along[k] = along[k - 1] + np.sqrt(
                    (points[k, 0] - points[k - 1, 0]) ** 2 + (points[k, 1] - points[k - 1, 1]) ** 2)
    rows = np.empty((2, n), np.int64)
    gaps = np.empty((2, n))
    count = 0
    for track in range(closed):
        begin, end = starts[track], starts[track + 1] - 1
        apart = min(spacing, along[end] / least_places)
        passed = -np.inf
        best = -1
        for k in range(begin, end):
            if along[k] - passed < apart:
                continue
            passed = along[k]
            px, py = points[k, 0], points[k, 1]
            least = reach * reach
            if best >= 0:  # what was nearest to the last place is not far from this one
                d2 = (x[best] - px) ** 2 + (y[best] - py) ** 2
                if d2 < least:
                    least = d2
                else:
                    best = -1
            away = np.sqrt(least)
            j0 = max(int((py - away - low_y) / cell), 0)
            j1 = min(int((py + away - low_y) / cell), ny - 1)
            i0 = max(int((px - away - low_x) / cell), 0)
            i1 = min(int((px + away - low_x) / cell), nx - 1)
            for jn in range(j0, j1 + 1):
                for e in range(first[jn * nx + i0], first[jn * nx + i1 + 1]):
                    if owner[e] == track:
                        continue
                    d2 = (x[e] - px) ** 2 + (y[e] - py) ** 2
                    if d2 < least or (d2 == least and best >= 0 and row[e] < row[best]):
                        least, best = d2, e
            if best < 0 or owner[best] >= closed:
                continue
            u, v = 0.5 * (px + x[best]) / node, 0.5 * (py + y[best]) / node
            im = min(max(int(u), 0), depth.shape[1] - 2)
            jn = min(max(int(v), 0), depth.shape[0] - 2)
            u, v = u - im, v - jn
            deep = ((1 - v) * ((1 - u) * depth[jn, im] + u * depth[jn, im + 1])
                    + v * ((1 - u) * depth[jn + 1, im] + u * depth[jn + 1, im + 1]))
            if deep <= least_depth:
                continue
            gap, other = np.sqrt(least), row[best]
            there, last = starts[owner[best]], starts[owner[best] + 1] - 1
            half = min(gap, along[end], along[last]) / 2
            a0 = _beside(points, along, begin, end, k, -half)
            a1 = _beside(points, along, begin, end, k, half)
            b0 = _beside(points, along, there, last, other, -half)
            b1 = _beside(points, along, there, last, other, half)
            total = min(_span(a0, b0) + _span(a1, b1), _span(a0, b1) + _span(a1, b0))
            rows[0, count], rows[1, count] = k, other
            gaps[0, count], gaps[1, count] = gap, total / max(2 * gap, 1e-9) - 1
            count += 1
    return rows[:, :count].copy(), gaps[:, :count].copy()
