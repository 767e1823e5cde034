"""Regions of volume fractions that must not be deposited, as unions of convex pieces.

A piece is where all its linear inequalities hold: rows @ x ≥ bounds. Intervals, half-spaces,
triangles of a polygon and cells of a map are all such pieces, so that whether a mixture lies in a
region, and whether a straight change of mixture crosses one, are exact.

Distances are in the greatest volume fraction: a piece grown by 0.02 holds every mixture none of
whose fractions is more than 0.02 from a mixture of the piece (and, beyond its corners, some more).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel

#: A fraction below this is none.
NO_FRACTION = 1e-9
#: Mixtures closer to a piece than this lie in it.
_ON_EDGE = 1e-9


@dataclass(frozen=True, eq=False)
class ForbiddenRegions:
    """p convex pieces over mixtures of m powders.

    rows : (q, m) float64, bounds : (q,) float64: inequalities rows @ x ≥ bounds of all pieces
    starts : (p + 1,) intp, piece k is rows starts[k] to starts[k + 1]
    rule : (p,) intp, the rule that each piece belongs to
    """

    rows: FloatArray
    bounds: FloatArray
    starts: IndexArray
    rule: IndexArray

    @property
    def n_powders(self) -> int:
        return int(self.rows.shape[1])

    def grown_bounds(
        self, margin: FloatArray, more: float = 0.0, powders: FloatArray | None = None
    ) -> FloatArray:
        """Bounds of the pieces grown on all sides, (q,).

        margin : (rules,) in every fraction, by the rule of the piece
        more : a further distance, for mixtures in which only some `powders` (m,) bool vary
        """
        owner = self.rule[np.repeat(np.arange(len(self.rule)), np.diff(self.starts))]
        grown = self.bounds - margin[owner] * _reach(self.rows)
        if more:
            rows = self.rows if powders is None else self.rows[:, powders.astype(np.bool_)]
            grown = grown - more * _reach(rows)
        return np.asarray(grown)

    def rule_at(self, fractions: FloatArray, bounds: FloatArray | None = None) -> IntArray:
        """The rule whose region each mixture (n, m) lies in, of several the first; −1 for none.

        bounds : (q,) of grown pieces; None: the pieces themselves, with their edges
        """
        found = _first_piece(
            np.ascontiguousarray(fractions, np.float64), self.rows,
            self.bounds if bounds is None else bounds, self.starts)
        return np.where(found >= 0, self.rule[np.maximum(found, 0)], -1) if len(self.rule) else (
            np.full(len(fractions), -1))

    def crossings(
        self, begin: FloatArray, end: FloatArray, bounds: FloatArray | None = None
    ) -> FloatArray:
        """Where straight changes of mixture (n, m) lie in pieces: from and to, as shares of the
        change, (n, 2) over all the pieces it meets; NaN where it meets none."""
        return np.asarray(_crossings(
            np.ascontiguousarray(begin, np.float64), np.ascontiguousarray(end, np.float64),
            self.rows, self.bounds if bounds is None else bounds, self.starts))

    def spans(self, begin: FloatArray, end: FloatArray, bounds: FloatArray) -> list[
            tuple[float, float, tuple[int, ...]]]:
        """The stretches of one straight change of mixture that lie in pieces, those that meet
        joined, with the rules they belong to; rising shares within [0, 1]."""
        pieces = []
        for number in range(len(self.rule)):
            own = slice(int(self.starts[number]), int(self.starts[number + 1]))
            low, high = _span_of(begin, end, self.rows[own], bounds[own])
            if low < high:
                pieces.append((low, high, int(self.rule[number])))
        found: list[tuple[float, float, tuple[int, ...]]] = []
        for low, high, rule in sorted(pieces):
            if found and low <= found[-1][1] + _ON_EDGE:
                rules = tuple(sorted({*found[-1][2], rule}))
                found[-1] = (found[-1][0], max(found[-1][1], high), rules)
            else:
                found.append((low, high, (rule,)))
        return found


def _span_of(
    begin: FloatArray, end: FloatArray, rows: FloatArray, bounds: FloatArray
) -> tuple[float, float]:
    """From and to, as shares of a change, where all inequalities hold; (1, 0) where nowhere."""
    low, high = 0.0, 1.0
    for at, slope in zip(rows @ begin - bounds, rows @ (end - begin), strict=True):
        if abs(slope) <= 1e-15:
            if at < 0:
                return 1.0, 0.0
        elif slope > 0:
            low = max(low, -at / slope)
        else:
            high = min(high, -at / slope)
    return (low, high) if low < high else (1.0, 0.0)


def _reach(rows: FloatArray) -> FloatArray:
    """Most by which each row (q, m) changes where no fraction changes by more than 1, and their
    sum not at all: the sum of its distances from its median."""
    if rows.shape[1] == 0:
        return np.zeros(len(rows))
    return np.asarray(np.abs(rows - np.median(rows, axis=1, keepdims=True)).sum(axis=1))


@inner_kernel
def _holds(
    x: FloatArray, rows: FloatArray, bounds: FloatArray, first: int, last: int
) -> bool:
    for q in range(first, last):
        value = 0.0
        for m in range(len(x)):
            value += rows[q, m] * x[m]
        if value < bounds[q] - _ON_EDGE:
            return False
    return True


@kernel
def _first_piece(
    fractions: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray
) -> IntArray:
    found = np.full(len(fractions), -1)
    for n in range(len(fractions)):
        for piece in range(len(starts) - 1):
            if _holds(fractions[n], rows, bounds, starts[piece], starts[piece + 1]):
                found[n] = piece
                break
    return found


@kernel
def _crossings(
    begin: FloatArray, end: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray
) -> FloatArray:
    found = np.full((len(begin), 2), np.nan)
    for n in range(len(begin)):
        for piece in range(len(starts) - 1):
            low, high = segment_in_piece(
                begin[n], end[n], rows, bounds, starts[piece], starts[piece + 1])
            if low <= high:
                if np.isnan(found[n, 0]):
                    found[n, 0], found[n, 1] = low, high
                else:
                    found[n, 0], found[n, 1] = min(found[n, 0], low), max(found[n, 1], high)
    return found


@inner_kernel
def segment_in_piece(
    a: FloatArray, b: FloatArray, rows: FloatArray, bounds: FloatArray, first: int, last: int
) -> tuple[float, float]:
    """Shares of the way from a to b at which it enters and leaves a piece; 1, 0 where it does
    not meet it."""
    low, high = 0.0, 1.0
    for q in range(first, last):
        at, slope = _ON_EDGE - bounds[q], 0.0
        for m in range(len(a)):
            at += rows[q, m] * a[m]
            slope += rows[q, m] * (b[m] - a[m])
        if abs(slope) <= 1e-15:
            if at < 0.0:
                return 1.0, 0.0
        elif slope > 0.0:
            low = max(low, -at / slope)
        else:
            high = min(high, -at / slope)
        if low > high:
            return 1.0, 0.0
    return low, high
