"""Weights of several bodies at a place where they overlap.

Source: docs/explanation/multi-colour-distance-field.md, Booleans.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.grid import Grid
from lmctl.part.bodies.body import Body
from lmctl.part.booleans.boundary import Boundary
from lmctl.part.booleans.expression import BooleanExpression, BooleanFormula, SignedLeaf
from lmctl.part.booleans.local_sides import LocalSides


@dataclass(frozen=True, eq=False)
class OverlapWeights:
    """Shares of overlapping bodies by relative distance to their pieces of surface.

    grid : holds the bodies' overlap
    """

    bodies: tuple[Body, ...]
    grid: Grid

    def weights(self, points: FloatArray) -> FloatArray:
        """(k, n) float64, each ≥ 0, columns summing to 1.

        A body alone has all. Where several overlap, each counts by the distance to the piece of its
        own surface that lies in others: there it begins or ends while they go on, so its share is 0
        there and nothing jumps. Where there is no body (a path may lie a rounding outside) the
        nearest has all.
        """
        points = np.asarray(points, dtype=np.float64)
        depths = np.stack([body.distance_bound(points) for body in self.bodies])
        deepest = depths.argmax(axis=0)
        weights = np.maximum(depths, 0.0)
        shared = np.flatnonzero((weights > 0).sum(axis=0) > 1)
        for number, body in enumerate(self.bodies):
            own = shared[weights[number, shared] > 0]
            if len(own):
                depth = body.distance_at(points[own])
                weights[number, own] = self._to_piece(number, points[own], depth)
        nothing = weights.sum(axis=0) <= 0.0
        weights[deepest[nothing], nothing] = 1.0
        return np.asarray(weights / weights.sum(axis=0))

    def _to_piece(self, number: int, points: FloatArray, depth: FloatArray) -> FloatArray:
        """Distance to the piece of one body's surface in the others; to all of it if none is."""
        piece = self._pieces[number]
        if len(piece.surface_points_mm) == 0:
            return depth
        closest = self.bodies[number].closest_points(points)
        elsewhere = np.flatnonzero(~piece.holds(closest))
        if len(elsewhere) == 0:
            return depth
        result, asked = depth.copy(), points[elsewhere]
        away = np.linalg.norm(piece.closest_points(asked) - asked, axis=1)
        result[elsewhere] = np.maximum(depth[elsewhere], away)
        return result

    @cached_property
    def _pieces(self) -> list[Boundary]:
        """For each body the piece of its surface that lies in the others.

        Faces that it shares with them are not of it: beyond them there is nothing to pass into.
        """
        pieces = []
        count = len(self.bodies)
        for number in range(count):
            sides = tuple(SignedLeaf(other, 1) for other in range(count) if other != number)
            others = BooleanFormula(False, sides)
            both = BooleanExpression(self.bodies,
                                     BooleanFormula(True, (SignedLeaf(number, 1), others)))
            cells = LocalSides(both, self.grid.pitch_mm)
            within = BooleanExpression(self.bodies, others)
            pieces.append(
                Boundary(both, partial(cells.is_on_boundary_piece, leaf=number, others=within),
                         self.grid))
        return pieces
