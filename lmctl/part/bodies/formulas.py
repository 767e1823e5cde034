"""Bodies with a formula: exact distances, and exact outlines where their axis is vertical.

An outline read off a 3D distance is too flat near a pole or a lid; the shape's own in-plane
distance is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.features import unit_vector
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.field.primitives import (
    box_distance,
    cone_distance,
    cylinder_distance,
    sphere_distance,
    torus_distance,
)
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import empty_section
from lmctl.part.bodies.depth import unit_rows
from lmctl.part.bodies.half_space import as_vector, half_space_behind
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import LateralSurface, Surface, Vector, axis_coordinates

#: Nearer to a surface than this, the way to its nearest point has no direction.
ON_SURFACE_MM = 1e-9


@dataclass(frozen=True)
class Sphere(AnalyticBody):
    """A ball."""

    centre_mm: Vector
    radius_mm: float

    gradient_leads_to_closest_point = True

    @property
    def tight_bounds_mm(self) -> Bounds:
        centre = np.array(self.centre_mm)
        return centre - self.radius_mm, centre + self.radius_mm

    def support_mm(self, direction: FloatArray) -> float:
        return float(np.dot(self.centre_mm, direction)) + self.radius_mm

    @property
    def maximum_depth_mm(self) -> float:
        return self.radius_mm

    def distance_at(self, points: FloatArray) -> FloatArray:
        return sphere_distance(points, self.centre_mm, self.radius_mm)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        direction = np.array(self.centre_mm) - points
        size = np.linalg.norm(direction, axis=1)
        direction[size == 0.0] = (1.0, 0.0, 0.0)
        return unit_rows(direction)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """The distance to the circle in the plane: near a pole the ball's own is too flat."""
        height = abs(z_mm - self.centre_mm[2])
        if height >= self.radius_mm:
            return empty_section(plane)
        circle = float(np.sqrt(self.radius_mm**2 - height**2))
        return (circle - _radii(plane, self.centre_mm)).astype(np.float32)


