"""A body scaled, turned and moved: computed in its own coordinates, returned in the part's."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.features import unit_vector
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import Body, empty_section
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface


@dataclass(frozen=True, eq=False)
class SimilarityTransform:
    """x ↦ scale · rotation · x + shift.

    rotation : (3, 3) float64; shift_mm : (3,) float64
    """

    scale: float
    rotation: FloatArray
    shift_mm: FloatArray

    def apply(self, points: FloatArray) -> FloatArray:
        """(n, 3) [mm] of the body -> of the part"""
        return self.scale * points @ self.rotation.T + self.shift_mm

    def invert(self, points: FloatArray) -> FloatArray:
        """(n, 3) [mm] of the part -> of the body"""
        return (points - self.shift_mm) @ self.rotation / self.scale


def similarity_transform(
    scale: float, axis: Sequence[float], degrees: float, through_mm: Sequence[float],
    by_mm: Sequence[float],
) -> SimilarityTransform:
    """Scaled about the origin, then turned about an axis through a point, then moved."""
    turn = _rotation(unit_vector(axis), np.deg2rad(degrees))
    through = np.asarray(through_mm, dtype=np.float64)
    return SimilarityTransform(scale, turn,
                               through - turn @ through + np.asarray(by_mm, dtype=np.float64))


def _rotation(axis: FloatArray, angle: float) -> FloatArray:
    """Rodrigues' formula; quarter turns are exact, so that upright walls stay upright."""
    c, s = np.cos(angle), np.sin(angle)
    c, s = (float(np.rint(v)) if abs(v - np.rint(v)) < 1e-15 else float(v) for v in (c, s))
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: FloatArray = c * np.eye(3) + s * cross + (1 - c) * np.outer(axis, axis)
    return turn


@dataclass(frozen=True, eq=False)
class TransformedBody(AnalyticBody):
    """A body scaled, turned and moved. Distances scale with it, so they stay true."""

    body: Body
    transform: SimilarityTransform

    @property
    def identity_key(self) -> Hashable:
        motion = self.transform
        return (TransformedBody, self.body.identity_key, motion.scale, motion.rotation.tobytes(),
                motion.shift_mm.tobytes())

    @property
    def surface_tolerance_mm(self) -> float:
        return self.transform.scale * self.body.surface_tolerance_mm

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        return self.body.gradient_leads_to_closest_point

    @property
    def distance_bound_is_exact(self) -> bool:
        return self.body.distance_bound_is_exact

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return tuple(
            (TransformedSurface(surface, self.transform), sign) for surface,
            sign in self.body.surfaces)

    @cached_property
    def remaining_surface(self) -> Surface | None:
        rest = self.body.remaining_surface
        return None if rest is None else TransformedSurface(rest, self.transform)

    @property
    def enclosing_box_mm(self) -> Bounds:
        return self._around(*self.body.enclosing_box_mm)

    @cached_property
    def tight_bounds_mm(self) -> Bounds:
        low, high = self.body.tight_bounds_mm
        if not np.isfinite([*low, *high]).all():
            return self._around(low, high)
        reach = [[self.support_mm(sign * axis) for axis in np.eye(3)] for sign in (-1.0, 1.0)]
        return -np.array(reach[0]), np.array(reach[1])

    def support_mm(self, direction: FloatArray) -> float:
        along = self.body.support_mm(direction @ self.transform.rotation)
        return self.transform.scale * along + float(self.transform.shift_mm @ direction)

    def _around(self, low: FloatArray, high: FloatArray) -> Bounds:
        if not np.isfinite([*low, *high]).all():
            return np.full(3, -np.inf), np.full(3, np.inf)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        centre = self.transform.apply(middle[None])[0]
        reach = self.transform.scale * np.abs(self.transform.rotation) @ half
        return centre - reach, centre + reach

    @property
    def maximum_depth_mm(self) -> float:
        return self.transform.scale * self.body.maximum_depth_mm

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self.transform.scale * self.body.distance_at(self.transform.invert(points))

    def distance_bound(self, points: FloatArray) -> FloatArray:
        return self.transform.scale * self.body.distance_bound(self.transform.invert(points))

    def closest_points(self, points: FloatArray) -> FloatArray:
        return self.transform.apply(self.body.closest_points(self.transform.invert(points)))

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return self.body.inward_directions(
            self.transform.invert(points)) @ self.transform.rotation.T

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        if not self._upright:
            return AnalyticBody.section_values(self, z_mm, plane)
        loops = self.outline_loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else empty_section(plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """Where its z axis still points up, its own outline moved; else read off its distance."""
        low, high = self.body.tight_bounds_mm
        if not (self._upright and np.isfinite([*low, *high]).all()):
            return AnalyticBody.outline_loops(self, z_mm, plane)
        own_z_mm = (z_mm - self.transform.shift_mm[2]) / self.transform.scale
        loops = self.body.outline_loops(
            own_z_mm, plane_grid_over(low, high, plane.pitch_mm / self.transform.scale))
        return [
            self.transform.apply(np.column_stack([loop, np.full(len(loop), own_z_mm)]))[:, :2]
            for loop in loops
        ]

    @property
    def _upright(self) -> bool:
        return bool(np.allclose(self.transform.rotation[2], (0.0, 0.0, 1.0), atol=1e-12))


@dataclass(frozen=True, eq=False)
class TransformedSurface:
    """A surface scaled, turned and moved."""

    surface: Surface
    transform: SimilarityTransform

    @property
    def surface_tolerance_mm(self) -> float:
        return self.transform.scale * self.surface.surface_tolerance_mm

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        return self.surface.gradient_leads_to_closest_point

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self.transform.scale * self.surface.distance_at(self.transform.invert(points))

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return self.surface.inward_directions(
            self.transform.invert(points)) @ self.transform.rotation.T


def plane_grid_over(low: FloatArray, high: FloatArray, pitch_mm: float) -> PlaneGrid:
    """The nodes of a plane that hold the box [low, high] with two to spare on each side."""
    first = np.floor(low[:2] / pitch_mm).astype(int) - 2
    last = np.ceil(high[:2] / pitch_mm).astype(int) + 2
    nx, ny = (int(n) for n in last - first + 1)
    return PlaneGrid((float(first[0] * pitch_mm), float(first[1] * pitch_mm)), pitch_mm, (ny, nx))
