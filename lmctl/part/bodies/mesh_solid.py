"""A body bounded by triangles: its outlines are cut from them, its depths are measured to them.

Nothing is stored on a grid, so distances are true to rounding everywhere, however thin the body is
and however far the place.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.grid import Grid
from lmctl.field.mesh.triangle_tree import TriangleTree
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import empty_section
from lmctl.part.bodies.depth import unit_gradient
from lmctl.part.bodies.measured import Bounds
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.slicing import MeshSlicer

#: Single-precision coordinates of two bodies meant to be flush differ by so much, as a share of
#: the largest coordinate.
ROUNDING_SHARE = 2e-7

#: Nearer to the surface than this, the way to it gives no direction.
ON_SURFACE_MM = 1e-6


@dataclass(frozen=True, eq=False)
class MeshSolid(AnalyticBody):
    """A closed mesh whose triangles face out, each corner in use.

    grid : around it, for exports and for the boundaries of what is made of it
    """

    mesh: Mesh
    grid: Grid

    @cached_property
    def tight_bounds_mm(self) -> Bounds:
        return self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)

    @cached_property
    def surface_tolerance_mm(self) -> float:
        return ROUNDING_SHARE * float(np.abs(self.mesh.vertices).max())

    def support_mm(self, direction: FloatArray) -> float:
        return float((self.mesh.vertices @ direction).max())

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self._tree.signed_distance(points)

    def closest_points(self, points: FloatArray) -> FloatArray:
        return self._tree.closest_points(points)[0]

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """Away from the nearest point, or to it from outside; on the surface by the slope."""
        points = np.asarray(points, dtype=np.float64)
        closest, depth = self._tree.closest_points(points)
        direction = np.sign(depth)[:, None] * (points - closest)
        size = np.abs(depth)
        inward = direction / np.maximum(size, 1e-300)[:, None]
        close = np.flatnonzero(size < ON_SURFACE_MM)
        if len(close):
            inward[close] = unit_gradient(self.distance_at, points[close])
        return inward

    @cached_property
    def _tree(self) -> TriangleTree:
        return TriangleTree.of(self.mesh.vertices[self.mesh.triangles])

    @cached_property
    def _slicer(self) -> MeshSlicer:
        return MeshSlicer(self.mesh.vertices, self.mesh.triangles)

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.outline_loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else empty_section(plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return self._slicer.loops(z_mm)
