"""What of a body lies above a substrate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.measured import Bounds
from lmctl.part.substrate.surface_heights import SurfaceHeights

#: For differences of the distance [mm].
_STEP_MM = 1e-3


@dataclass(frozen=True, eq=False)
class BodyAboveSurface(AnalyticBody):
    """A body without what is below a surface. Its distance is zero on its own surface and true near
    it, up to the surface's curvature; at most the true one inside."""

    body: Body
    heights: SurfaceHeights

    @property
    def tight_bounds_mm(self) -> Bounds:
        return self.body.tight_bounds_mm

    @property
    def distance_bound_is_exact(self) -> bool:
        return False

    def distance_at(self, points: FloatArray) -> FloatArray:
        places = points[:, :2]
        rise = np.linalg.norm(self.heights.slope(places), axis=1)
        above = (points[:, 2] - self.heights.height_mm(places)) / np.sqrt(1 + rise**2)
        return np.asarray(np.minimum(self.body.distance_at(points), above))

    def inward_directions(self, points: FloatArray) -> FloatArray:
        step = _STEP_MM * np.eye(3)
        change = np.stack([self.distance_at(points + d) - self.distance_at(points - d)
                           for d in step], axis=1)
        length = np.linalg.norm(change, axis=1, keepdims=True)
        return np.asarray(change / np.maximum(length, 1e-300))
