"""One plane of a part: its outline, and the in-plane signed distance toolpaths are cut from.

The iso-levels of a 3D distance are not evenly spaced in a plane (sphere R 10 at z = 8: gaps of
1.88 and 4.12 where 1 is wanted), so the distance is swept again in the plane, from the outline.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import contourpy
import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.kernel import inner_kernel, kernel

SEED_PITCHES = 1.5  # nodes this near a segment are given their distance to it directly
SWEEP_ROUNDS = 2  # of the four orderings; the second corrects what the first decided too early


@dataclass(frozen=True)
class PlaneGrid:
    """A uniform grid of nodes in one plane.

    origin_mm : (x, y) of node [0, 0]
    pitch_mm : distance of neighbouring nodes, > 0
    shape : (ny, nx), number of nodes
    """

    origin_mm: tuple[float, float]
    pitch_mm: float
    shape: tuple[int, int]

    @property
    def x_mm(self) -> FloatArray:
        """(nx,) float64 [mm]"""
        return self.origin_mm[0] + self.pitch_mm * np.arange(self.shape[1], dtype=np.float64)

    @property
    def y_mm(self) -> FloatArray:
        """(ny,) float64 [mm]"""
        return self.origin_mm[1] + self.pitch_mm * np.arange(self.shape[0], dtype=np.float64)


def section_loops(
    values: NDArray[np.float32], grid: PlaneGrid, level: float = 0.0
) -> list[FloatArray]:
    """The outline of {values > level}: closed loops, the inside on the left.

    values : (ny, nx) float32, signed distance positive inside
    returns : loops (k, 2) float64 [mm], first point repeated last; outer loops run
        counter-clockwise, holes clockwise. Empty where nothing exceeds the level.
    raises : InputError where the inside reaches the edge of the grid, so that a loop would
        be left open, or where a value is not a number
    """
    return iso_loops(values, grid, [level])[0]


def iso_loops(
    distance: NDArray[np.float32], grid: PlaneGrid, levels: Iterable[float]
) -> list[list[FloatArray]]:
    """The loops of several levels, as `section_loops` gives them; one list a level.

    Loops are piecewise linear between grid lines; ones without area are left out.
    """
    levels = list(levels)
    _check_plane(distance, grid, min(levels, default=0.0))
    generator = contourpy.contour_generator(
        grid.x_mm, grid.y_mm, distance, name="serial", line_type=contourpy.LineType.Separate
    )
    return [_closed([np.asarray(line) for line in generator.lines(level)]) for level in levels]


def plane_distance(loops: Sequence[FloatArray], grid: PlaneGrid) -> NDArray[np.float32]:
    """Signed distance to closed loops in their plane, positive inside by the even-odd rule.

    Exact within 1.5 pitches of a loop; farther out every node takes the nearest of the segments
    its neighbours found, carried in four sweeping orderings, and follows the loop from there to
    where the distance is least.

    loops : (k, 2) float64 [mm] each, closed (first point repeated last)
    returns : (ny, nx) float32 [mm]; −inf everywhere where there are no loops
    """
    return nearest_segments(loops, grid)[0]


def nearest_segments(
    loops: Sequence[FloatArray], grid: PlaneGrid
) -> tuple[NDArray[np.float32], FloatArray, NDArray[np.int64], NDArray[np.int64]]:
    """`plane_distance`, the loops' segments, and which of these is nearest to each node.

    returns : (ny, nx) float32 [mm]; (m, 4) float64, x0 y0 x1 y1 from the grid's origin [mm];
        (m, 2) int64, the first and last segment of each one's loop; (ny, nx) int64, the segment
        nearest to each node, −1 where there are no loops
    """
    segments, ends = _segments(loops, grid)
    nearest = np.full(grid.shape, -1, dtype=np.int64)
    if len(segments) == 0:
        return np.full(grid.shape, -np.inf, dtype=np.float32), segments, ends, nearest
    distance = np.empty(grid.shape, dtype=np.float32)
    odd, squared = np.zeros(grid.shape, dtype=np.uint8), np.full(grid.shape, np.inf)
    _distance_kernel(segments, ends, grid.pitch_mm, nearest, squared, odd, distance)
    return distance, segments, ends, nearest


def loop_area_mm2(loop: FloatArray) -> float:
    """Signed area of a closed loop (k, 2) [mm]: positive where it runs counter-clockwise."""
    x, y = loop[:, 0] - loop[0, 0], loop[:, 1] - loop[0, 1]
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def _check_plane(values: NDArray[np.float32], grid: PlaneGrid, level: float) -> None:
    where = f"plane of {grid.shape[1]} x {grid.shape[0]} nodes, pitch {grid.pitch_mm:g} mm"
    if values.shape != grid.shape:
        raise ValueError(f"values of shape {values.shape} on a plane of shape {grid.shape}")
    if np.isnan(values).any():
        raise InputError("the distance in a section is not a number somewhere", where=where)
    edge = max(values[0].max(), values[-1].max(), values[:, 0].max(), values[:, -1].max())
    if edge > level:
        raise InputError(
            "the part reaches the edge of its grid, so its outline would be left open",
            where=where,
            hint="give the grid at least two nodes of padding around the part",
        )


def _closed(lines: list[FloatArray]) -> list[FloatArray]:
    """Drop repeated points (a level met exactly at a node gives them) and loops without area."""
    loops = []
    for line in lines:
        keep = np.ones(len(line), dtype=bool)
        keep[1:] = np.any(line[1:] != line[:-1], axis=1)
        loop = line[keep]
        if len(loop) >= 4 and loop_area_mm2(loop) != 0.0:
            loops.append(loop)
    return loops


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


@kernel
def _distance_kernel(
    segments: FloatArray, ends: NDArray[np.int64], pitch: float, nearest: NDArray[np.int64],
    squared: FloatArray, odd: NDArray[np.uint8], distance: NDArray[np.float32],
) -> None:
    """Seeds, parity and sweeps in one kernel: the planes are small, the calls are many."""
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
                    odd[j, max(i, 0)] ^= 1
    for _ in range(SWEEP_ROUNDS):
        for order in range(4):
            dj = 1 if order < 2 else -1
            di = 1 if order % 2 == 0 else -1
            for jj in range(ny):
                j = jj if dj > 0 else ny - 1 - jj
                for ii in range(nx):
                    i = ii if di > 0 else nx - 1 - ii
                    for side in range(4):
                        jn = j if side == 0 else j - dj
                        im = i + (side - 2) * di if side else i - di
                        if jn < 0 or jn >= ny or im < 0 or im >= nx:
                            continue
                        s = int(nearest[jn, im])
                        if s < 0 or s == nearest[j, i]:
                            continue
                        d2 = _to_segment_squared(segments, s, i * pitch, j * pitch)
                        if d2 < squared[j, i]:
                            squared[j, i] = d2
                            nearest[j, i] = s
    for j in range(ny):
        inside = 0
        for i in range(nx):
            inside ^= odd[j, i]
            least = squared[j, i]
            found = int(nearest[j, i])
            for step in (-1, 1):
                s = int(nearest[j, i])
                first, last = ends[s]
                while True:
                    s += step
                    s = last if s < first else (first if s > last else s)
                    d2 = _to_segment_squared(segments, s, i * pitch, j * pitch)
                    if d2 >= least:
                        break
                    least = d2
                    found = s
            nearest[j, i] = found
            d = np.sqrt(least)
            distance[j, i] = d if inside else -d
