"""Bodies with a formula: exact distances, and outlines by their own shape where they stand upright.

An outline read off a 3D distance is too flat near a pole or a lid; the shape's own in-plane
distance is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.field.features import unit_vector
from lmctl.field.plane import PlaneGrid, plane_distance
from lmctl.field.primitives import (
    box_distance,
    cone_distance,
    cylinder_distance,
    half_space_distance,
    sphere_distance,
    torus_distance,
)
from lmctl.part.analytic import Analytic
from lmctl.part.bodies import Vector, nothing_of
from lmctl.part.measured import Bounds

FloatArray = NDArray[np.float64]


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
        circle = float(np.sqrt(self.radius_mm**2 - height**2))
        return (circle - _radii(plane, self.centre_mm)).astype(np.float32)


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
class Cone(Analytic):
    """A round bar between the centres of its end faces, each with its own radius."""

    base_mm: Vector
    top_mm: Vector
    base_radius_mm: float
    top_radius_mm: float

    @property
    def bounds_mm(self) -> Bounds:
        base, top = np.array(self.base_mm), np.array(self.top_mm)
        along = (top - base) / np.linalg.norm(top - base)
        reach = np.sqrt(np.maximum(0.0, 1.0 - along**2))
        below, above = self.base_radius_mm * reach, self.top_radius_mm * reach
        return np.minimum(base - below, top - above), np.maximum(base + below, top + above)

    def at(self, points: FloatArray) -> FloatArray:
        return cone_distance(
            points, self.base_mm, self.top_mm, self.base_radius_mm, self.top_radius_mm
        )

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """Standing upright, the distance to its circle; else its own, which is zero there too."""
        (x0, y0, z0), (x1, y1, z1) = self.base_mm, self.top_mm
        if (x0, y0) != (x1, y1):
            return Analytic.cut(self, z_mm, plane)
        if not min(z0, z1) <= z_mm < max(z0, z1):
            return nothing_of(plane)
        share = (z_mm - z0) / (z1 - z0)
        radius = self.base_radius_mm + share * (self.top_radius_mm - self.base_radius_mm)
        return (radius - _radii(plane, self.base_mm)).astype(np.float32)


class Cylinder(Cone):
    """A round bar between the centres of its end faces."""

    def __init__(self, base_mm: Vector, top_mm: Vector, radius_mm: float) -> None:
        super().__init__(base_mm, top_mm, radius_mm, radius_mm)

    @property
    def largest_depth_mm(self) -> float:
        length = float(np.linalg.norm(np.subtract(self.top_mm, self.base_mm)))
        return min(self.base_radius_mm, 0.5 * length)

    def at(self, points: FloatArray) -> FloatArray:
        return cylinder_distance(points, self.base_mm, self.top_mm, self.base_radius_mm)


@dataclass(frozen=True)
class Torus(Analytic):
    """A ring of round section around an axis (of any length but 0)."""

    centre_mm: Vector
    axis: Vector
    radius_mm: float
    tube_radius_mm: float

    @property
    def bounds_mm(self) -> Bounds:
        along = unit_vector(self.axis)
        reach = self.radius_mm * np.sqrt(np.maximum(0.0, 1.0 - along**2)) + self.tube_radius_mm
        centre = np.array(self.centre_mm)
        return centre - reach, centre + reach

    @property
    def largest_depth_mm(self) -> float:
        return self.tube_radius_mm

    def at(self, points: FloatArray) -> FloatArray:
        return torus_distance(
            points, self.centre_mm, self.axis, self.radius_mm, self.tube_radius_mm
        )

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """Lying flat, the distance to its two circles; else its own, which is zero there too."""
        if self.axis[:2] != (0.0, 0.0):
            return Analytic.cut(self, z_mm, plane)
        height = abs(z_mm - self.centre_mm[2])
        if height >= self.tube_radius_mm:
            return nothing_of(plane)
        half = float(np.sqrt(self.tube_radius_mm**2 - height**2))
        return (half - np.abs(_radii(plane, self.centre_mm) - self.radius_mm)).astype(np.float32)


@dataclass(frozen=True)
class HalfSpace(Analytic):
    """Everything behind a plane; `outward` (of any length but 0) is the way out of it."""

    point_mm: Vector
    outward: Vector

    @property
    def bounds_mm(self) -> Bounds:
        """Infinite, but for a plane across an axis on the side it closes."""
        along = unit_vector(self.outward)
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
        for axis in range(3):
            if along[axis] == 1.0:
                high[axis] = self.point_mm[axis]
            elif along[axis] == -1.0:
                low[axis] = self.point_mm[axis]
        return low, high

    @property
    def largest_depth_mm(self) -> float:
        return float("inf")

    def at(self, points: FloatArray) -> FloatArray:
        return half_space_distance(points, self.point_mm, self.outward)


def _radii(plane: PlaneGrid, centre_mm: Vector) -> FloatArray:
    """Distance of each node of a plane from a point in it, (ny, nx) float64 [mm]."""
    x, y = plane.x_mm - centre_mm[0], plane.y_mm - centre_mm[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]))
