"""A body with its outline moved from the drawing by a machining allowance.

The allowance lies in the plane of the layers. Depths, and the materials that depend on them, stay
those of the drawing.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.grid import Window
from lmctl.field.outline_distance import plane_distance
from lmctl.field.outline_offset import offset_loops
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface


@dataclass(frozen=True, eq=False)
class AllowanceBody:
    """allowance_mm : how far the outline in every section lies outside that of `inner`; negative:
    inside
    """

    inner: Body
    allowance_mm: float

    @property
    def tight_bounds_mm(self) -> Bounds:
        return self._grown(self.inner.tight_bounds_mm)

    @property
    def enclosing_box_mm(self) -> Bounds:
        return self._grown(self.inner.enclosing_box_mm)

    def _grown(self, box: Bounds) -> Bounds:
        around = np.array([self.allowance_mm, self.allowance_mm, 0.0])
        return box[0] - around, box[1] + around

    def support_mm(self, direction: FloatArray) -> float:
        across = float(np.hypot(direction[0], direction[1]))
        return self.inner.support_mm(direction) + self.allowance_mm * across

    @property
    def identity_key(self) -> Hashable:
        return AllowanceBody, self.inner.identity_key, self.allowance_mm

    @property
    def surface_tolerance_mm(self) -> float:
        return self.inner.surface_tolerance_mm

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        return self.inner.gradient_leads_to_closest_point

    @property
    def distance_bound_is_exact(self) -> bool:
        return self.inner.distance_bound_is_exact

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return self.inner.surfaces

    @property
    def remaining_surface(self) -> Surface | None:
        return self.inner.remaining_surface

    @property
    def maximum_depth_mm(self) -> float:
        return self.inner.maximum_depth_mm

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self.inner.distance_at(points)

    def distance_bound(self, points: FloatArray) -> FloatArray:
        return self.inner.distance_bound(points)

    def closest_points(self, points: FloatArray) -> FloatArray:
        return self.inner.closest_points(points)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return self.inner.inward_directions(points)

    def distance(self, window: Window) -> NDArray[np.float32]:
        return self.inner.distance(window)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return plane_distance(self.outline_loops(z_mm, plane), plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The drawing's outline, moved."""
        return offset_loops(self.inner.outline_loops(z_mm, plane), self.allowance_mm)
