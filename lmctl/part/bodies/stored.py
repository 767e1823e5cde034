"""Bodies defined only by a field stored on a grid, such as measured clouds.

A field is kept on the body's own grid, and is interpolated on any other.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.field import DistanceField, sample_distance, sample_gradient
from lmctl.field.grid import Grid, Window
from lmctl.field.maximum_depth import find_maximum_depth
from lmctl.field.plane import PlaneGrid, loop_area_mm2, section_loops
from lmctl.field.triangles import closest_points_on_rows
from lmctl.part.bodies.body import BodyDefaults, plane_points
from lmctl.part.bodies.depth import project_to_surface, unit_gradient, unit_rows
from lmctl.part.bodies.measured import Bounds, zero_level_bounds

#: Half the span of slopes of stored fields, and how near a place is taken to lie on their surface.
STEP_PITCHES = 0.01
SURFACE_PITCHES = 1e-3

#: What stored fields may be off by at their surface, in pitches, seen from other bodies.
SLACK_PITCHES = 0.01


@dataclass(frozen=True, eq=False)
class FieldSolid(BodyDefaults):
    """A body defined only by its field, such as a measured cloud.

    least_area_mm2 : a section smaller than this is no part of the body (a bead's own area)
    """

    stored: DistanceField
    least_area_mm2: float = 0.0

    @property
    def grid(self) -> Grid:
        return self.stored.grid

    @property
    def surface_tolerance_mm(self) -> float:
        return SLACK_PITCHES * self.stored.grid.pitch_mm

    @cached_property
    def maximum_depth_mm(self) -> float:
        """Refined between the nodes: a body's deepest place is rarely one of them."""
        return find_maximum_depth(self.stored)[0]

    def distance_at(self, points: FloatArray) -> FloatArray:
        return sample_distance(self.stored, points)

    def closest_points(self, points: FloatArray) -> FloatArray:
        """Of stored triangles the nearest place on one; of stored points the nearest, or nearer
        still the place on the surface between them that the slope leads to."""
        closest = closest_points(self.stored, points)
        if not (self.stored.exact and self.stored.surface_mm.ndim == 2):
            return closest
        led = project_to_surface(self.distance_at, self.inward_directions, points)
        slack = SURFACE_PITCHES * self.stored.grid.pitch_mm
        nearer = np.linalg.norm(led - points, axis=1) < np.linalg.norm(closest - points, axis=1)
        better = nearer & (np.abs(self.distance_at(led)) < slack)
        return np.where(better[:, None], led, closest)

    def inward_directions(self, points: FloatArray) -> FloatArray:
        if self.stored.exact:  # read back more precisely than the slope of its nodes is
            return unit_gradient(self.distance_at, points, STEP_PITCHES * self.stored.grid.pitch_mm)
        return unit_rows(sample_gradient(self.stored, points))

    def distance(self, window: Window) -> NDArray[np.float32]:
        return self.stored.values_on_window(window)

    @cached_property
    def tight_bounds_mm(self) -> Bounds:
        return zero_level_bounds(self.stored, self.least_area_mm2)

    def support_mm(self, direction: FloatArray) -> float:
        """Of balls about the nodes near its surface, each as large as the node is deep."""
        near = (self.stored.values > 0) & (self.stored.values < 2.0 * self.grid.pitch_mm)
        nodes = np.argwhere(near)[:, ::-1] * self.grid.pitch_mm + np.asarray(self.grid.origin_mm)
        return float((nodes @ direction + self.stored.values[near]).max())

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        values = sample_distance(self.stored, plane_points(plane, z_mm))
        return values.astype(np.float32).reshape(plane.shape)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """Outlines that enclose at least a cell of the field's grid; smaller ones are noise."""
        loops = section_loops(self.section_values(z_mm, plane), plane)
        return [loop for loop in loops if abs(loop_area_mm2(loop)) >= self.grid.pitch_mm**2]


def closest_points(field: DistanceField, points: FloatArray) -> FloatArray:
    """The nearest surface point stored at the corners of each point's cell, (n, 3) [mm].

    Where none is stored, down the slope to the surface.

    points : (n, 3) float64 [mm], those outside the grid taken to its rim
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    best, nearest = np.empty_like(points), np.full(len(points), np.inf)
    if field.sources is not None:
        last = np.asarray(field.grid.shape[::-1]) - 1
        nodes = (points - np.asarray(field.grid.origin_mm)) / field.grid.pitch_mm
        first = np.clip(np.floor(nodes).astype(np.int64), 0, last - 1)
        for corner in np.ndindex(2, 2, 2):
            x, y, z = (first + corner).T
            rows = field.sources[z, y, x]
            known = np.flatnonzero(rows >= 0)
            found = closest_points_on_rows(field.surface_mm, rows[known], points[known])
            squared = ((found - points[known]) ** 2).sum(axis=1)
            nearer = squared < nearest[known]
            best[known[nearer]], nearest[known[nearer]] = found[nearer], squared[nearer]
    far = ~np.isfinite(nearest)
    if far.any():
        best[far] = project_to_surface(
            lambda p: sample_distance(field, p), lambda p: unit_rows(sample_gradient(field, p)),
            points[far], rounds=4,
        )
    return best
