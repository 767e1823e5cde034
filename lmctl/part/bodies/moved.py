"""A body scaled, turned and moved: asked in its own coordinates, answered in the part's."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.field.features import unit_vector
from lmctl.field.plane import PlaneGrid, plane_distance
from lmctl.part.bodies.analytic import Analytic
from lmctl.part.bodies.body import Body, nothing_of
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """x ↦ scale · turn · x + shift. turn : (3, 3) float64, a rotation; shift_mm : (3,) float64"""

    scale: float
    turn: FloatArray
    shift_mm: FloatArray

    def there(self, points: FloatArray) -> FloatArray:
        """(n, 3) [mm] of the body -> of the part"""
        return self.scale * points @ self.turn.T + self.shift_mm

    def back(self, points: FloatArray) -> FloatArray:
        """(n, 3) [mm] of the part -> of the body"""
        return (points - self.shift_mm) @ self.turn / self.scale


def motion(
    scale: float, axis: Sequence[float], degrees: float, through_mm: Sequence[float],
    by_mm: Sequence[float],
) -> Motion:
    """Scaled about the origin, then turned about an axis through a point, then moved."""
    turn = _rotation(unit_vector(axis), np.deg2rad(degrees))
    through = np.asarray(through_mm, dtype=np.float64)
    return Motion(scale, turn, through - turn @ through + np.asarray(by_mm, dtype=np.float64))


def _rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rodrigues' formula; quarter turns are exact, so that upright walls stay upright."""
    c, s = np.cos(angle), np.sin(angle)
    c, s = (float(np.rint(v)) if abs(v - np.rint(v)) < 1e-15 else float(v) for v in (c, s))
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: FloatArray = c * np.eye(3) + s * cross + (1 - c) * np.outer(axis, axis)
    return turn


@dataclass(frozen=True, eq=False)
class Moved(Analytic):
    """A body carried elsewhere. Distances scale with it, so they stay true."""

    body: Body
    motion: Motion

    @property
    def key(self) -> Hashable:
        motion = self.motion
        return (Moved, self.body.key, motion.scale, motion.turn.tobytes(),
                motion.shift_mm.tobytes())

    @property
    def slack_mm(self) -> float:
        return self.motion.scale * self.body.slack_mm

    @property
    def one_foot(self) -> bool:
        return self.body.one_foot

    @property
    def exact_bound(self) -> bool:
        return self.body.exact_bound

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return tuple(
            (Carried(surface, self.motion), sign) for surface, sign in self.body.surfaces)

    @cached_property
    def rest(self) -> Surface | None:
        rest = self.body.rest
        return None if rest is None else Carried(rest, self.motion)

    @property
    def box_mm(self) -> Bounds:
        return self._around(*self.body.box_mm)

    @cached_property
    def bounds_mm(self) -> Bounds:
        low, high = self.body.bounds_mm
        if not np.isfinite([*low, *high]).all():
            return self._around(low, high)
        reach = [[self.reach_mm(sign * way) for way in np.eye(3)] for sign in (-1.0, 1.0)]
        return -np.array(reach[0]), np.array(reach[1])

    def reach_mm(self, way: FloatArray) -> float:
        along = self.body.reach_mm(way @ self.motion.turn)
        return self.motion.scale * along + float(self.motion.shift_mm @ way)

    def _around(self, low: FloatArray, high: FloatArray) -> Bounds:
        if not np.isfinite([*low, *high]).all():
            return np.full(3, -np.inf), np.full(3, np.inf)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        centre = self.motion.there(middle[None])[0]
        reach = self.motion.scale * np.abs(self.motion.turn) @ half
        return centre - reach, centre + reach

    @property
    def largest_depth_mm(self) -> float:
        return self.motion.scale * self.body.largest_depth_mm

    def at(self, points: FloatArray) -> FloatArray:
        return self.motion.scale * self.body.at(self.motion.back(points))

    def bound(self, points: FloatArray) -> FloatArray:
        return self.motion.scale * self.body.bound(self.motion.back(points))

    def feet(self, points: FloatArray) -> FloatArray:
        return self.motion.there(self.body.feet(self.motion.back(points)))

    def inward(self, points: FloatArray) -> FloatArray:
        return self.body.inward(self.motion.back(points)) @ self.motion.turn.T

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        if not self._upright:
            return Analytic.cut(self, z_mm, plane)
        loops = self.loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else nothing_of(plane)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """Where its z axis still points up, its own outline moved; else read off its distance."""
        low, high = self.body.bounds_mm
        if not (self._upright and np.isfinite([*low, *high]).all()):
            return Analytic.loops(self, z_mm, plane)
        own_z_mm = (z_mm - self.motion.shift_mm[2]) / self.motion.scale
        loops = self.body.loops(own_z_mm, plane_over(low, high, plane.pitch_mm / self.motion.scale))
        return [
            self.motion.there(np.column_stack([loop, np.full(len(loop), own_z_mm)]))[:, :2]
            for loop in loops
        ]

    @property
    def _upright(self) -> bool:
        return bool(np.allclose(self.motion.turn[2], (0.0, 0.0, 1.0), atol=1e-12))


@dataclass(frozen=True, eq=False)
class Carried:
    """A surface carried elsewhere."""

    surface: Surface
    motion: Motion

    @property
    def slack_mm(self) -> float:
        return self.motion.scale * self.surface.slack_mm

    @property
    def one_foot(self) -> bool:
        return self.surface.one_foot

    def at(self, points: FloatArray) -> FloatArray:
        return self.motion.scale * self.surface.at(self.motion.back(points))

    def inward(self, points: FloatArray) -> FloatArray:
        return self.surface.inward(self.motion.back(points)) @ self.motion.turn.T


def plane_over(low: FloatArray, high: FloatArray, pitch_mm: float) -> PlaneGrid:
    """The nodes of a plane that hold the box [low, high] with two to spare on each side."""
    first = np.floor(low[:2] / pitch_mm).astype(int) - 2
    last = np.ceil(high[:2] / pitch_mm).astype(int) + 2
    nx, ny = (int(n) for n in last - first + 1)
    return PlaneGrid((float(first[0] * pitch_mm), float(first[1] * pitch_mm)), pitch_mm, (ny, nx))