@dataclass(frozen=True)
class Box(AnalyticBody):
    """The box between two opposite corners, along the axes."""

    low_mm: Vector
    high_mm: Vector

    @property
    def tight_bounds_mm(self) -> Bounds:
        return np.array(self.low_mm), np.array(self.high_mm)

    @property
    def maximum_depth_mm(self) -> float:
        return 0.5 * min(b - a for a, b in zip(self.low_mm, self.high_mm, strict=True))

    def distance_at(self, points: FloatArray) -> FloatArray:
        return box_distance(points, self.low_mm, self.high_mm)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """Outside towards the nearest place of it, inside away from the nearest face."""
        low, high = np.array(self.low_mm), np.array(self.high_mm)
        direction = np.clip(points, low, high) - points
        size = np.sqrt(np.einsum("ij,ij->i", direction, direction))
        inside = size <= ON_SURFACE_MM
        direction /= np.where(inside, 1.0, size)[:, None]
        offset = points[inside] - 0.5 * (low + high)
        nearest = (np.abs(offset) - 0.5 * (high - low)).argmax(axis=1)
        rows = np.arange(len(offset))
        faces = np.zeros_like(offset)
        faces[rows, nearest] = np.where(offset[rows, nearest] > 0, -1.0, 1.0)
        direction[inside] = faces
        return direction

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """Its six planes."""
        planes = []
        for axis in range(3):
            outward = [0.0, 0.0, 0.0]
            for corner, sign in ((self.low_mm, -1.0), (self.high_mm, 1.0)):
                outward[axis] = sign
                place = [0.0, 0.0, 0.0]
                place[axis] = corner[axis]
                planes.append((half_space_behind(place, outward), 1))
        return tuple(planes)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.outline_loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else empty_section(plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The rectangle itself; its lower face is included, its upper face is not."""
        if not self.low_mm[2] <= z_mm < self.high_mm[2]:
            return []
        (x0, y0, _), (x1, y1, _) = self.low_mm, self.high_mm
        return [np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])]


@dataclass(frozen=True)
class Cone(AnalyticBody):
    """A round bar between the centres of its end faces, each with its own radius."""

    base_mm: Vector
    top_mm: Vector
    base_radius_mm: float
    top_radius_mm: float

    @property
    def tight_bounds_mm(self) -> Bounds:
        base, top = np.array(self.base_mm), np.array(self.top_mm)
        along = (top - base) / np.linalg.norm(top - base)
        reach = np.sqrt(np.maximum(0.0, 1.0 - along**2))
        below, above = self.base_radius_mm * reach, self.top_radius_mm * reach
        return np.minimum(base - below, top - above), np.maximum(base + below, top + above)

    def support_mm(self, direction: FloatArray) -> float:
        across = float(np.sqrt(max(0.0, 1.0 - np.dot(self._axis, direction) ** 2)))
        return max(float(np.dot(self.base_mm, direction)) + self.base_radius_mm * across,
                   float(np.dot(self.top_mm, direction)) + self.top_radius_mm * across)

    def distance_at(self, points: FloatArray) -> FloatArray:
        return cone_distance(
            points, self.base_mm, self.top_mm, self.base_radius_mm, self.top_radius_mm
        )

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """In the half-plane (radius, height): outside towards the nearest place of it, inside away
        from the nearest of mantle and lids."""
        radial, axial, outward = axis_coordinates(points, self.base_mm, self._axis)
        length, run = self._length_mm, self.top_radius_mm - self.base_radius_mm
        slant = np.hypot(length, run)
        low = axial < 0.5 * length
        lid_r = np.minimum(radial, np.where(low, self.base_radius_mm, self.top_radius_mm))
        lid_z = np.where(low, 0.0, length)
        t = np.clip(
            ((radial - self.base_radius_mm) * run + axial * length) / slant**2, 0.0, 1.0)
        wall_r, wall_z = self.base_radius_mm + t * run, t * length
        lid_nearer = np.hypot(lid_r - radial, lid_z - axial) < np.hypot(
            wall_r - radial, wall_z - axial)
        way_r = np.where(lid_nearer, lid_r, wall_r) - radial
        way_z = np.where(lid_nearer, lid_z, wall_z) - axial
        size = np.hypot(way_r, way_z)
        depth_wall = (self.base_radius_mm + run * axial / length - radial) * length / slant
        depth_lid = np.minimum(axial, length - axial)
        inside = (np.minimum(depth_wall, depth_lid) > 0) | (size <= ON_SURFACE_MM)
        by_wall = depth_wall < depth_lid
        size = np.where(inside, 1.0, size)
        way_r = np.where(inside, np.where(by_wall, -length / slant, 0.0), way_r / size)
        way_z = np.where(
            inside, np.where(by_wall, run / slant, np.where(low, 1.0, -1.0)), way_z / size)
        return np.asarray(way_r[:, None] * outward + way_z[:, None] * np.array(self._axis))

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """Its mantle and its lids."""
        axis = np.array(self._axis)
        slope = (self.top_radius_mm - self.base_radius_mm) / self._length_mm
        return (
            (LateralSurface(self.base_mm, self._axis, self.base_radius_mm, slope), 1),
            (half_space_behind(self.base_mm, -axis), 1),
            (half_space_behind(self.top_mm, axis), 1),
        )

    @cached_property
    def _axis(self) -> Vector:
        return as_vector(unit_vector(np.subtract(self.top_mm, self.base_mm)))

    @cached_property
    def _length_mm(self) -> float:
        return float(np.linalg.norm(np.subtract(self.top_mm, self.base_mm)))

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """Standing upright, the distance to its circle; else its own, which is zero there too."""
        (x0, y0, z0), (x1, y1, z1) = self.base_mm, self.top_mm
        if (x0, y0) != (x1, y1):
            return AnalyticBody.section_values(self, z_mm, plane)
        if not min(z0, z1) <= z_mm < max(z0, z1):
            return empty_section(plane)
        share = (z_mm - z0) / (z1 - z0)
        radius = self.base_radius_mm + share * (self.top_radius_mm - self.base_radius_mm)
        return (radius - _radii(plane, self.base_mm)).astype(np.float32)


class Cylinder(Cone):
    """A round bar between the centres of its end faces."""

    def __init__(self, base_mm: Vector, top_mm: Vector, radius_mm: float) -> None:
        super().__init__(base_mm, top_mm, radius_mm, radius_mm)

    @property
    def maximum_depth_mm(self) -> float:
        return min(self.base_radius_mm, 0.5 * self._length_mm)

    def distance_at(self, points: FloatArray) -> FloatArray:
        return cylinder_distance(points, self.base_mm, self.top_mm, self.base_radius_mm)


@dataclass(frozen=True)
class Torus(AnalyticBody):
    """A ring of round section around an axis (of any length but 0)."""

    centre_mm: Vector
    axis: Vector
    radius_mm: float
    tube_radius_mm: float

    gradient_leads_to_closest_point = True

    @property
    def tight_bounds_mm(self) -> Bounds:
        along = unit_vector(self.axis)
        reach = self.radius_mm * np.sqrt(np.maximum(0.0, 1.0 - along**2)) + self.tube_radius_mm
        centre = np.array(self.centre_mm)
        return centre - reach, centre + reach

    def support_mm(self, direction: FloatArray) -> float:
        across = float(np.sqrt(max(0.0, 1.0 - np.dot(unit_vector(self.axis), direction) ** 2)))
        return (float(np.dot(self.centre_mm, direction)) + self.radius_mm * across
                + self.tube_radius_mm)

    @property
    def maximum_depth_mm(self) -> float:
        return self.tube_radius_mm

    def distance_at(self, points: FloatArray) -> FloatArray:
        return torus_distance(
            points, self.centre_mm, self.axis, self.radius_mm, self.tube_radius_mm
        )

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """Towards the circle that its tube runs along."""
        axis = unit_vector(self.axis)
        radial, axial, outward = axis_coordinates(points, self.centre_mm, as_vector(axis))
        direction = (self.radius_mm - radial)[:, None] * outward - axial[:, None] * axis
        lost = np.einsum("ij,ij->i", direction, direction) == 0.0
        direction[lost] = outward[lost]
        return unit_rows(direction)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """Lying flat, the distance to its two circles; else its own, which is zero there too."""
        if self.axis[:2] != (0.0, 0.0):
            return AnalyticBody.section_values(self, z_mm, plane)
        height = abs(z_mm - self.centre_mm[2])
        if height >= self.tube_radius_mm:
            return empty_section(plane)
        half = float(np.sqrt(self.tube_radius_mm**2 - height**2))
        return (half - np.abs(_radii(plane, self.centre_mm) - self.radius_mm)).astype(np.float32)


def _radii(plane: PlaneGrid, centre_mm: Vector) -> FloatArray:
    """Distance of each node of a plane from a point in it, (ny, nx) float64 [mm]."""
    x, y = plane.x_mm - centre_mm[0], plane.y_mm - centre_mm[1]
    return np.asarray(np.hypot(x[None, :], y[:, None]))
