"""What of a body lies deeper than a level: its distance is the body's less that level.

That is a true distance wherever the way along it meets the contour. Beside the sharp corners that a
contour has at a body's middle planes it does not; there the contour itself is measured to.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.field import Field
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid
from lmctl.field.seeds import seed_triangles
from lmctl.field.sweep import sweep_sources
from lmctl.part.analytic import Analytic
from lmctl.part.bodies import Body, closest_points, without_slivers
from lmctl.part.measured import Bounds
from lmctl.part.operands import ON_SURFACE

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Offset(Analytic):
    """Everything at least `level_mm` deep in a body; with a negative level, all around it too.

    grid : holds the contour; where it has corners they are rounded within its pitch
    """

    body: Body
    level_mm: float
    grid: Grid

    @cached_property
    def bounds_mm(self) -> Bounds:
        low, high = self.body.bounds_mm
        if self.level_mm < 0:
            return low + self.level_mm, high - self.level_mm
        corners = self._contour.reshape(-1, 3)
        return (np.maximum(corners.min(axis=0), low + self.level_mm),
                np.minimum(corners.max(axis=0), high - self.level_mm))

    @cached_property
    def largest_depth_mm(self) -> float:
        return self.body.largest_depth_mm - self.level_mm

    def at(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.body.at(points) - self.level_mm
        rows = self._missing(points, depth)
        if len(rows):
            away = np.linalg.norm(points[rows] - self._nearest(points[rows]), axis=1)
            depth[rows] = np.copysign(np.maximum(away, np.abs(depth[rows])), depth[rows])
        return depth

    def bound(self, points: FloatArray) -> FloatArray:
        return self.body.at(points) - self.level_mm

    def feet(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = self.body.at(points) - self.level_mm
        feet = points - depth[:, None] * self.body.inward(points)
        off = np.abs(self.body.at(feet) - self.level_mm) > self._slack
        if off.any():
            feet[off] = self._nearest(points[off])
        return feet

    def inward(self, points: FloatArray) -> FloatArray:
        return self.body.inward(points)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        if self.level_mm == 0.0:
            return self.body.cut(z_mm, plane)
        return Analytic.cut(self, z_mm, plane)

    def _missing(self, points: FloatArray, depth: FloatArray) -> NDArray[np.int64]:
        """The rows whose way along the distance does not meet the contour.

        Only on one side: on the other, every way out crosses the contour at right angles.
        """
        if self.level_mm == 0.0:
            return np.empty(0, dtype=np.int64)
        asked = np.flatnonzero(depth < 0 if self.level_mm > 0 else depth > 0)
        feet = points[asked] - depth[asked, None] * self.body.inward(points[asked])
        missed: NDArray[np.bool_] = np.abs(self.body.at(feet) - self.level_mm) > self._slack
        return asked[missed]

    @property
    def _slack(self) -> float:
        return ON_SURFACE * self.grid.pitch_mm

    def _nearest(self, points: FloatArray) -> FloatArray:
        return closest_points(self._stored, points)

    @cached_property
    def _stored(self) -> Field:
        """The nearest point of the contour at every node; its sign is not kept."""
        sources, surface_mm, _ = seed_triangles(self._contour, self.grid)
        values = sweep_sources(sources, surface_mm, self.grid)
        return Field(self.grid, values, sources, surface_mm)

    @cached_property
    def _contour(self) -> FloatArray:
        """Triangles of the contour, (m, 3, 3) float64 [mm]."""
        from skimage.measure import marching_cubes  # takes a second, which few parts need to spend

        depth = self.body.distance(self.grid.window()) - np.float32(self.level_mm)
        if not (depth > 0).any():
            raise InputError(
                f"nothing lies deeper than {self.level_mm:g} mm",
                where=f"the deepest place is at {self.body.largest_depth_mm:.4g} mm, the pitch is "
                f"{self.grid.pitch_mm:g} mm",
                hint="lower from_mm or to_mm of the shell, or give a smaller pitch_mm",
            )
        corners, triangles, _, _ = marching_cubes(depth, 0.0)
        points = corners[:, ::-1] * self.grid.pitch_mm + np.asarray(self.grid.origin_mm)
        return without_slivers(points[triangles].astype(np.float64))
