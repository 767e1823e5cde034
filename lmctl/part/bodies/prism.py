"""A polygon made solid along z: exact distance, and its own outline in every section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.kernel import kernel
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid, loop_area_mm2
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import empty_section
from lmctl.part.bodies.depth import unit_rows
from lmctl.part.bodies.formulas import ON_SURFACE_MM
from lmctl.part.bodies.half_space import half_space_behind
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface

#: Polygons of more sides are taken for one surface, not for as many planes.
MAX_WALLS = 100


@dataclass(frozen=True, eq=False)
class Prism(AnalyticBody):
    """A polygon in the xy plane between two heights.

    loop_mm : (k, 2) float64, counter-clockwise, first point repeated last, not crossing itself
    """

    loop_mm: FloatArray
    low_mm: float
    high_mm: float

    @property
    def tight_bounds_mm(self) -> Bounds:
        low, high = self.loop_mm.min(axis=0), self.loop_mm.max(axis=0)
        return np.array([*low, self.low_mm]), np.array([*high, self.high_mm])

    def support_mm(self, direction: FloatArray) -> float:
        return float((self.loop_mm @ direction[:2]).max()
                     + max(self.low_mm * direction[2], self.high_mm * direction[2]))

    def distance_at(self, points: FloatArray) -> FloatArray:
        """The nearest of the wall and the two lids; beyond both, of the rim between them."""
        across = _polygon_kernel(np.ascontiguousarray(points), self.loop_mm)[:, 0]
        along = np.minimum(points[:, 2] - self.low_mm, self.high_mm - points[:, 2])
        beyond = np.hypot(np.minimum(across, 0.0), np.minimum(along, 0.0))
        return np.where((across > 0) & (along > 0), np.minimum(across, along), -beyond)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        found = _polygon_kernel(np.ascontiguousarray(points), self.loop_mm)
        up, down = points[:, 2] - self.low_mm, self.high_mm - points[:, 2]
        across, along = found[:, 0], np.minimum(up, down)
        inside = (across > 0) & (along > 0)
        # Inside by the nearer of the two; outside by what is left towards each.
        wall = np.where(inside, across < along, np.maximum(-across, 0.0))
        lid = np.where(inside, across >= along, np.maximum(-along, 0.0))
        on_rim = (wall == 0) & (lid == 0)
        wall, lid = np.where(on_rim, across <= along, wall), np.where(on_rim, across > along, lid)
        direction = np.empty((len(points), 3))
        direction[:, :2] = wall[:, None] * found[:, 1:]
        direction[:, 2] = lid * np.where(up < down, 1.0, -1.0)
        return unit_rows(direction)

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """The planes of its lids, and of its walls or, of many, the column they make."""
        x, y = (float(v) for v in self.loop_mm[0])
        lids = half_space_behind((x, y, self.low_mm),
                                 (0, 0, -1)), half_space_behind((x, y, self.high_mm), (0, 0, 1))
        walls: tuple[Surface, ...] = (PolygonWall(self.loop_mm),)
        if len(self.loop_mm) <= MAX_WALLS:
            walls = tuple(
                half_space_behind((ax, ay, self.low_mm), (by - ay, ax - bx, 0))
                for (ax, ay), (bx, by) in pairwise(self.loop_mm)
            )
        return tuple((surface, 1) for surface in (*lids, *walls))

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.outline_loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else empty_section(plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The polygon; its lower face is included, its upper face is not."""
        return [self.loop_mm] if self.low_mm <= z_mm < self.high_mm else []


@dataclass(frozen=True, eq=False)
class PolygonWall:
    """A polygon's wall without end along z. loop_mm : as `Prism` has it"""

    loop_mm: FloatArray

    surface_tolerance_mm = 0.0
    gradient_leads_to_closest_point = False

    def distance_at(self, points: FloatArray) -> FloatArray:
        return np.asarray(_polygon_kernel(np.ascontiguousarray(points), self.loop_mm)[:, 0])

    def inward_directions(self, points: FloatArray) -> FloatArray:
        found = _polygon_kernel(np.ascontiguousarray(points), self.loop_mm)
        return np.column_stack([found[:, 1:], np.zeros(len(points))])


def close_polygon(corners: FloatArray, name: str) -> FloatArray:
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
    """(n, 3): signed distance in the plane, positive inside by parity, and the unit direction
    inwards in x and y; z is ignored."""
    result = np.empty((len(points), 3))
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        least, inside, best, share = np.inf, False, 0, 0.0
        for e in range(len(loop) - 1):
            ax, ay, bx, by = loop[e, 0], loop[e, 1], loop[e + 1, 0], loop[e + 1, 1]
            ux, uy = bx - ax, by - ay
            t = ((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy)
            t = min(1.0, max(0.0, t))
            d2 = (x - ax - t * ux) ** 2 + (y - ay - t * uy) ** 2
            if d2 < least:
                least, best, share = d2, e, t
            if (ay > y) != (by > y) and ax + (y - ay) * ux / uy > x:
                inside = not inside
        away = np.sqrt(least)
        sign = 1.0 if inside else -1.0
        ux, uy = loop[best + 1, 0] - loop[best, 0], loop[best + 1, 1] - loop[best, 1]
        if (share == 0.0 or share == 1.0) and away > ON_SURFACE_MM:
            wx = sign * (x - loop[best, 0] - share * ux) / away
            wy = sign * (y - loop[best, 1] - share * uy) / away
        else:
            size = np.sqrt(ux * ux + uy * uy)
            wx, wy = -uy / size, ux / size
        result[n, 0], result[n, 1], result[n, 2] = sign * away, wx, wy
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
