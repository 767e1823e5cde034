"""Mixtures that alloy rules leave, with the distance that planned mixtures keep.

Planned mixtures stay out of each region grown by its rule's margin. What is deposited may differ
from the wanted mixture by about a quantum of volume fraction, in the powders that are fed: so
mixtures also keep that distance, but in those powders only. A powder that is shut off is at 0
exactly, so that a rule that begins at a trace of it leaves the mixtures without it.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.part.materials.alloy_rules import AlloyRules
from lmctl.part.materials.forbidden_regions import NO_FRACTION, segment_in_piece

#: Margins are kept up to this part of them, so that a mixture exactly at its margin is allowed.
_KEPT = 1 - 1e-6


class AllowedMixtures:
    """The mixtures outside all grown regions.

    rounding : distance kept beside the margins, in the powders that are fed, volume fraction
    """

    def __init__(self, rules: AlloyRules, rounding: float) -> None:
        self.rules = rules
        regions = rules.regions
        m = regions.n_powders
        self._bounds = np.array([
            regions.grown_bounds(
                rules.margins * _KEPT, rounding * _KEPT,
                np.array([bool(fed >> k & 1) for k in range(m)]))
            for fed in range(2**m)])

    def rule_at(self, fractions: FloatArray) -> IntArray:
        """The rule that keeps each mixture (n, m) from being planned; −1 where it is allowed."""
        regions = self.rules.regions
        found = _first_piece(np.ascontiguousarray(fractions, np.float64), regions.rows,
                             self._bounds, regions.starts)
        return np.where(found >= 0, regions.rule[np.maximum(found, 0)], -1)

    def crosses(self, begin: FloatArray, end: FloatArray) -> BoolArray:
        """Whether straight changes of mixture (n, m) meet what is not allowed, (n,)."""
        regions = self.rules.regions
        return np.asarray(_crosses(
            np.ascontiguousarray(begin, np.float64), np.ascontiguousarray(end, np.float64),
            regions.rows, self._bounds, regions.starts))

    def spans(self, begin: FloatArray, end: FloatArray) -> list[
            tuple[float, float, tuple[int, ...]]]:
        """Stretches of one straight change (m,) that are not allowed, with their rules."""
        fed = np.maximum(begin, end) > NO_FRACTION
        return self.rules.regions.spans(
            begin, end, self._bounds[int(fed @ (1 << np.arange(len(fed))))])

    def tightened(self, way: FloatArray, sweeps: int) -> FloatArray:
        """An allowed way (k, m) with its inner points drawn to their neighbours' middle, as far
        as it stays allowed; so often."""
        regions = self.rules.regions
        result = np.ascontiguousarray(way, np.float64).copy()
        _tighten(result, regions.rows, self._bounds, regions.starts, sweeps)
        return result


@inner_kernel
def _fed(fractions: FloatArray) -> int:
    """Which powders a mixture has, as bits."""
    fed = 0
    for m in range(len(fractions)):
        if fractions[m] > NO_FRACTION:
            fed |= 1 << m
    return fed


@kernel
def _first_piece(
    fractions: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray
) -> IntArray:
    found = np.full(len(fractions), -1)
    for n in range(len(fractions)):
        fed = _fed(fractions[n])
        for piece in range(len(starts) - 1):
            low, high = segment_in_piece(fractions[n], fractions[n], rows, bounds[fed],
                                         starts[piece], starts[piece + 1])
            if low <= high:
                found[n] = piece
                break
    return found


@inner_kernel
def _is_clear(
    a: FloatArray, b: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray
) -> bool:
    fed = _fed(a) | _fed(b)
    for piece in range(len(starts) - 1):
        low, high = segment_in_piece(a, b, rows, bounds[fed], starts[piece], starts[piece + 1])
        if low < high:
            return False
    return True


@kernel
def _crosses(
    begin: FloatArray, end: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray
) -> BoolArray:
    found = np.zeros(len(begin), np.bool_)
    for n in range(len(begin)):
        found[n] = not _is_clear(begin[n], end[n], rows, bounds, starts)
    return found


@kernel
def _tighten(
    way: FloatArray, rows: FloatArray, bounds: FloatArray, starts: IndexArray, sweeps: int
) -> None:
    trial = np.empty(way.shape[1])
    for _ in range(sweeps):
        for k in range(1, len(way) - 1):
            share = 1.0
            for _attempt in range(7):
                for m in range(len(trial)):
                    middle = (way[k - 1, m] + way[k + 1, m]) / 2
                    trial[m] = way[k, m] + share * (middle - way[k, m])
                if _is_clear(way[k - 1], trial, rows, bounds, starts) and _is_clear(
                        trial, way[k + 1], rows, bounds, starts):
                    way[k] = trial
                    break
                share /= 2
