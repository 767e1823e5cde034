"""The nodes of a part's tree: each answers how deep a place is, and where its outline runs.

What needs the whole field at once (a mesh, a cloud) keeps a stored field on its own grid, made when
first asked for, and is interpolated on any other grid. Bodies with a formula are in `formulas` and
`prism`, those made of others in `combined`, `offset` and `moved`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.field.deepest import largest_depth
from lmctl.field.field import Field, sample, sample_gradient
from lmctl.field.grid import Grid, Window
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.plane import PlaneGrid, loop_area_mm2, plane_distance, section_loops
from lmctl.field.triangles import closest_in_rows
from lmctl.part.bodies.depth import onto_zero, unit_slope
from lmctl.part.bodies.measured import Bounds, zero_bounds
from lmctl.part.bodies.surfaces import Surface
from lmctl.part.sources.mesh_files import Mesh
from lmctl.part.sources.slicing import Slicer

FloatArray = NDArray[np.float64]
Vector = tuple[float, float, float]

#: Half the span of slopes of stored fields, and how near a place is taken to lie on their surface.
STEP_PITCHES = 0.01
SURFACE_PITCHES = 1e-3

#: What stored fields may be off by at their surface, in pitches, seen from other bodies.
SLACK_PITCHES = 0.01


class Body(Protocol):
    """A node. Distances are signed, positive inside, true distances everywhere [mm]."""

    @property
    def bounds_mm(self) -> Bounds:
        """Lowest and highest x, y, z of the solid, each (3,) float64 [mm]; may be infinite."""

    def reach_mm(self, way: FloatArray) -> float:
        """How far it reaches from the origin along a direction (3,) of length 1, at most [mm]."""

    @property
    def box_mm(self) -> Bounds:
        """A box that holds it, told without looking for its surface; may be infinite."""

    @property
    def key(self) -> Hashable:
        """Equal for bodies that are known to be the same."""

    @property
    def slack_mm(self) -> float:
        """How far from zero its distance may be at its surface [mm]; 0 where that is exact."""

    @property
    def one_foot(self) -> bool:
        """Whether the way down the slope leads to its nearest point from everywhere, and it is
        smooth."""

    @property
    def exact_bound(self) -> bool:
        """Whether `bound` is the distance already."""

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """Smooth surfaces that hold its own; each with 1 where the body is on its positive side,
        else −1."""

    @property
    def rest(self) -> Surface | None:
        """What stands for its surface where none of these does, if they leave anything."""

    @property
    def largest_depth_mm(self) -> float:
        """The greatest distance from the surface inside, refined between stored nodes."""

    def at(self, points: FloatArray) -> FloatArray:
        """Distance at points (n, 3) float64 -> (n,) float64 [mm]."""

    def bound(self, points: FloatArray) -> FloatArray:
        """A distance of the right sign and at most the true size, cheap to ask; zero on the same
        surface, and changing by at most 1 mm per mm."""

    def feet(self, points: FloatArray) -> FloatArray:
        """The surface point nearest to each of points (n, 3) -> (n, 3) float64 [mm]."""

    def inward(self, points: FloatArray) -> FloatArray:
        """The direction in which the distance grows, (n, 3) -> (n, 3) float64 of length 1."""

    def distance(self, window: Window) -> NDArray[np.float32]:
        """Distance at the nodes of a slab, float32 of window.shape [mm]."""

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """(ny, nx) float32, positive inside, zero on the outline; a distance only near it."""

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The outline at height z: closed loops (k, 2) float64 [mm], the inside on the left."""


