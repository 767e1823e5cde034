"""Shared base of bodies that are computed on demand: everything else derives from `at`."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.grid import Window
from lmctl.field.plane import PlaneGrid, section_loops
from lmctl.part.bodies.body import BodyDefaults, plane_points
from lmctl.part.bodies.corners import restore_corners
from lmctl.part.bodies.depth import maximum_in_box

#: Nodes evaluated at a time: keeps temporaries in tens of megabytes.
NODES_AT_ONCE = 250_000


class AnalyticBody(BodyDefaults):
    """A body whose `at` is exact, or as good as what it is made of."""

    @property
    def surface_tolerance_mm(self) -> float:
        return 0.0

    @cached_property
    def maximum_depth_mm(self) -> float:
        return maximum_in_box(self.distance_at, *self.tight_bounds_mm)

    def closest_points(self, points: FloatArray) -> FloatArray:
        return points - self.distance_at(points)[:, None] * self.inward_directions(points)

    def distance(self, window: Window) -> NDArray[np.float32]:
        values = np.empty(window.shape, dtype=np.float32)
        flat = values.reshape(-1)
        for first, points in node_chunks(window):
            flat[first : first + len(points)] = self.distance_at(points)
        return values

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return self.distance_at(plane_points(plane, z_mm)).astype(np.float32).reshape(plane.shape)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        loops = section_loops(self.section_values(z_mm, plane), plane)
        return restore_corners(loops, z_mm, self.distance_bound, self.inward_directions)


def node_chunks(window: Window) -> Iterator[tuple[int, FloatArray]]:
    """A window's nodes in the array's own order, a bounded number at a time.

    Yields the number of the first and the points (n, 3) float64 [mm].
    """
    grid = window.grid
    x, y = grid.axis_mm(0), grid.axis_mm(1)
    z = grid.axis_mm(2)[window.z_first : window.z_last]
    rows = max(1, NODES_AT_ONCE // len(x))
    for first in range(0, len(z) * len(y), rows):
        k, j = np.divmod(np.arange(first, min(first + rows, len(z) * len(y))), len(y))
        points = np.empty((len(k), len(x), 3))
        points[:, :, 0] = x
        points[:, :, 1] = y[j, None]
        points[:, :, 2] = z[k, None]
        yield first * len(x), points.reshape(-1, 3)
