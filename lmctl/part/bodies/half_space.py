"""Everything behind a plane: a body to cut with, and the flat surfaces of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.features import unit_vector
from lmctl.field.primitives import half_space_distance
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Vector


@dataclass(frozen=True)
class HalfSpace(AnalyticBody):
    """Everything behind a plane; `outward` (of any length but 0) is the way out of it."""

    point_mm: Vector
    outward: Vector

    gradient_leads_to_closest_point = True

    @property
    def tight_bounds_mm(self) -> Bounds:
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
    def maximum_depth_mm(self) -> float:
        return float("inf")

    def distance_at(self, points: FloatArray) -> FloatArray:
        return half_space_distance(points, self.point_mm, self.outward)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return np.tile(-unit_vector(self.outward), (len(points), 1))


def half_space_behind(point_mm: Sequence[float],
                      outward: Sequence[float] | FloatArray) -> HalfSpace:
    """What is behind a plane; equal for equal planes, whatever point of them is given."""
    along = unit_vector(outward)
    height = round(float(np.dot(along, point_mm)), 12)
    return HalfSpace(as_vector(height * along + 0.0), as_vector(along + 0.0))


def as_vector(values: Sequence[float] | FloatArray) -> Vector:
    """Three numbers, as bodies keep them."""
    x, y, z = (float(value) for value in values)
    return x, y, z
