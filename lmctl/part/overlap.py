"""How much each of several bodies has to say at a place where they overlap (method.md 4)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.field.grid import Grid
from lmctl.part.bodies import Body
from lmctl.part.boundary import Boundary
from lmctl.part.operands import ON_SURFACE, Operands, alone

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Overlap:
    """Shares of overlapping bodies by relative distance to their pieces of surface.

    grid : holds the bodies' overlap
    """

    bodies: tuple[Body, ...]
    grid: Grid

    def shares(self, points: FloatArray) -> FloatArray:
        """(k, n) float64, each ≥ 0, columns summing to 1.

        A body alone has all; two that overlap share by the distance to the pieces of their
        surfaces that lie in each other, more than two by their depths. Where there is no body
        (a path may lie a rounding outside) the nearest has all.
        """
        points = np.asarray(points, dtype=np.float64)
        depths = np.stack([body.bound(points) for body in self.bodies])
        for depth, body in zip(depths, self.bodies, strict=True):
            inside = np.flatnonzero(depth > 0)
            depth[inside] = body.at(points[inside])
        deepest = depths.argmax(axis=0)
        weights = np.maximum(depths, 0.0)
        if len(self.bodies) == 2:
            both = np.flatnonzero((weights > 0).all(axis=0))
            for number in range(2):
                weights[number, both] = self._to_piece(number, points[both], weights[number, both])
        nothing = weights.sum(axis=0) <= 0.0
        weights[deepest[nothing], nothing] = 1.0
        return np.asarray(weights / weights.sum(axis=0))

    def _to_piece(self, number: int, points: FloatArray, depth: FloatArray) -> FloatArray:
        """Distance to the piece of one body's surface in the other; to all of it if none is."""
        piece = self._pieces[number] if len(points) else None
        if piece is None:
            return depth
        other = self.bodies[1 - number]
        feet = self.bodies[number].feet(points)
        elsewhere = np.flatnonzero(other.at(feet) < self._slack)
        if len(elsewhere) == 0:
            return depth
        result, asked = depth.copy(), points[elsewhere]
        start = piece.data[piece.query(asked)[1]]
        at, found = self._operands.settle(asked, start, alone(np.full(len(asked), number)))
        away, least = np.linalg.norm(start - asked, axis=1), np.linalg.norm(at - asked, axis=1)
        better = found & (least < away) & (other.at(at) >= -self._slack)
        result[elsewhere] = np.maximum(depth[elsewhere], np.where(better, least, away))
        return result

    @cached_property
    def _operands(self) -> Operands:
        return Operands.of("intersection", self.bodies, self.grid.pitch_mm)

    @property
    def _slack(self) -> float:
        return ON_SURFACE * self.grid.pitch_mm

    @cached_property
    def _pieces(self) -> list[cKDTree | None]:
        """For each body the points of its surface that lie in the other, if there are any.

        Faces that the two share are of neither piece: beyond them there is nothing to pass into.
        """
        boundary = Boundary(self._operands, self.grid)
        pieces: list[cKDTree | None] = []
        for number in range(2):
            feet = boundary.feet_mm[boundary.active[:, 0] == number]
            feet = feet[self.bodies[1 - number].at(feet) > self._slack] if len(feet) else feet
            pieces.append(cKDTree(feet) if len(feet) else None)
        return pieces
