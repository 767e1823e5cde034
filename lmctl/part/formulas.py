"""Bodies with a formula: everything about them is computed where and when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.field.grid import Window
from lmctl.field.plane import PlaneGrid, plane_distance, section_loops
from lmctl.field.primitives import box_distance, cylinder_distance, sphere_distance
from lmctl.part.bodies import Vector, nothing_of, plane_points
from lmctl.part.measured import Bounds

FloatArray = NDArray[np.float64]


class Analytic:
    """What bodies with a formula share: `at` gives all the rest."""

    def at(self, points: FloatArray) -> FloatArray:
        raise NotImplementedError

    def distance(self, window: Window) -> NDArray[np.float32]:
        return self.at(window.points()).astype(np.float32).reshape(window.shape)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return self.at(plane_points(plane, z_mm)).astype(np.float32).reshape(plane.shape)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return section_loops(self.cut(z_mm, plane), plane)


@dataclass(frozen=True)
class Sphere(Analytic):
    """A ball."""

    centre_mm: Vector
    radius_mm: float

    @property
    def bounds_mm(self) -> Bounds:
        centre = np.array(self.centre_mm)
        return centre - self.radius_mm, centre + self.radius_mm

    @property
    def largest_depth_mm(self) -> float:
        return self.radius_mm

    def at(self, points: FloatArray) -> FloatArray:
        return sphere_distance(points, self.centre_mm, self.radius_mm)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """The distance to the circle in the plane: near a pole the ball's own is too flat."""
        height = abs(z_mm - self.centre_mm[2])
        if height >= self.radius_mm:
            return nothing_of(plane)
        x, y = plane.x_mm - self.centre_mm[0], plane.y_mm - self.centre_mm[1]
        circle = float(np.sqrt(self.radius_mm**2 - height**2))
        return (circle - np.hypot(x[None, :], y[:, None])).astype(np.float32)


@dataclass(frozen=True)
class Box(Analytic):
    """The box between two opposite corners, along the axes."""

    low_mm: Vector
    high_mm: Vector

    @property
    def bounds_mm(self) -> Bounds:
        return np.array(self.low_mm), np.array(self.high_mm)

    @property
    def largest_depth_mm(self) -> float:
        return 0.5 * min(b - a for a, b in zip(self.low_mm, self.high_mm, strict=True))

    def at(self, points: FloatArray) -> FloatArray:
        return box_distance(points, self.low_mm, self.high_mm)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else nothing_of(plane)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The rectangle itself; at its lower face already, at its upper one no more."""
        if not self.low_mm[2] <= z_mm < self.high_mm[2]:
            return []
        (x0, y0, _), (x1, y1, _) = self.low_mm, self.high_mm
        return [np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])]


@dataclass(frozen=True)
class Cylinder(Analytic):
    """A round bar between the centres of its end faces."""

    base_mm: Vector
    top_mm: Vector
    radius_mm: float

    @property
    def bounds_mm(self) -> Bounds:
        base, top = np.array(self.base_mm), np.array(self.top_mm)
        along = (top - base) / np.linalg.norm(top - base)
        reach = self.radius_mm * np.sqrt(np.maximum(0.0, 1.0 - along**2))
        return np.minimum(base, top) - reach, np.maximum(base, top) + reach

    @property
    def largest_depth_mm(self) -> float:
        length = float(np.linalg.norm(np.subtract(self.top_mm, self.base_mm)))
        return min(self.radius_mm, 0.5 * length)

    def at(self, points: FloatArray) -> FloatArray:
        return cylinder_distance(points, self.base_mm, self.top_mm, self.radius_mm)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """Standing upright, the distance to its circle; else its own, which is zero there too."""
        (x0, y0, z0), (x1, y1, z1) = self.base_mm, self.top_mm
        if (x0, y0) != (x1, y1):
            return Analytic.cut(self, z_mm, plane)
        if not min(z0, z1) <= z_mm < max(z0, z1):
            return nothing_of(plane)
        x, y = plane.x_mm - x0, plane.y_mm - y0
        return (self.radius_mm - np.hypot(x[None, :], y[:, None])).astype(np.float32)