class BodyDefaults(ABC):
    """What most bodies say of themselves alike."""

    @property
    @abstractmethod
    def bounds_mm(self) -> Bounds:
        """As `Body` has it."""

    @property
    @abstractmethod
    def slack_mm(self) -> float:
        """As `Body` has it."""

    @abstractmethod
    def at(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    @abstractmethod
    def inward(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    def reach_mm(self, way: FloatArray) -> float:
        low, high = self.bounds_mm
        return float(np.maximum(low * way, high * way).sum())

    @property
    def box_mm(self) -> Bounds:
        return self.bounds_mm

    @property
    def key(self) -> Hashable:
        return self

    @property
    def one_foot(self) -> bool:
        return False

    @property
    def exact_bound(self) -> bool:
        return True

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return ((self, 1),)

    @property
    def rest(self) -> Surface | None:
        return None

    def bound(self, points: FloatArray) -> FloatArray:
        return self.at(points)


class Stored(BodyDefaults):
    """What bodies with a stored field share."""

    @property
    @abstractmethod
    def field(self) -> Field:
        """The field that is stored."""

    @property
    def slack_mm(self) -> float:
        return SLACK_PITCHES * self.field.grid.pitch_mm

    @cached_property
    def largest_depth_mm(self) -> float:
        """Refined between the nodes: a body's deepest place is rarely one of them."""
        return largest_depth(self.field)[0]

    def at(self, points: FloatArray) -> FloatArray:
        return sample(self.field, points)

    def feet(self, points: FloatArray) -> FloatArray:
        """Of stored triangles the nearest place on one; of stored points the nearest, or nearer
        still the place on the surface between them that the slope leads to."""
        feet = closest_points(self.field, points)
        if not (self.field.exact and self.field.surface_mm.ndim == 2):
            return feet
        led = onto_zero(self.at, self.inward, points)
        slack = SURFACE_PITCHES * self.field.grid.pitch_mm
        nearer = np.linalg.norm(led - points, axis=1) < np.linalg.norm(feet - points, axis=1)
        better = nearer & (np.abs(self.at(led)) < slack)
        return np.where(better[:, None], led, feet)

    def inward(self, points: FloatArray) -> FloatArray:
        if self.field.exact:  # read back more precisely than the slope of its nodes is
            return unit_slope(self.at, points, STEP_PITCHES * self.field.grid.pitch_mm)
        return unit_rows(sample_gradient(self.field, points))

    def distance(self, window: Window) -> NDArray[np.float32]:
        return self.field.on_window(window)


@dataclass(frozen=True, eq=False)
class MeshSolid(Stored):
    """A closed mesh, each corner in use: its triangles give outlines, its field depths."""

    mesh: Mesh
    grid: Grid

    @cached_property
    def bounds_mm(self) -> Bounds:
        return self.mesh.vertices.min(axis=0), self.mesh.vertices.max(axis=0)

    def reach_mm(self, way: FloatArray) -> float:
        return float((self.mesh.vertices @ way).max())

    @cached_property
    def field(self) -> Field:
        corners = without_slivers(self.mesh.vertices[self.mesh.triangles])
        soup = np.arange(3 * len(corners)).reshape(-1, 3)
        return mesh_field(corners.reshape(-1, 3), soup, self.grid)

    @cached_property
    def _slicer(self) -> Slicer:
        return Slicer(self.mesh.vertices, self.mesh.triangles)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else nothing_of(plane)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return self._slicer.loops(z_mm)


@dataclass(frozen=True, eq=False)
class FieldSolid(Stored):
    """A body that is known by its field alone, such as a measured cloud.

    least_area_mm2 : a section smaller than this is no part of the body (a bead's own area)
    """

    stored: Field
    least_area_mm2: float = 0.0

    @property
    def field(self) -> Field:
        return self.stored

    @property
    def grid(self) -> Grid:
        return self.stored.grid

    @cached_property
    def bounds_mm(self) -> Bounds:
        return zero_bounds(self.stored, self.least_area_mm2)

    def reach_mm(self, way: FloatArray) -> float:
        """Of balls about the nodes near its surface, each as large as the node is deep."""
        near = (self.stored.values > 0) & (self.stored.values < 2.0 * self.grid.pitch_mm)
        nodes = np.argwhere(near)[:, ::-1] * self.grid.pitch_mm + np.asarray(self.grid.origin_mm)
        return float((nodes @ way + self.stored.values[near]).max())

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        values = sample(self.stored, plane_points(plane, z_mm))
        return values.astype(np.float32).reshape(plane.shape)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """Outlines that enclose at least a cell of the field's grid; smaller ones are noise."""
        loops = section_loops(self.cut(z_mm, plane), plane)
        return [loop for loop in loops if abs(loop_area_mm2(loop)) >= self.grid.pitch_mm**2]


def closest_points(field: Field, points: FloatArray) -> FloatArray:
    """The nearest of the surface points that the corners of each point's cell know, (n, 3) [mm].

    Where they know none, down the slope to the surface.

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
            found = closest_in_rows(field.surface_mm, rows[known], points[known])
            squared = ((found - points[known]) ** 2).sum(axis=1)
            nearer = squared < nearest[known]
            best[known[nearer]], nearest[known[nearer]] = found[nearer], squared[nearer]
    far = ~np.isfinite(nearest)
    if far.any():
        best[far] = onto_zero(
            lambda p: sample(field, p), lambda p: unit_rows(sample_gradient(field, p)),
            points[far], rounds=4,
        )
    return best


def unit_rows(vectors: FloatArray) -> FloatArray:
    """Rows (n, 3) at length 1; those of no length stay."""
    size = np.linalg.norm(vectors, axis=1)
    unit: FloatArray = vectors / np.maximum(size, 1e-12)[:, None]
    return unit


def without_slivers(corners: FloatArray) -> FloatArray:
    """Triangles (m, 3, 3) less those narrower than a millionth of their length.

    Their neighbours cover them to rounding, and the closest point on one cannot be computed.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    wide: FloatArray = corners[twice_area > 1e-6 * longest]
    return wide


def plane_points(plane: PlaneGrid, z_mm: float) -> FloatArray:
    """The nodes of a plane as points (ny·nx, 3) float64 [mm], in the array's own order."""
    yy, xx = np.meshgrid(plane.y_mm, plane.x_mm, indexing="ij")
    return np.stack([xx.ravel(), yy.ravel(), np.full(xx.size, float(z_mm))], axis=1)


def nothing_of(plane: PlaneGrid) -> NDArray[np.float32]:
    """The cut of a plane that misses the body: −inf at every node."""
    return np.full(plane.shape, -np.inf, dtype=np.float32)
