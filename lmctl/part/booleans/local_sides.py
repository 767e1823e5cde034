"""Decide whether a point on some leaves' surfaces lies on the surface of the combined body.

It does when the result changes among the sides of its leaves that can be met right around the
point. With one surface there both its sides can; with several, those that directions from the point
lead to: faces that lie flush have no place between them, surfaces that cross have one in each
corner.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray, SignArray
from lmctl.part.bodies.surfaces import ON_SURFACE_PITCHES, Surface
from lmctl.part.booleans.expression import BooleanExpression

#: How far from a point its directions are followed: of the pitch, or of what a leaf is off by.
STEP_PITCHES = 1e-3
STEP_SLACKS = 10.0

#: Surfaces that cross at less than this angle [rad] have nothing to look for between them.
MIN_CROSSING_ANGLE_RAD = 1e-3

#: Surfaces looked between at one point, and of these so many at a time.
MAX_MEETING_SURFACES = 4
MAX_CROSSING = 3

#: Directions besides those the surfaces themselves give; evenly spread, along no axis.
DIRECTION_COUNT = 18


def _spread(count: int) -> FloatArray:
    turn = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(count) + 0.5)
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    flat = np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])


@dataclass(frozen=True, eq=False)
class LocalSides:
    """The sides of an expression's leaves around points.

    pitch_mm : to which tolerances are related
    """

    expression: BooleanExpression
    pitch_mm: float

    @cached_property
    def surface_tolerance_mm(self) -> FloatArray:
        """How near to zero a leaf's distance is on its surface at most, (k,) [mm]."""
        least = ON_SURFACE_PITCHES * self.pitch_mm
        return np.array([max(leaf.surface_tolerance_mm, least) for leaf in self.expression.leaves])

    def is_on_boundary(
        self, points: FloatArray, on: IntArray | None = None, sides: SignArray | None = None
    ) -> NDArray[np.bool_]:
        """Whether points (n, 3) lie where the expression changes, to the leaves' slack.

        on : (n,) leaves on whose surface they are known to lie
        sides : (k, n) sides of leaves on which they are known to lie, 0 where they are not
        """
        inside, outside = self._around(points, on, sides)
        return inside & outside

    def surrounding_side(self, points: FloatArray) -> SignArray:
        """The side of the expression that is all around points (n, 3): 1 or −1, 0 where both are.

        On faces that bodies share the formula comes out at 0, though nothing changes there.
        """
        inside, outside = self._around(points, None, None)
        return inside.astype(np.int8) - outside.astype(np.int8)

    @property
    def shared_face_tolerance_mm(self) -> float:
        """How near to 0 the formula comes out at most on a face that leaves share [mm]."""
        return float(self.surface_tolerance_mm.max())

    def depth_on_shared_faces(self, points: FloatArray, depth: FloatArray) -> FloatArray:
        """The formula's depths (n,) at points, on faces that leaves share on the side around."""
        rows = np.flatnonzero(np.abs(depth) <= self.shared_face_tolerance_mm)
        if len(rows) == 0:
            return depth
        side, own = self.surrounding_side(points[rows]), depth[rows]
        result = depth.copy()
        result[rows] = np.where(
            side == 0, own, side * np.maximum(np.abs(own), self.surface_tolerance_mm.min()))
        return result

    def uncertain_depths(
        self, depth: FloatArray, rows: Sequence[FloatArray], near: NDArray[np.bool_]
    ) -> tuple[IntArray, list[SignArray], NDArray[np.bool_]]:
        """The leaf that depths (b, m) are measured to; the sides of all leaves that its nearest
        point has for sure, else 0; and where it is not sure that this point is on the boundary.

        It is where the formula changes with that leaf, whatever the sides of all leaves that are
        no farther away: any of them may have either side at that point.
        """
        size = np.abs(depth)
        which = np.full(depth.shape, -1, dtype=np.int64)
        sides = []
        for number, row in enumerate(rows):
            side = np.where(row > 0, np.int8(1), np.int8(-1))
            if near[number].any():
                away = np.abs(row)
                side[away <= size + 2.0 * self.surface_tolerance_mm[number]] = 0
                which[(away == size) & (which < 0)] = number
            sides.append(side)
        known = []
        for sign in (np.int8(1), np.int8(-1)):
            there = list(sides)
            for leaf in np.flatnonzero(near.any(axis=1)):
                there[leaf] = np.where(which == leaf, sign, sides[leaf])
            known.append(self.expression.evaluate(there))
        return which, sides, known[0] * known[1] >= 0

    def _around(
        self, points: FloatArray, on: IntArray | None, sides: SignArray | None
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether the inside, and whether the outside, is met right around points."""
        signs, active = self._signs(points, on, sides)
        side = self.expression.evaluate(signs)
        seen = _Seen(len(points))
        seen.note(np.arange(len(points)), side)
        count = active.sum(axis=0)
        single = np.flatnonzero((side == 0) & (count == 1))
        for sign in (np.int8(1), np.int8(-1)) if len(single) else ():
            there = np.where(active[:, single], sign, signs[:, single])
            seen.note(single, self.expression.evaluate(there))
        several = np.flatnonzero((side == 0) & (count > 1))
        if len(several):
            own = _Seen(len(several))
            self._look(points[several], signs[:, several], active[:, several], self.expression,
                       own)
            seen.inside[several], seen.outside[several] = own.inside, own.outside
        return seen.inside, seen.outside

    def is_on_boundary_piece(self, points: FloatArray, leaf: int,
                             others: BooleanExpression) -> NDArray[np.bool_]:
        """Whether points lie on the piece of a leaf's surface inside others, or on its rim.

        others : a formula over the same leaves
        """
        signs, active = self._signs(points, None, None)
        sign = others.evaluate(signs)
        found: NDArray[np.bool_] = active[leaf] & (sign > 0)
        rows = np.flatnonzero(active[leaf] & (sign == 0))
        if len(rows):
            seen = _Seen(len(rows))
            self._look(points[rows], signs[:, rows], active[:, rows], others, seen, leaf)
            found[rows] = seen.inside & seen.outside
        return found

    def _signs(
        self, points: FloatArray, on: IntArray | None, sides: SignArray | None
    ) -> tuple[SignArray, NDArray[np.bool_]]:
        """The side of each leaf that points lie on, 0 on its surface; and which these are."""
        shape = len(self.expression.leaves), len(points)
        signs = np.zeros(shape, dtype=np.int8) if sides is None else sides.copy()
        for number, leaf in enumerate(self.expression.leaves):
            asked = signs[number] == 0
            if on is not None:
                asked &= on != number
            rows = np.flatnonzero(asked)
            if len(rows):
                bound = leaf.distance_bound(points if len(rows) == len(points) else points[rows])
                on_it = np.abs(bound) <= self.surface_tolerance_mm[number]
                signs[number, rows] = np.where(on_it, 0, np.where(bound > 0, 1, -1))
        if on is not None:
            signs[on, np.arange(len(points))] = 0
        return signs, signs == 0

    def _look(
        self, points: FloatArray, signs: SignArray, active: NDArray[np.bool_],
        of: BooleanExpression,
        seen: _Seen, leaf: int | None = None,
    ) -> None:
        """Follow directions from points and note what the formula is in each of them.

        leaf : note only whether this leaf is left or entered where the formula holds
        """
        steps = np.where(active, np.maximum(
            STEP_SLACKS * self.surface_tolerance_mm, STEP_PITCHES * self.pitch_mm)[:, None],
            0.0).max(axis=0)
        for directions in self._test_directions(points, active):
            rows = np.flatnonzero(~(seen.inside & seen.outside) & directions.any(axis=-1))
            if len(rows) == 0:
                continue
            directed = directions[rows] if directions.ndim == 2 else directions
            there = points[rows] + steps[rows, None] * directed
            around = signs[:, rows]
            clear = np.ones(len(rows), dtype=bool)
            for number in np.flatnonzero(active[:, rows].any(axis=1)):
                own = np.flatnonzero(active[number, rows])
                value = self.expression.leaves[number].distance_bound(there[own])
                clear[own] &= np.abs(value) > 2.0 * self.surface_tolerance_mm[number]
                around[number, own] = np.where(value > 0, 1, -1)
            side = of.evaluate(around)
            if leaf is None:
                seen.note(rows[clear], side[clear])
            else:
                kept = clear & (side > 0)
                seen.note(rows[kept], around[leaf, kept])

    def _test_directions(
        self, points: FloatArray, active: NDArray[np.bool_]
    ) -> Iterator[FloatArray]:
        """Directions, (n, 3) or for all points (3,): between the surfaces, then all around."""
        inward = self._inward(points, active)
        crossing = np.minimum(inward.any(axis=2).sum(axis=0), MAX_CROSSING)
        for count in range(1, MAX_CROSSING + 1):
            for some in combinations(inward, count):
                directions = np.where((crossing == count)[:, None], _between(some), 0.0)
                if directions.any():
                    yield from directions
                    yield from -directions
        yield from _spread(DIRECTION_COUNT)

    def _inward(self, points: FloatArray, active: NDArray[np.bool_]) -> FloatArray:
        """Directions of the surfaces that points lie on, (MOST_MET, n, 3), all crossing; 0 where
        there are fewer. An edge of a leaf has two: its own direction there is that of one."""
        inward = np.zeros((MAX_MEETING_SURFACES, len(points), 3))
        count = np.zeros(len(points), dtype=np.int64)

        def meet(surface: Surface, rows: IntArray) -> None:
            found = surface.inward_directions(points[rows])
            known = np.abs(np.einsum("mnc,nc->mn", inward[:, rows], found)).max(axis=0)
            new = (known < np.cos(MIN_CROSSING_ANGLE_RAD)) & (count[rows] < MAX_MEETING_SURFACES)
            inward[count[rows[new]], rows[new]] = found[new]
            count[rows[new]] += 1

        for leaf, slack, on_it in zip(self.expression.leaves, self.surface_tolerance_mm, active,
                                      strict=True):
            own = np.flatnonzero(on_it)
            if len(own) == 0:
                continue
            lost = np.ones(len(own), dtype=bool)
            for surface, _ in leaf.surfaces:
                close = np.abs(surface.distance_at(points[own])) <= slack
                meet(surface, own[close])
                lost &= ~close
            meet(leaf, own[lost])
        return inward


def _between(inward: Sequence[FloatArray]) -> FloatArray:
    """Unit directions (m, n, 3), one into each second corner between one to three surfaces.

    inward : of each surface, (n, 3); 0 where it is missing, and so is the direction then
    """
    if len(inward) == 1:
        directions = np.stack(inward)
    elif len(inward) == 2:
        a, b = inward
        directions = np.stack([a + b, a - b])
    else:
        # The inverse gives the same sides of all three, however flat the corner is.
        a, b, c = inward
        across = np.cross(b, c), np.cross(c, a), np.cross(a, b)
        directions = np.stack([
            across[0] + one * across[1] + two * across[2] for one in (1, -1) for two in (1, -1)])
        directions[:, np.abs(np.einsum("nc,nc->n", a, across[0])) < MIN_CROSSING_ANGLE_RAD] = 0.0
    directions[:, ~np.all([direction.any(axis=1) for direction in inward], axis=0)] = 0.0
    size = np.linalg.norm(directions, axis=2, keepdims=True)
    crossing = size > MIN_CROSSING_ANGLE_RAD
    return np.asarray(np.where(crossing, directions / np.where(crossing, size, 1.0), 0.0))


class _Seen:
    """What was met around points so far: the inside, the outside."""

    def __init__(self, count: int) -> None:
        self.inside = np.zeros(count, dtype=bool)
        self.outside = np.zeros(count, dtype=bool)

    def note(self, rows: IntArray, signs: SignArray) -> None:
        self.inside[rows[signs > 0]] = True
        self.outside[rows[signs < 0]] = True
