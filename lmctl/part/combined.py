"""Several bodies as one: union, difference, intersection (method.md 4).

`min` and `max` of distances have the right zero level but are not distances (a union of two 10 mm
discs 12 mm apart gives 4 mm where 8 is right). They are right wherever the surface point they
measure to is on the result's own boundary; elsewhere the boundary is asked. So no body is brought
to another's grid: each answers at its own pitch, and only the boundary's whereabouts are stored.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.plane import PlaneGrid
from lmctl.part.analytic import Analytic
from lmctl.part.bodies import Body
from lmctl.part.boundary import Boundary
from lmctl.part.measured import Bounds
from lmctl.part.operands import ON_SURFACE, STEPS_OUT, Operands, Operation, alone

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

__all__ = ["Combined", "Operation"]


@dataclass(frozen=True, eq=False)
class Combined(Analytic):
    """Bodies made one; a difference takes all others from the first.

    grid : holds the result; on it its boundary is looked for
    """

    operation: Operation
    bodies: tuple[Body, ...]
    grid: Grid

    @cached_property
    def operands(self) -> Operands:
        return Operands.of(self.operation, self.bodies, self.grid.pitch_mm)

    @cached_property
    def boundary(self) -> Boundary:
        """Raises InputError where nothing is left to have a boundary."""
        boundary = Boundary(self.operands, self.grid)
        if len(boundary.feet_mm) == 0:
            raise InputError(
                f"the {self.operation} of the bodies leaves nothing",
                where=f"at a pitch of {self.grid.pitch_mm:g} mm",
                hint="check where the bodies lie, or give a smaller pitch_mm",
            )
        return boundary

    @cached_property
    def bounds_mm(self) -> Bounds:
        """Of a union, exactly those of its bodies; else of its boundary."""
        bounds = [body.bounds_mm for body in self.bodies]
        if self.operation == "union":
            return np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
        own = bounds if self.operation == "intersection" else bounds[:1]
        least, most = np.max([b[0] for b in own], axis=0), np.min([b[1] for b in own], axis=0)
        low, high = self.boundary.feet_mm.min(axis=0), self.boundary.feet_mm.max(axis=0)
        # Feet lie beside an outermost place: what comes this near to its body's end, ends there.
        slack = STEPS_OUT[0] * self.grid.pitch_mm
        low = np.where(low - least < slack, least, low)
        return low, np.where(most - high < slack, most, high)

    def at(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        depth, _, hidden = self._looked(points)
        if len(hidden):
            feet = self.boundary.nearest(points[hidden])
            away = np.linalg.norm(points[hidden] - feet, axis=1)
            depth[hidden] = np.maximum(depth[hidden], away)
        return self.operands.result * depth

    def bound(self, points: FloatArray) -> FloatArray:
        """What min and max of the bodies' distances say."""
        return self.operands.result * self.operands.bound(np.asarray(points, dtype=np.float64))

    def feet(self, points: FloatArray) -> FloatArray:
        points = np.asarray(points, dtype=np.float64)
        _, deepest, hidden = self._looked(points)
        shown = np.ones(len(points), dtype=bool)
        shown[hidden] = False
        feet = np.empty_like(points)
        feet[shown] = self.operands.feet(points[shown], deepest[shown])
        if len(hidden):
            feet[hidden] = self.boundary.nearest(points[hidden])
        return feet

    def inward(self, points: FloatArray) -> FloatArray:
        """The deepest body's direction, or away from the boundary that another hides."""
        points = np.asarray(points, dtype=np.float64)
        _, deepest, hidden = self._looked(points)
        result = np.empty_like(points)
        for number in np.unique(deepest):
            own = deepest == number
            result[own] = self.operands.signs[number] * self.bodies[number].inward(points[own])
        if len(hidden):
            away = points[hidden] - self.boundary.nearest(points[hidden])
            size = np.linalg.norm(away, axis=1)
            clear = size > 1e-9
            result[hidden[clear]] = away[clear] / size[clear, None]
        return self.operands.result * result

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        cuts = [body.cut(z_mm, plane) for body in self.bodies]
        if self.operation == "union":
            return reduce(np.maximum, cuts)
        if self.operation == "intersection":
            return reduce(np.minimum, cuts)
        return reduce(np.minimum, [cuts[0], *(-cut for cut in cuts[1:])])

    def _looked(self, points: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
        """Depth in the union of operands, by the deepest of them; which that is; and the rows
        whose nearest point there is hidden in another, so that they are deeper than that."""
        values = self.operands.values(points)
        deepest = values.argmax(axis=0)
        columns = np.arange(len(points))
        depth = values[deepest, columns]
        values[deepest, columns] = -np.inf
        # A ball of that depth around the place reaches into no other body: nothing can be hidden.
        slack = ON_SURFACE * self.grid.pitch_mm
        asked = np.flatnonzero((depth > 0) & (values.max(axis=0) > -depth - slack))
        if len(asked) == 0:
            return depth, deepest, asked
        met = alone(deepest[asked])
        feet = self.operands.feet(points[asked], deepest[asked])
        hidden = self.operands.covering(feet, met) >= 0
        open_ = np.flatnonzero(~hidden)
        hidden[open_] = ~self.operands.exposed(feet[open_], met[open_])
        return depth, deepest, asked[hidden]
