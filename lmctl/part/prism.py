"""A polygon made solid along z: exact distance, and its own outline in every section."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.kernel import kernel
from lmctl.field.plane import PlaneGrid, loop_area_mm2, plane_distance
from lmctl.part.analytic import Analytic
from lmctl.part.bodies import nothing_of
from lmctl.part.measured import Bounds

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Prism(Analytic):
    """A polygon in the xy plane between two heights.

    loop_mm : (k, 2) float64, counter-clockwise, first point repeated last, not crossing itself
    """

    loop_mm: FloatArray
    low_mm: float
    high_mm: float

    @property
    def bounds_mm(self) -> Bounds:
        low, high = self.loop_mm.min(axis=0), self.loop_mm.max(axis=0)
        return np.array([*low, self.low_mm]), np.array([*high, self.high_mm])

    def at(self, points: FloatArray) -> FloatArray:
        """The nearest of the wall and the two lids; beyond both, of the rim between them."""
        across = _polygon_kernel(np.ascontiguousarray(points), self.loop_mm)
        along = np.minimum(points[:, 2] - self.low_mm, self.high_mm - points[:, 2])
        beyond = np.hypot(np.minimum(across, 0.0), np.minimum(along, 0.0))
        return np.where((across > 0) & (along > 0), np.minimum(across, along), -beyond)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else nothing_of(plane)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The polygon; at its lower face already, at its upper one no more."""
        return [self.loop_mm] if self.low_mm <= z_mm < self.high_mm else []


def closed_polygon(corners: FloatArray, name: str) -> FloatArray:
    """Corners (k, 2) as a loop that runs counter-clockwise and ends where it began.

    Raises InputError where it encloses nothing or crosses itself, with the place. name : of the
    body, for messages.
    """
    keep = np.any(corners != np.roll(corners, 1, axis=0), axis=1)
    corners = corners[keep]
    loop = np.vstack([corners, corners[:1]])
    first, second = _crossing_kernel(loop) if len(corners) > 2 else (-1, -1)
    if first >= 0:
        x, y = loop[first]
        raise InputError(
            f"the outline of {name} crosses itself",
            where=f"its edge from ({x:g}, {y:g}) meets the one from "
            f"({loop[second, 0]:g}, {loop[second, 1]:g})",
            hint="give the corners in the order they are met walking around",
        )
    if len(corners) < 3 or abs(loop_area_mm2(loop)) < 1e-9:
        raise InputError(f"the outline of {name} encloses nothing",
                         hint="give at least three corners that are not in one line")
    if loop_area_mm2(loop) < 0:
        loop = loop[::-1].copy()
    return np.ascontiguousarray(loop)


@kernel
def _polygon_kernel(points: FloatArray, loop: FloatArray) -> FloatArray:
    """Signed distance in the plane, positive inside by parity; z is not looked at."""
    result = np.empty(len(points))
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        least, inside = np.inf, False
        for e in range(len(loop) - 1):
            ax, ay, bx, by = loop[e, 0], loop[e, 1], loop[e + 1, 0], loop[e + 1, 1]
            ux, uy = bx - ax, by - ay
            t = ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)
            t = min(1.0, max(0.0, t))
            least = min(least, (x - ax - t * ux) ** 2 + (y - ay - t * uy) ** 2)
            if (ay > y) != (by > y) and ax + (y - ay) * ux / uy > x:
                inside = not inside
        result[n] = np.sqrt(least) if inside else -np.sqrt(least)
    return result


@kernel
def _crossing_kernel(loop: FloatArray) -> tuple[int, int]:
    """Two edges that cross or touch without being neighbours, or (−1, −1)."""
    count = len(loop) - 1
    for e in range(count):
        for f in range(e + 2, count):
            if e == 0 and f == count - 1:
                continue
            ax, ay, bx, by = loop[e, 0], loop[e, 1], loop[e + 1, 0], loop[e + 1, 1]
            cx, cy, dx, dy = loop[f, 0], loop[f, 1], loop[f + 1, 0], loop[f + 1, 1]
            if max(ax, bx) < min(cx, dx) or max(cx, dx) < min(ax, bx):
                continue
            c = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            d = (bx - ax) * (dy - ay) - (by - ay) * (dx - ax)
            a = (dx - cx) * (ay - cy) - (dy - cy) * (ax - cx)
            b = (dx - cx) * (by - cy) - (dy - cy) * (bx - cx)
            if c * d <= 0.0 and a * b <= 0.0 and max(ay, by) >= min(cy, dy) and (
                max(cy, dy) >= min(ay, by)
            ):
                return e, f
    return -1, -1
