"""Several bodies as one: union, difference, intersection.

Source: docs/explanation/multi-colour-distance-field.md, Booleans.

Least and greatest of distances have the right zero level but are not distances (a union of two
10 mm discs 12 mm apart gives 4 mm where 8 is right). They are right wherever the surface point they
measure to is on the result's own boundary. Logic decides that at most places, and the boundary's
shape at most others; the remaining places query the boundary. So no body is resampled to another's
grid: each is evaluated at its own pitch, and only the boundary's location is stored. A boolean of
booleans is one boolean of their leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray, SignArray
from lmctl.errors import InputError
from lmctl.field.grid import Grid, Window
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.bodies.analytic import AnalyticBody
from lmctl.part.bodies.body import Body, empty_section
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface, places_by_number
from lmctl.part.booleans.blocks import VALUES_AT_ONCE, NodeBlocks
from lmctl.part.booleans.boundary import Boundary
from lmctl.part.booleans.expression import (
    BooleanExpression,
    BooleanFormula,
    Operation,
    SignedLeaf,
    combine,
    expression_of,
)
from lmctl.part.booleans.local_sides import LocalSides
from lmctl.part.booleans.outlines import combined_outline

__all__ = ["CombinedBody", "Operation"]

#: Planes of a window evaluated at a time.
SLAB_PLANES = 8


@dataclass(frozen=True, eq=False)
class CombinedBody(AnalyticBody):
    """Bodies made one; a difference takes all others from the first.

    grid : holds the result; on it its boundary is looked for
    """

    operation: Operation
    bodies: tuple[Body, ...]
    grid: Grid

    @cached_property
    def expression(self) -> BooleanExpression:
        return combine(self.operation, [expression_of(body) for body in self.bodies])

    def transformed(self, carry: Callable[[Body], Body], grid: Grid) -> CombinedBody:
        """The same boolean of the bodies transformed, each by `carry`."""
        bodies = tuple(
            body.transformed(carry, grid) if isinstance(body, CombinedBody) else carry(body)
            for body in self.bodies
        )
        return CombinedBody(self.operation, bodies, grid)

    @cached_property
    def boundary(self) -> Boundary:
        """Raises InputError where nothing is left to have a boundary."""
        boundary = Boundary(self.expression, self._cells.is_on_boundary, self.grid)
        if len(boundary.surface_points_mm) == 0:
            raise InputError(
                f"the {self.operation} of the bodies leaves nothing",
                where=f"at a pitch of {self.grid.pitch_mm:g} mm",
                hint="check where the bodies lie, or give a smaller pitch_mm",
            )
        return boundary

    @cached_property
    def _cells(self) -> LocalSides:
        return LocalSides(self.expression, self.grid.pitch_mm)

    @property
    def distance_bound_is_exact(self) -> bool:
        return False

    @property
    def surface_tolerance_mm(self) -> float:
        return max(leaf.surface_tolerance_mm for leaf in self.expression.leaves)

    @cached_property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        leaves = self.expression.leaves
        return tuple(dict.fromkeys(
            (surface, sign * side)
            for leaf, side in self.expression.signed_leaves() for surface,
            sign in leaves[leaf].surfaces
        ))

    @property
    def enclosing_box_mm(self) -> Bounds:
        return self.expression.enclosing_box_mm

    @cached_property
    def tight_bounds_mm(self) -> Bounds:
        """Of a union of leaves, exactly theirs; else of its boundary, and as much farther as the
        allowances of leaves may move its outlines."""
        formula = self.expression.formula
        if isinstance(formula, BooleanFormula) and not formula.requires_all and all(
            isinstance(part, SignedLeaf) and part.sign > 0 for part in formula.operands
        ):
            lows, highs = zip(*(leaf.tight_bounds_mm for leaf in self.expression.leaves),
                              strict=True)
            return np.min(lows, axis=0), np.max(highs, axis=0)
        low, high = self.boundary.find_bounds(self.enclosing_box_mm)
        out_mm = self.expression.outward_allowance_mm()
        if out_mm > 0.0:
            around = np.array([out_mm, out_mm, 0.0])
            low = np.maximum(low - around, np.minimum(low, self.enclosing_box_mm[0]))
            high = np.minimum(high + around, np.maximum(high, self.enclosing_box_mm[1]))
        return low, high

    def distance_at(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth = np.empty(len(points))
        for part in self._parts(len(points)):
            rows, near = self._bounds(points[part])
            depth[part] = self._depths(points[part][None], rows, near)[0]
        return depth

    def distance_bound(self, points: FloatArray) -> FloatArray:
        """Least and greatest of the leaves' distances, corrected on faces that they share."""
        points = np.asarray(points, dtype=np.float64)
        depth = np.empty(len(points))
        for part in self._parts(len(points)):
            found = self.expression.evaluate(self._bounds(points[part])[0])[0]
            depth[part] = self._cells.depth_on_shared_faces(points[part], found)
        return depth

    def closest_points(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        closest = np.empty_like(points)
        for part in self._parts(len(points)):
            closest[part] = self._closest_on_leaf_or_boundary(points[part])[0]
        return closest

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """The direction of the leaf that is measured to, or to and from the boundary itself."""
        points = np.asarray(points, dtype=np.float64)
        result = np.empty_like(points)
        for part in self._parts(len(points)):
            asked = points[part]
            closest, which, depth, side = self._closest_on_leaf_or_boundary(asked)
            toward = np.where(depth > 0, 1.0, -1.0)[:, None] * (asked - closest)
            size = np.linalg.norm(toward, axis=1)
            by_leaf = (which >= 0) | (size < 1e-9)
            toward /= np.where(by_leaf, 1.0, size)[:, None]
            for number, own in places_by_number(np.where(by_leaf, which, -1)):
                found = self.expression.leaves[number].inward_directions(asked[own])
                toward[own] = side[own, None] * found
            result[part] = toward
        return result

    def distance(self, window: Window) -> NDArray[np.float32]:
        values = np.empty(window.shape, dtype=np.float32)
        for first in range(0, window.shape[0], SLAB_PLANES):
            last = min(first + SLAB_PLANES, window.shape[0])
            slab = Window(window.grid, window.z_first + first, window.z_first + last)
            self._fill(values[first:last], NodeBlocks(self.expression, slab))
        return values

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        loops = self.outline_loops(z_mm, plane)
        return plane_distance(loops, plane) if loops else empty_section(plane)

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return combined_outline(self.expression, z_mm, plane, self._cells.shared_face_tolerance_mm)

    def _fill(self, values: NDArray[np.float32], blocks: NodeBlocks) -> None:
        bounds = blocks.leaf_bounds_at_centres_mm()
        # No place in a block measures to what is farther from its middle than this.
        reach = np.abs(self.expression.evaluate(bounds)) + 2.0 * blocks.radius_mm
        near = np.abs(bounds) <= reach
        found = np.empty((len(blocks.first_node_indices), len(blocks.node_offsets)),
                         dtype=np.float32)
        for some, what in blocks.iterate_nearby(np.arange(len(found)), bounds, near):
            found[some] = self._depths(what.points, what.leaf_bounds_mm, what.is_leaf_near)
        values[:] = blocks.assemble(found)

    def _depths(
        self, points: FloatArray, rows: list[FloatArray], near: NDArray[np.bool_]
    ) -> FloatArray:
        """Signed distance at points (b, m, 3) in blocks.

        rows, near : as `blocks.NearbyLeaves` has them
        """
        self._exactly(points, rows, near)
        depth = np.array(np.broadcast_to(self.expression.evaluate(rows), points.shape[:2]))
        several = np.flatnonzero(near.sum(axis=0) > 1)
        if len(several) == 0:
            return depth
        close = depth[several]
        measured = [row[several] for row in rows]
        which, sides, open_ = self._cells.uncertain_depths(close, measured, near[:, several])
        b, m = np.nonzero(open_)
        if len(b):
            asked, which = points[several[b], m], which[b, m]
            closest = self._closest_on_leaves(asked, which)
            hidden = np.flatnonzero(~self._cells.is_on_boundary(closest, which, _at(sides, b, m)))
            if len(hidden):
                nearest = self.boundary.closest_points(asked[hidden])
                away = np.linalg.norm(asked[hidden] - nearest, axis=1)
                b, m = b[hidden], m[hidden]
                own = self._cells.depth_on_shared_faces(asked[hidden], close[b, m])
                close[b, m] = np.copysign(np.maximum(away, np.abs(own)), own)
                depth[several] = close
        return depth

    def _exactly(
        self, points: FloatArray, rows: list[FloatArray], near: NDArray[np.bool_]
    ) -> None:
        """Compute exact distances of leaves with inexact bounds where the formula selects these."""
        inexact = [
            number for number, leaf in enumerate(self.expression.leaves)
            if not leaf.distance_bound_is_exact and near[number].any()
        ]
        asked = {number: np.zeros(points.shape[:2], dtype=bool) for number in inexact}
        while inexact:
            size = np.abs(self.expression.evaluate(rows))
            done = True
            for number in inexact:
                wanted = (np.abs(rows[number]) == size) & ~asked[number]
                if wanted.any():
                    rows[
                        number][wanted] = self.expression.leaves[number].distance_at(points[wanted])
                    asked[number] |= wanted
                    done = False
            if done:
                return

    def _closest_on_leaves(self, points: FloatArray, which: IntArray) -> FloatArray:
        closest = np.empty_like(points)
        for number, own in places_by_number(which):
            closest[own] = self.expression.leaves[number].closest_points(points[own])
        return closest

    def _closest_on_leaf_or_boundary(
        self, points: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
        """Nearest points (n, 3); the leaf whose they are, −1 where another hides its own; the
        formula's depth; and whether depths grow with that leaf's (1, else −1)."""
        rows, near = self._bounds(points)
        self._exactly(points[None], rows, near)
        depth = np.array(np.broadcast_to(self.expression.evaluate(rows), (1, len(points))))
        which, sides, open_ = self._cells.uncertain_depths(depth, rows, near)
        depth, which = depth[0], which[0]
        measured = np.concatenate(rows)[which, np.arange(len(points))]
        side = np.where((measured > 0) == (depth > 0), 1.0, -1.0)
        closest = self._closest_on_leaves(points, which)
        hidden = np.flatnonzero(open_[0])
        if len(hidden):
            known = _at(sides, np.zeros_like(hidden), hidden)
            hidden = hidden[~self._cells.is_on_boundary(closest[hidden], which[hidden], known)]
        if len(hidden):
            closest[hidden] = self.boundary.closest_points(points[hidden])
            depth[hidden] = self._cells.depth_on_shared_faces(points[hidden], depth[hidden])
            which[hidden] = -1
        return closest, which, depth, side

    def _bounds(self, points: FloatArray) -> tuple[list[FloatArray], NDArray[np.bool_]]:
        """What the leaves' bounds are at points, all of which make one block."""
        rows = [leaf.distance_bound(points)[None] for leaf in self.expression.leaves]
        return rows, np.ones((len(rows), 1), dtype=bool)

    def _parts(self, count: int) -> list[slice]:
        at_once = max(1, VALUES_AT_ONCE // len(self.expression.leaves))
        return [slice(first, first + at_once) for first in range(0, count, at_once)]


def _at(rows: Sequence[SignArray], b: IntArray, m: IntArray) -> SignArray:
    """What rows, (b, m) or (b, 1), hold at places, one row each."""
    return np.stack([row[b, m if row.shape[1] > 1 else 0] for row in rows])
