"""A surface as points on it, and the way from any place to its nearest point.

Every node of a grid near the surface looks for its nearest points on it, exactly: on one smooth
surface, on the crease of two, at the corner of three. These points are swept over the grid. A query
reads the points of the nodes around it and searches on among the surfaces they lie on. Memory grows
with the grid (four bytes a node) and with the surface, never with the number of queries.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.grid import Grid
from lmctl.field.sweep import propagate_closest_points
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import MAX_ACTIVE, Surface, SurfaceSet
from lmctl.part.booleans.blocks import NearbyLeaves, NodeBlocks
from lmctl.part.booleans.closest_candidates import (
    MAX_NEAR_SURFACES,
    closest_surfaces,
    corner_candidates,
    seed_nodes,
    select_closest_candidates,
)
from lmctl.part.booleans.expression import BooleanExpression

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

ContainsTest = Callable[[FloatArray], NDArray[np.bool_]]

#: Nodes this near a surface, in pitches, look for points on it: no surface passes all of them by.
BAND_PITCHES = 1.0

#: Points farther from a node than this, in pitches, are left to other nodes.
REACH_PITCHES = 2.0

#: Beyond so many pitches only the surfaces that the nearest known point lies on are searched.
FAR_PITCHES = 16.0

#: Nearer than so many pitches, so many of the nearest surface points are searched among all.
DIRECT_SEARCH_PITCHES = 6.0
NEAREST_POINTS_ASKED = 4

#: Of no more surface points than this the nearest are found at once from everywhere.
MAX_POINTS_FOR_DIRECT_SEARCH = 20_000

#: A place searches again nearer to the point it found, at these shares of the distance back: nodes
#: far away hold less precise points.
REFINEMENT_FRACTIONS = (0.1, 0.05, 0.0)

#: What comes this near to where it must end, in pitches, ends there.
CONVERGENCE_PITCHES = 0.05

#: Points searched for at a time.
POINTS_AT_ONCE = 100_000

#: Planes of nodes walked at a time.
SLAB_PLANES = 32


@dataclass(frozen=True, eq=False)
class Boundary:
    """A surface that is known only by evaluating distances.

    expression : of the body it bounds, or is a piece of the boundary of
    holds : whether points on the leaves' surfaces lie on this one, (n, 3) -> (n,)
    grid : holds all of the surface, or all of it that matters
    """

    expression: BooleanExpression
    holds: ContainsTest
    grid: Grid

    @property
    def surface_points_mm(self) -> FloatArray:
        """(n, 3) float64 [mm], points on the surface; none where there is no surface."""
        return self._found[0]

    def find_bounds(self, box: Bounds) -> Bounds:
        """Where the surface begins and ends along x, y, z; in a box that holds it.

        Points lie beside an outermost one: what comes near to the box's end, ends there.
        """
        low, high = self.surface_points_mm.min(axis=0), self.surface_points_mm.max(axis=0)
        near = CONVERGENCE_PITCHES * self.grid.pitch_mm
        return np.where(low - box[0] < near, box[0], low), np.where(
            box[1] - high < near, box[1], high)

    def closest_points(self, points: FloatArray) -> FloatArray:
        """The point of the surface nearest to each of points (n, 3) -> (n, 3) float64 [mm].

        There must be a surface.
        """
        result = np.empty((len(points), 3))
        for first in range(0, len(points), POINTS_AT_ONCE):
            part = slice(first, first + POINTS_AT_ONCE)
            result[part] = self._nearest(np.ascontiguousarray(points[part]))
        return result

    def _nearest(self, points: FloatArray) -> FloatArray:
        closest_mm, active = self._found
        rows, near = self._looked(points)
        closest = closest_mm[rows]
        best = np.linalg.norm(closest - points, axis=1)
        far = best >= FAR_PITCHES * self.grid.pitch_mm
        close = np.flatnonzero(~far)
        asked, least = points[close], best[close]
        for among, at in self._searched(asked, near[close], closest[close], least):
            found = np.linalg.norm(at - asked[among], axis=1)
            nearer = found < least[among]
            least[among[nearer]] = found[nearer]
            closest[close[among[nearer]]] = at[nearer]
        away = np.flatnonzero(far)
        if len(away):
            at, good = self._surfaces.closest_points(
                points[away], closest[away], active[rows[away]].astype(np.int64), best[away])
            away, at = away[good], at[good]
            good = self.holds(at)
            closest[away[good]] = at[good]
        return closest

    def _looked(self, points: FloatArray) -> tuple[IntArray, IntArray]:
        """The closest point, from the points stored at nodes if it is far; and the surfaces met
        around it and around the point."""
        closest_mm, active = self._found
        own = self._in_nodes(points)
        rows = np.full(len(points), -1, dtype=np.int64)
        near = np.full((len(points), MAX_NEAR_SURFACES), -1, dtype=np.int64)
        known = corner_candidates(self._sources, own)
        select_closest_candidates(known, closest_mm, active, points, rows, near.copy())
        last = np.asarray(self.grid.shape[::-1]) - 1
        away = np.linalg.norm(closest_mm[rows] - points, axis=1)
        asked = np.any((own < 0) | (own > last), axis=1)
        asked |= away < DIRECT_SEARCH_PITCHES * self.grid.pitch_mm
        asked |= len(closest_mm) <= MAX_POINTS_FOR_DIRECT_SEARCH
        for share in REFINEMENT_FRACTIONS:
            near[:] = -1
            there = closest_mm[rows] + share * (points - closest_mm[rows])
            found = corner_candidates(self._sources, self._in_nodes(there))
            select_closest_candidates(found, closest_mm, active, points, rows, near)
        if asked.any():
            count = min(NEAREST_POINTS_ASKED, len(closest_mm))
            _, nearest = self._tree.query(points[asked], k=[*range(1, count + 1)])
            own_rows, own_near = rows[asked], np.full((len(nearest), MAX_NEAR_SURFACES), -1)
            select_closest_candidates(nearest.astype(np.int32), closest_mm, active, points[asked],
                                      own_rows,
                                      own_near)
            rows[asked], near[asked] = own_rows, own_near
        select_closest_candidates(known, closest_mm, active, points, rows, near)
        return rows, near

    def _in_nodes(self, points: FloatArray) -> FloatArray:
        nodes: FloatArray = (points - np.asarray(self.grid.origin_mm)) / self.grid.pitch_mm
        return nodes

    @cached_property
    def _tree(self) -> cKDTree:
        """For places beside the surface, where nodes are too coarse, or outside the grid."""
        from scipy.spatial import cKDTree  # late: few bodies need it

        return cKDTree(self.surface_points_mm)

    def _searched(
        self, points: FloatArray, near: IntArray, start: FloatArray, within_mm: FloatArray
    ) -> Iterator[tuple[IntArray, FloatArray]]:
        """Points of the surface among near surfaces (n, MOST_NEAR), −1 for none.

        within_mm : (n,), how far away they may be; the caller may shrink it between results
        Yields rows and the points found for them: on one surface each, then on two, on three.
        """
        surfaces = self._surfaces
        away = np.stack([
            np.where(which < 0, np.inf, surfaces.distances_to(points, which)) for which in near.T
        ])
        for count in range(1, MAX_ACTIVE + 1):
            for slots in combinations(range(MAX_NEAR_SURFACES), count):
                # Where surfaces meet is no nearer than the farthest of them.
                rows = np.flatnonzero(away[list(slots)].max(axis=0) < within_mm)
                if len(rows) == 0:
                    continue
                active = np.full((len(rows), MAX_ACTIVE), -1, dtype=np.int64)
                active[:, :count] = near[rows][:, slots]
                at, good = surfaces.closest_points(points[rows], start[rows], active,
                                                   within_mm[rows])
                rows, at = rows[good], at[good]
                good = self.holds(at)
                if good.any():
                    yield rows[good], at[good]

    def _lain_on(self, points: FloatArray, near: IntArray) -> NDArray[np.int32]:
        """The surfaces that points lie on, (n, MOST_ACTIVE), −1 for none, of those near."""
        surfaces = self._surfaces
        away = np.stack([surfaces.distances_to(points, which) for which in near.T], axis=1)
        found = np.where(away <= surfaces.surface_tolerance_mm[near], near, -1)
        order = np.argsort(found < 0, axis=1, kind="stable")[:, :MAX_ACTIVE]
        return np.take_along_axis(found, order, axis=1).astype(np.int32)

    @cached_property
    def _numbered(self) -> tuple[SurfaceSet, list[list[int]], list[int]]:
        """Every leaf's surfaces, each once, and which of them each leaf has; last its rest or −1"""
        numbers: dict[Surface, int] = {}
        of_leaf, rests = [], []
        for leaf in self.expression.leaves:
            of_leaf.append(
                [numbers.setdefault(surface, len(numbers)) for surface, _ in leaf.surfaces])
            rests.append(
                -1 if leaf.remaining_surface is None else numbers.setdefault(leaf.remaining_surface,
                                                                             len(numbers)))
        return SurfaceSet(tuple(numbers), self.grid.pitch_mm), of_leaf, rests

    @property
    def _surfaces(self) -> SurfaceSet:
        return self._numbered[0]

    @cached_property
    def _found(self) -> tuple[FloatArray, NDArray[np.int32]]:
        """Points on the surface, (n, 3) float64 [mm], and the surfaces they lie on."""
        closest, active = [np.empty((0, 3))], [np.empty((0, MAX_ACTIVE), np.int32)]
        reach = REACH_PITCHES * self.grid.pitch_mm
        for points, near in _gathered(self._nodes()):
            within = np.full(len(points), reach)
            for rows, at in self._searched(points, near, points, within):
                closest.append(at)
                active.append(self._lain_on(at, near[rows]))
        return np.concatenate(closest), np.concatenate(active)

    def _nodes(self) -> Iterator[tuple[FloatArray, IntArray]]:
        """Nodes near the surface and the surfaces near each, (n, MOST_NEAR)."""
        band = BAND_PITCHES * self.grid.pitch_mm
        for window in self.grid.slabs(SLAB_PLANES):
            blocks = NodeBlocks(self.expression, window)
            bounds = blocks.leaf_bounds_at_centres_mm()
            which = np.flatnonzero(
                np.abs(self.expression.evaluate(bounds)) <= blocks.radius_mm + band)
            bounds = bounds[:, which]
            near = np.abs(bounds) <= blocks.radius_mm + band
            for _, found in blocks.iterate_nearby(which, bounds, near):
                kept = np.abs(self.expression.evaluate(found.leaf_bounds_mm)) <= band
                kept = np.broadcast_to(kept, found.points.shape[:2])
                points = found.points[kept]
                if len(points):
                    yield points, self._near(points, found, kept, band)

    def _near(
        self, points: FloatArray, found: NearbyLeaves, kept: NDArray[np.bool_], band: float
    ) -> IntArray:
        """The surfaces near points, of the leaves that are."""
        rows, which, away = [], [], []
        surfaces, of_leaf, rests = self._numbered
        for leaf, (numbers, rest) in enumerate(zip(of_leaf, rests, strict=True)):
            if not found.is_leaf_near[leaf].any():
                continue
            depth = np.abs(found.leaf_bounds_mm[leaf][kept])
            asked = np.flatnonzero(depth <= band)
            left = np.ones(len(points), dtype=bool)
            for number in [*numbers, rest] if rest >= 0 else numbers:
                if number == rest:
                    asked = asked[left[asked]]
                distance = np.abs(surfaces.surfaces[number].distance_at(points[asked]))
                left[asked[np.abs(
                    distance - depth[asked]) <= surfaces.surface_tolerance_mm[number]]] = False
                own = distance <= band
                rows.append(asked[own])
                which.append(np.full(int(own.sum()), number))
                away.append(distance[own])
        if not rows:
            return np.full((len(points), MAX_NEAR_SURFACES), -1, dtype=np.int64)
        return closest_surfaces(
            np.concatenate(rows), np.concatenate(which), np.concatenate(away), len(points)
        )

    @cached_property
    def _sources(self) -> NDArray[np.int32]:
        """(nz, ny, nx) int32: the surface point nearest to each node."""
        closest = self.surface_points_mm
        sources = np.full(self.grid.shape, -1, dtype=np.int32)
        squared = np.full(self.grid.shape, np.inf, dtype=np.float32)
        seed_nodes(self._in_nodes(closest), sources, squared)
        del squared
        propagate_closest_points(sources, closest, self.grid)
        return sources


def _gathered(
    found: Iterator[tuple[FloatArray, IntArray]]
) -> Iterator[tuple[FloatArray, IntArray]]:
    """The same, joined into larger pieces of at least `POINTS_AT_ONCE` points."""
    points: list[FloatArray] = []
    near: list[IntArray] = []
    for some, their in found:
        points.append(some)
        near.append(their)
        if sum(map(len, points)) >= POINTS_AT_ONCE:
            yield np.concatenate(points), np.concatenate(near)
            points, near = [], []
    if points:
        yield np.concatenate(points), np.concatenate(near)
