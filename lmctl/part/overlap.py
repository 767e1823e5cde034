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
from lmctl.part.operands import Operands

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
        depths = np.stack([body.at(points) for body in self.bodies])
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
        tree = self._pieces[number] if len(points) else None
        if tree is None:
            return depth
        hidden = np.flatnonzero(self.bodies[1 - number].at(self.bodies[number].feet(points)) < 0)
        result = depth.copy()
        if len(hidden):
            result[hidden] = np.maximum(depth[hidden], tree.query(points[hidden])[0])
        return result

    @cached_property
    def _pieces(self) -> list[cKDTree | None]:
        """For each body the points on its piece of the overlap's boundary, if it has any."""
        operands = Operands.of("intersection", self.bodies, self.grid.pitch_mm)
        boundary = Boundary(operands, self.grid)
        pieces: list[cKDTree | None] = []
        for number in range(2):
            feet = boundary.feet_mm[(boundary.active == number).any(axis=1)]
            pieces.append(cKDTree(feet) if len(feet) else None)
        return pieces
