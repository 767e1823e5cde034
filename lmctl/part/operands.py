"""Any boolean as one: what a point must leave to come out of several bodies (method.md 4).

A union is left where all bodies are left. An intersection is what remains when the union of the
bodies' outsides is taken away, a difference when the others and the outside of the first are. So
every operation is a union of bodies, some of them inside out, and its result is that union or all
but it. The depth of a place in such a union is at least the largest of its depths in the bodies,
and *is* that depth wherever the surface point it is measured to lies in no other body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.part.analytic import Analytic
from lmctl.part.bodies import Body, Stored
from lmctl.part.depth import unit_slope

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Operation = Literal["union", "difference", "intersection"]

#: Surfaces that may meet at one point: a crease has two, a corner three.
MOST_ACTIVE = 3

#: A point counts as on a surface within this share of the pitch.
ON_SURFACE = 0.02

#: Steps out of a surface, in pitches: a long one that no noise of a field hides, then, for narrow
#: places, shorter ones.
STEPS_OUT = (0.05, 0.01, 0.002)

#: How far outside a step out must lead, of its length: creases narrower than 2° are not seen.
LEAST_OUT = 0.02

#: The longest step of a search, in pitches, and how many there are at most.
LONGEST_STEP = 4.0
MOST_STEPS = 12


@dataclass(frozen=True)
class Operands:
    """Bodies, each the right way round (sign 1) or inside out (−1), as a union.

    result : 1 where the operation's result is that union, −1 where it is all but it
    pitch_mm : to which tolerances are related
    """

    bodies: tuple[Body, ...]
    signs: tuple[int, ...]
    result: int
    pitch_mm: float

    @staticmethod
    def of(operation: Operation, bodies: tuple[Body, ...], pitch_mm: float) -> Operands:
        if operation == "union":
            return Operands(bodies, (1,) * len(bodies), 1, pitch_mm)
        others = 1 if operation == "difference" else -1
        return Operands(bodies, (-1, *[others] * (len(bodies) - 1)), -1, pitch_mm)

    def values(self, points: FloatArray) -> FloatArray:
        """Depth in each body, (k, n) float64 [mm]: positive inside as it stands.

        True where it is positive or the deepest; elsewhere it may be less deep outside than it is,
        which spares asking bodies that are far away.
        """
        found = np.empty((len(self.bodies), len(points)))
        asked = np.zeros(found.shape, dtype=bool)
        for row, body, sign in zip(found, self.bodies, self.signs, strict=True):
            np.multiply(body.bound(points), sign, out=row)
        columns = np.arange(len(points))
        while True:
            wanted = found > 0
            wanted[found.argmax(axis=0), columns] = True
            wanted &= ~asked
            if not wanted.any():
                return found
            for number, (body, sign) in enumerate(zip(self.bodies, self.signs, strict=True)):
                rows = np.flatnonzero(wanted[number])
                if len(rows) and not self._exact[number]:
                    found[number, rows] = sign * body.at(points[rows])
            asked |= wanted

    def bound(self, points: FloatArray) -> FloatArray:
        """Depth in the union by `max` alone: of the right sign, and at most as large as it is."""
        deepest = np.full(len(points), -np.inf)
        for body, sign in zip(self.bodies, self.signs, strict=True):
            np.maximum(deepest, sign * body.bound(points), out=deepest)
        return deepest

    @cached_property
    def _exact(self) -> tuple[bool, ...]:
        """Of which bodies `bound` is the distance already."""
        return tuple(
            type(body).bound in (Analytic.bound, Stored.bound) for body in self.bodies
        )

    def feet(self, points: FloatArray, which: IntArray) -> FloatArray:
        """The nearest surface point of one body each: `which` (n,) are their numbers."""
        feet = np.empty_like(points)
        for number in np.unique(which):
            own = which == number
            feet[own] = self.bodies[number].feet(points[own])
        return feet

    def settle(
        self, points: FloatArray, start: FloatArray, active: IntArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The point nearest to each of `points` at which all its active surfaces meet.

        start : (n, 3) [mm], near it; active : (n, MOST_ACTIVE) numbers of bodies, −1 for none
        returns : (n, 3) [mm] and whether each was found

        Gauss–Newton on the conditions of the nearest point: it lies on the surfaces, and what leads
        there is a sum of their normals.
        """
        at = start.copy()
        rows = np.arange(len(points))
        longest = LONGEST_STEP * self.pitch_mm
        for _ in range(MOST_STEPS):
            value, normal = self._active(at[rows], active[rows])
            way = at[rows] - points[rows]
            gram = normal @ normal.transpose(0, 2, 1)
            gram[:, range(MOST_ACTIVE), range(MOST_ACTIVE)] += np.where(active[rows] < 0, 1.0, 1e-9)
            right = np.einsum("nij,nj->ni", normal, way) - value
            share = np.linalg.solve(gram, right[..., None])
            target = points[rows] + (normal * share).sum(axis=1)
            step = target - at[rows]
            size = np.linalg.norm(step, axis=1)
            at[rows] += step * np.minimum(1.0, longest / np.maximum(size, 1e-300))[:, None]
            rows = rows[size > 1e-3 * ON_SURFACE * self.pitch_mm]
            if len(rows) == 0:
                break
        value, _ = self._active(at, active, normals=False)
        return at, np.abs(value).max(axis=1) <= ON_SURFACE * self.pitch_mm

    def exposed(self, points: FloatArray, active: IntArray) -> NDArray[np.bool_]:
        """Whether a point on its active surfaces lies on the boundary of the union.

        It does when a small step out of all of them leads out of every body: faces that only touch
        have no such step, and what another body covers has none either.
        """
        exposed = np.zeros(len(points), dtype=bool)
        for share in STEPS_OUT:
            rows = np.flatnonzero(~exposed)
            if len(rows) == 0:
                break
            exposed[rows] = self._leads_out(points[rows], active[rows], share * self.pitch_mm)
        return exposed

    def _leads_out(self, points: FloatArray, active: IntArray, step: float) -> NDArray[np.bool_]:
        """Whether a step of this length [mm], out of all active surfaces, ends outside all."""
        out = np.zeros_like(points)
        for number in np.unique(active[active >= 0]):
            rows = np.flatnonzero((active == number).any(axis=1))
            out[rows] -= self.signs[number] * self._slope(number, points[rows], step)
        size = np.linalg.norm(out, axis=1)
        there = points + out * (step / np.maximum(size, 1e-12))[:, None]
        left: NDArray[np.bool_] = self.bound(there) < -LEAST_OUT * step
        out_of_all: NDArray[np.bool_] = left & (size > LEAST_OUT)
        return out_of_all

    def _slope(self, number: int, points: FloatArray, step_mm: float) -> FloatArray:
        """How a body's depth grows around points; on its own edges and corners, between faces."""
        at = self.bodies[number].bound
        slope = np.empty_like(points)
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = step_mm
            slope[:, axis] = (at(points + step) - at(points - step)) / (2 * step_mm)
        return slope

    def covering(self, points: FloatArray, active: IntArray) -> IntArray:
        """The body that covers each point deepest besides its active ones; −1 where none does."""
        values = np.stack([
            sign * body.bound(points) for body, sign in zip(self.bodies, self.signs, strict=True)
        ])
        columns = np.arange(len(points))
        for slot in range(MOST_ACTIVE):
            there = active[:, slot] >= 0
            values[active[there, slot], columns[there]] = -np.inf
        deepest = values.argmax(axis=0)
        covered = values[deepest, columns] > ON_SURFACE * self.pitch_mm
        return np.where(covered, deepest, -1)

    def _active(
        self, points: FloatArray, active: IntArray, *, normals: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Values (n, MOST_ACTIVE) and directions inwards (n, MOST_ACTIVE, 3) of active bodies.

        Bounds do here: near a surface they are as good as distances, and much cheaper.
        """
        value = np.zeros((len(points), MOST_ACTIVE))
        normal = np.zeros((len(points), MOST_ACTIVE, 3))
        for number in np.unique(active[active >= 0]):
            row, slot = np.nonzero(active == number)
            body, sign = self.bodies[number], self.signs[number]
            value[row, slot] = sign * body.bound(points[row])
            if normals and self._exact[number]:
                normal[row, slot] = sign * body.inward(points[row])
            elif normals:
                normal[row, slot] = sign * unit_slope(body.bound, points[row])
        return value, normal


def alone(which: IntArray) -> IntArray:
    """Rows of active bodies (n, MOST_ACTIVE) with one each."""
    active = np.full((len(which), MOST_ACTIVE), -1, dtype=np.int64)
    active[:, 0] = which
    return active


def joined_by(active: IntArray, which: IntArray) -> IntArray:
    """Rows of active bodies with one more each, in the first free place."""
    grown = active.copy()
    free = np.argmax(grown < 0, axis=1)
    grown[np.arange(len(grown)), free] = which
    return grown
