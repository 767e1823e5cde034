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

from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.analytic import Analytic
from lmctl.part.bodies.body import Body, plane_points
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Shifted, Surface
from lmctl.part.booleans.boundary import Boundary
from lmctl.part.booleans.expression import expression_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: How far off the contour's own level a point on it may be, in pitches.
SLACK_PITCHES = 1e-3


@dataclass(frozen=True, eq=False)
class Offset(Analytic):
    """Everything at least `level_mm` deep in a body; with a negative level, all around it too.

    grid : holds the contour
    """

    body: Body
    level_mm: float
    grid: Grid

    @property
    def key(self) -> Hashable:
        return Offset, self.body.key, self.level_mm

    @property
    def exact_bound(self) -> bool:
        return False

    @property
    def slack_mm(self) -> float:
        return max(self.body.slack_mm, SLACK_PITCHES * self.grid.pitch_mm)

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """The body's, moved by the level."""
        return tuple(
            (Shifted(surface, side * self.level_mm), side) for surface, side in self.body.surfaces
        )

    @cached_property
    def rest(self) -> Surface | None:
        return None if self.level_mm == 0.0 else Shifted(self.body, self.level_mm)

    @property
    def box_mm(self) -> Bounds:
        low, high = self.body.box_mm
        return low + self.level_mm, high - self.level_mm

    @cached_property
    def bounds_mm(self) -> Bounds:
        low, high = self.body.bounds_mm
        ends = low + self.level_mm, high - self.level_mm
        return ends if self.level_mm < 0 else self._contour.ends(ends)

    def reach_mm(self, way: FloatArray) -> float:
        if self.level_mm <= 0:
            return self.body.reach_mm(way) - self.level_mm
        return float((self._contour.feet_mm @ way).max())

    @cached_property
    def largest_depth_mm(self) -> float:
        return self.body.largest_depth_mm - self.level_mm

    def at(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.bound(points)
        rows, _ = self._missing(points, depth)
        if len(rows):
            away = np.linalg.norm(points[rows] - self._contour.nearest(points[rows]), axis=1)
            depth[rows] = np.copysign(np.maximum(away, np.abs(depth[rows])), depth[rows])
        return depth

    def bound(self, points: FloatArray) -> FloatArray:
        return self.body.at(points) - self.level_mm

    def feet(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.bound(points)
        missing, feet = self._missing(points, depth)
        if len(missing):
            feet[missing] = self._contour.nearest(points[missing])
        return feet

    def inward(self, points: FloatArray) -> FloatArray:
        return self.body.inward(points)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        if self.level_mm == 0.0:
            return self.body.cut(z_mm, plane)
        depth = self.bound(plane_points(plane, z_mm))
        return depth.astype(np.float32).reshape(plane.shape)

    def _missing(self, points: FloatArray, depth: FloatArray) -> tuple[IntArray, FloatArray]:
        """The rows whose way along the distance does not meet the contour, and where all lead."""
        feet = points - depth[:, None] * self.body.inward(points)
        if self.level_mm == 0.0:
            return np.empty(0, dtype=np.int64), feet
        return np.flatnonzero(~self._met(feet)), feet

    def _met(self, points: FloatArray) -> NDArray[np.bool_]:
        met: NDArray[np.bool_] = np.abs(self.bound(points)) <= self.slack_mm
        return met

    @cached_property
    def _contour(self) -> Boundary:
        contour = Boundary(expression_of(self), self._met, self.grid)
        if len(contour.feet_mm) == 0:
            raise InputError(
                f"nothing lies deeper than {self.level_mm:g} mm",
                where=f"the deepest place is at {self.body.largest_depth_mm:.4g} mm, the pitch is "
                f"{self.grid.pitch_mm:g} mm",
                hint="lower from_mm or to_mm of the shell, or give a smaller pitch_mm",
            )
        return contour
