"""In-plane distance to an outline at the nodes of a grid, by carrying segments to neighbours.

The iso-levels of a 3D distance are not evenly spaced in a plane (sphere R 10 at z = 8: gaps of
1.88 and 4.12 where 1 is wanted), so the distance is swept again in the plane, from the outline.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.field.plane import PlaneGrid

SEED_PITCHES = 1.5  # nodes this near a segment are given their distance to it directly
OUTSIDE, INSIDE, EVERYWHERE = 0, 1, 2  # which nodes take segments from their neighbours


def plane_distance(loops: Sequence[FloatArray], grid: PlaneGrid) -> NDArray[np.float32]:
    """Signed distance to closed loops in their plane, positive inside by the even-odd rule.

    Exact within 1.5 pitches of a loop; farther out every node takes the nearest of the segments
    its eight neighbours found, carried down and up the plane, and follows the loop from there to
    where the distance is least.

    loops : (k, 2) float64 [mm] each, closed (first point repeated last)
    returns : (ny, nx) float32 [mm]; −inf everywhere where there are no loops
    """
    return nearest_segments(loops, grid)[0]


def nearest_segments(
    loops: Sequence[FloatArray], grid: PlaneGrid, *, inside_only: bool = False
) -> tuple[NDArray[np.float32], FloatArray, NDArray[np.int64], NDArray[np.int32]]:
    """`plane_distance`, the loops' segments, and which of these is nearest to each node.

    inside_only : nodes outside, farther than 1.5 pitches from a loop, are left at that distance
        and without a segment; the ways from nodes inside to the outline never cross them
    returns : (ny, nx) float32 [mm]; (m, 4) float64, x0 y0 x1 y1 from the grid's origin [mm];
        (m, 2) int64, the first and last segment of each one's loop; (ny, nx) int32, the segment
        nearest to each node, −1 where there is none
    """
    segments, ends = _segments(loops, grid)
    nearest = np.full(grid.shape, -1, dtype=np.int32)
    if len(segments) == 0:
        return np.full(grid.shape, -np.inf, dtype=np.float32), segments, ends, nearest
    distance = np.empty(grid.shape, dtype=np.float32)
    inside, squared = np.zeros(grid.shape, dtype=np.uint8), np.full(grid.shape, np.inf)
    _distance_kernel(
        segments, ends, grid.pitch_mm, INSIDE if inside_only else EVERYWHERE, nearest, squared,
        inside, distance)
    return distance, segments, ends, nearest


def distance_outside(
    loops: Sequence[FloatArray], grid: PlaneGrid, wanted: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """How far outside closed loops nodes lie, exactly as `plane_distance`; only where wanted.

    wanted : (ny, nx) bool
    returns : (ny, nx) float32 [mm]: 0 inside and where not wanted; inf where there are no loops
    """
    segments, ends = _segments(loops, grid)
    if len(segments) == 0:
        return np.where(wanted, np.float32(np.inf), np.float32(0))
    distance = np.empty(grid.shape, dtype=np.float32)
    _outside_kernel(
        segments, ends, grid.pitch_mm, wanted, np.full(grid.shape, -1, dtype=np.int32),
        np.full(grid.shape, np.inf), np.zeros(grid.shape, dtype=np.uint8), distance)
    return distance


def _segments(
    loops: Sequence[FloatArray], grid: PlaneGrid
) -> tuple[FloatArray, NDArray[np.int64]]:
    """(m, 4) [mm] x0 y0 x1 y1 from the grid's origin; (m, 2) first and last of each one's loop."""
    pieces, ends, count = [np.empty((0, 4))], [np.empty((0, 2), dtype=np.int64)], 0
    ox, oy = grid.origin_mm
    for loop in loops:
        points = np.asarray(loop, dtype=np.float64)
        if len(points) < 4 or not np.array_equal(points[0], points[-1]):
            raise ValueError("a loop needs three corners and its first point repeated last")
        pieces.append(np.hstack([points[:-1], points[1:]]) - np.array([ox, oy, ox, oy]))
        last = count + len(points) - 2
        ends.append(np.tile(np.array([count, last], dtype=np.int64), (len(points) - 1, 1)))
        count = last + 1
    return np.ascontiguousarray(np.vstack(pieces)), np.ascontiguousarray(np.vstack(ends))


@inner_kernel
def _to_segment_squared(segments: FloatArray, s: int, px: float, py: float) -> float:
    ax, ay = segments[s, 0], segments[s, 1]
    ux, uy = segments[s, 2] - ax, segments[s, 3] - ay
    wx, wy = px - ax, py - ay
    length = ux * ux + uy * uy
    t = 0.0
    if length > 0.0:
        t = min(1.0, max(0.0, (wx * ux + wy * uy) / length))
    dx, dy = wx - t * ux, wy - t * uy
    return float(dx * dx + dy * dy)


@inner_kernel
def _seed(
    segments: FloatArray, pitch: float, nearest: NDArray[np.int32], squared: FloatArray,
    inside: NDArray[np.uint8],
) -> None:
    """Nodes near segments get their distances; every node, whether it lies inside."""
    ny, nx = nearest.shape
    band = SEED_PITCHES * pitch
    for s in range(segments.shape[0]):
        x0, y0, x1, y1 = segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
        j0 = max(0, int(np.ceil((min(y0, y1) - band) / pitch)))
        j1 = min(ny - 1, int(np.floor((max(y0, y1) + band) / pitch)))
        slope = 0.0 if y1 == y0 else (x1 - x0) / (y1 - y0)
        for j in range(j0, j1 + 1):
            y = j * pitch
            # The part of the segment that can be within the band of this row bounds the nodes.
            xa, xb = min(x0, x1), max(x0, x1)
            if abs(y1 - y0) > pitch:
                ya = min(max(y - band, min(y0, y1)), max(y0, y1))
                yb = min(max(y + band, min(y0, y1)), max(y0, y1))
                xa = min(x0 + (ya - y0) * slope, x0 + (yb - y0) * slope)
                xb = max(x0 + (ya - y0) * slope, x0 + (yb - y0) * slope)
            i0 = max(0, int(np.ceil((xa - band) / pitch)))
            i1 = min(nx - 1, int(np.floor((xb + band) / pitch)))
            for i in range(i0, i1 + 1):
                d2 = _to_segment_squared(segments, s, i * pitch, y)
                if d2 < squared[j, i]:
                    squared[j, i] = d2
                    nearest[j, i] = s
            # Half-open in y: a corner belongs to one of its two segments.
            if (y0 > y) != (y1 > y):
                i = int(np.floor((x0 + (y - y0) * slope) / pitch)) + 1
                if i < nx:
                    inside[j, max(i, 0)] ^= 1
    for j in range(ny):
        for i in range(1, nx):
            inside[j, i] ^= inside[j, i - 1]


@inner_kernel
def _sweep(
    segments: FloatArray, pitch: float, nearest: NDArray[np.int32], squared: FloatArray,
    inside: NDArray[np.uint8], side: int,
) -> None:
    """Nodes of one side, or all, take segments from their neighbours."""
    ny, nx = nearest.shape
    for turn in range(2):  # down the plane and up
        dj = 1 if turn == 0 else -1
        for jj in range(ny):
            j = jj if dj > 0 else ny - 1 - jj
            for way in range(2):  # forwards from the row before, then backwards along the row
                di = 1 if way == 0 else -1
                for ii in range(nx):
                    i = ii if way == 0 else nx - 1 - ii
                    if side != EVERYWHERE and inside[j, i] != side:
                        continue
                    own, least = nearest[j, i], squared[j, i]
                    for beside in range(4 if way == 0 else 1):
                        jn = j if beside == 0 else j - dj
                        im = i - di if beside == 0 else i + beside - 2
                        if jn < 0 or jn >= ny or im < 0 or im >= nx:
                            continue
                        s = nearest[jn, im]
                        if s < 0 or s == own:
                            continue
                        d2 = _to_segment_squared(segments, s, i * pitch, j * pitch)
                        if d2 < least:
                            own, least = s, d2
                            nearest[j, i], squared[j, i] = s, d2


@inner_kernel
def _followed(
    segments: FloatArray, ends: NDArray[np.int64], s: int, x: float, y: float, least: float
) -> tuple[int, float]:
    """The segment of the same loop where the distance is least, from segment s, and its square."""
    found = s
    first, last = ends[s, 0], ends[s, 1]
    for step in (-1, 1):
        at = s
        while True:
            at += step
            at = last if at < first else (first if at > last else at)
            d2 = _to_segment_squared(segments, at, x, y)
            if d2 >= least:
                break
            least = d2
            found = at
    return found, least


@kernel
def _distance_kernel(
    segments: FloatArray, ends: NDArray[np.int64], pitch: float, side: int,
    nearest: NDArray[np.int32], squared: FloatArray, inside: NDArray[np.uint8],
    distance: NDArray[np.float32],
) -> None:
    """Seeds, parity and sweeps in one kernel: the planes are small, the calls are many."""
    ny, nx = nearest.shape
    _seed(segments, pitch, nearest, squared, inside)
    _sweep(segments, pitch, nearest, squared, inside, side)
    for j in range(ny):
        for i in range(nx):
            if nearest[j, i] < 0:
                distance[j, i] = -SEED_PITCHES * pitch
                continue
            least = squared[j, i]
            if side == EVERYWHERE or inside[j, i] == side:
                found, least = _followed(
                    segments, ends, nearest[j, i], i * pitch, j * pitch, least)
                nearest[j, i] = found
            d = np.sqrt(least)
            distance[j, i] = d if inside[j, i] else -d


@kernel
def _outside_kernel(
    segments: FloatArray, ends: NDArray[np.int64], pitch: float, wanted: NDArray[np.bool_],
    nearest: NDArray[np.int32], squared: FloatArray, inside: NDArray[np.uint8],
    distance: NDArray[np.float32],
) -> None:
    """Distances of the wanted nodes that lie outside; sweeps only where one is not near."""
    ny, nx = nearest.shape
    _seed(segments, pitch, nearest, squared, inside)
    all_near = True
    for j in range(ny):
        for i in range(nx):
            if wanted[j, i] and not inside[j, i] and nearest[j, i] < 0:
                all_near = False
    if not all_near:
        _sweep(segments, pitch, nearest, squared, inside, OUTSIDE)
    for j in range(ny):
        for i in range(nx):
            distance[j, i] = 0.0
            if wanted[j, i] and not inside[j, i]:
                _, least = _followed(
                    segments, ends, nearest[j, i], i * pitch, j * pitch, squared[j, i])
                distance[j, i] = np.sqrt(least)
