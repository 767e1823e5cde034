"""What of a body lies deeper than a level: its distance is the body's less that level.

That is a true distance wherever the way along it meets the contour. Beside the sharp corners that a
contour has at a body's middle planes it does not; there the contour itself is measured to. Its
edges and corners are where the body's surfaces, each moved inwards by the level, meet.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import Body, plane_points
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import OffsetSurface, Surface
from lmctl.part.booleans.boundary import Boundary
from lmctl.part.booleans.expression import expression_of

#: How far off the contour's own level a point on it may be, in pitches.
SLACK_PITCHES = 1e-3


@dataclass(frozen=True, eq=False)
class OffsetBody(AnalyticBody):
    """Everything at least `level_mm` deep in a body; with a negative level, all around it too.

    grid : holds the contour
    """

    body: Body
    level_mm: float
    grid: Grid

    @property
    def identity_key(self) -> Hashable:
        return OffsetBody, self.body.identity_key, self.level_mm

    @property
    def distance_bound_is_exact(self) -> bool:
        return False

    @property
    def surface_tolerance_mm(self) -> float:
        return max(self.body.surface_tolerance_mm, SLACK_PITCHES * self.grid.pitch_mm)

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """The body's, moved by the level."""
        return tuple(
            (OffsetSurface(surface, side * self.level_mm), side) for surface,
            side in self.body.surfaces
        )

    @cached_property
    def remaining_surface(self) -> Surface | None:
        return None if self.level_mm == 0.0 else OffsetSurface(self.body, self.level_mm)

    @property
    def enclosing_box_mm(self) -> Bounds:
        low, high = self.body.enclosing_box_mm
        return low + self.level_mm, high - self.level_mm

    @cached_property
    def tight_bounds_mm(self) -> Bounds:
        low, high = self.body.tight_bounds_mm
        ends = low + self.level_mm, high - self.level_mm
        return ends if self.level_mm < 0 else self._contour.find_bounds(ends)

    def support_mm(self, direction: FloatArray) -> float:
        if self.level_mm <= 0:
            return self.body.support_mm(direction) - self.level_mm
        return float((self._contour.surface_points_mm @ direction).max())

    @cached_property
    def maximum_depth_mm(self) -> float:
        return self.body.maximum_depth_mm - self.level_mm

    def distance_at(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.distance_bound(points)
        rows, _ = self._missing(points, depth)
        if len(rows):
            away = np.linalg.norm(points[rows] - self._contour.closest_points(points[rows]), axis=1)
            depth[rows] = np.copysign(np.maximum(away, np.abs(depth[rows])), depth[rows])
        return depth

    def distance_bound(self, points: FloatArray) -> FloatArray:
        return self.body.distance_at(points) - self.level_mm

    def closest_points(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.distance_bound(points)
        missing, closest = self._missing(points, depth)
        if len(missing):
            closest[missing] = self._contour.closest_points(points[missing])
        return closest

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return self.body.inward_directions(points)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        if self.level_mm == 0.0:
            return self.body.section_values(z_mm, plane)
        depth = self.distance_bound(plane_points(plane, z_mm))
        return depth.astype(np.float32).reshape(plane.shape)

    def _missing(self, points: FloatArray, depth: FloatArray) -> tuple[IntArray, FloatArray]:
        """The rows whose way along the distance does not meet the contour, and where all lead."""
        closest = points - depth[:, None] * self.body.inward_directions(points)
        if self.level_mm == 0.0:
            return np.empty(0, dtype=np.int64), closest
        return np.flatnonzero(~self._met(closest)), closest

    def _met(self, points: FloatArray) -> NDArray[np.bool_]:
        met: NDArray[np.bool_] = np.abs(self.distance_bound(points)) <= self.surface_tolerance_mm
        return met

    @cached_property
    def _contour(self) -> Boundary:
        contour = Boundary(expression_of(self), self._met, self.grid)
        if len(contour.surface_points_mm) == 0:
            raise InputError(
                f"nothing lies deeper than {self.level_mm:g} mm",
                where=f"the deepest place is at {self.body.maximum_depth_mm:.4g} mm, the pitch is "
                f"{self.grid.pitch_mm:g} mm",
                hint="lower from_mm or to_mm of the shell, or give a smaller pitch_mm",
            )
        return contour
