"""Waits of one layer, found block by block as the beam goes through it.

Before each block the beam stays off until all places that are deposited in it are cool enough when
they are reached. A block that waiting before it does not keep cool is divided, as far as paths may
be interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.heat.cooling import HottestPlace, PassReadings, wait_for_limit_s
from lmctl.plan.heat.heat_blocks import (
    MIN_PIECE_BEADS,
    block_starts,
    finely_divided,
    middle_of_block,
)
from lmctl.plan.heat.heat_steps import NO_LINES, BeadLines
from lmctl.plan.heat.part_temperature import PartTemperature
from lmctl.plan.heat.reading_moments import CLEAR_S, reading_moments
from lmctl.plan.sequence.interrupted_beads import HeatWaits

#: A wait is corrected so often, since a longer wait changes a little what the pass itself adds.
_ROUNDS = 4
NO_PLACES = (np.empty(0), np.empty((0, 2)))


class LimitNotKeptError(Exception):
    """The longest wait leaves a place too hot. hottest : which"""

    def __init__(self, hottest: HottestPlace) -> None:
        self.hottest = hottest


@dataclass(frozen=True)
class PassLimit:
    """What the beam may come back to. aim_K : waits are aimed below it by this much"""

    limit_C: float
    aim_K: float
    plate_C: float


@dataclass(frozen=True)
class _BlockEnd:
    """A block after a wait of `wait_s`: the part, what its places (k,) read, and whether all that
    are deposited in it are cool."""

    wait_s: float
    temperature: PartTemperature
    places: IndexArray
    found_C: FloatArray
    is_cool: bool


class BlockWaits:
    """Goes through the lines of a layer once: see `choose`."""

    def __init__(
        self, temperature: PartTemperature, lines: BeadLines, first: IndexArray,
        along_mm: FloatArray, bead_mm: float, limit: PassLimit,
    ) -> None:
        """temperature : as the layer begins; it is not changed

        lines : of the layer, times from its start; first : (m,) the first one of each path
        along_mm : (n, 2) where on the tracks each begins and ends
        """
        self._temperature, self._limit = temperature.copy(), limit
        self._began_s, self._waited_s = temperature.time_s, 0.0
        self._piece_mm = MIN_PIECE_BEADS * bead_mm
        starts = block_starts(lines, first, self._piece_mm)
        self._lines, first_part, self._begin_mm = finely_divided(lines, along_mm, bead_mm / 2)
        self._first = first_part[first]
        self._starts = first_part[starts].tolist()
        lines = self._lines
        self._moments = reading_moments(
            lines.start_mm, lines.end_mm, lines.start_s, lines.end_s, bead_mm)
        self._found_C = np.full(len(self._moments.at_s), np.nan)

    def choose(self) -> HeatWaits:
        """The waits. Raises LimitNotKeptError where no wait is long enough."""
        before_s = np.zeros(len(self._first))
        cut_along, cut_s = [], []
        blocks = list(pairwise([*self._starts, len(self._lines.start_s)]))[::-1]
        while blocks:
            a, b = blocks.pop()
            self._temperature.advance(
                float(self._lines.start_s[a]) + self._shift_s, NO_LINES, *NO_PLACES)
            middle = middle_of_block(self._lines, self._first, a, b, self._piece_mm)
            end = self._end_of_block(a, b, can_divide=middle is not None)
            if middle is not None and not end.is_cool:  # there may be a wait within it
                blocks += [(middle, b), (a, middle)]
                continue
            self._temperature = end.temperature
            self._found_C[end.places] = end.found_C
            path = int(np.searchsorted(self._first, a, side="right")) - 1
            if self._first[path] == a:
                before_s[path] = end.wait_s
            elif end.wait_s > 0:
                cut_along.append(self._begin_mm[a])
                cut_s.append(end.wait_s)
            self._waited_s += end.wait_s
        return HeatWaits(before_s, np.array(cut_along), np.array(cut_s))

    @property
    def _shift_s(self) -> float:
        """From the layer's times to those of the part."""
        return self._began_s + self._waited_s

    def _end_of_block(self, a: int, b: int, *, can_divide: bool) -> _BlockEnd:
        """Lines a to b − 1, after the wait that they need.

        can_divide : whether there may be a wait within them
        """
        before, moments, limit = self._temperature, self._moments, self._limit
        block = self._lines.part(a, b, self._shift_s)
        places = np.flatnonzero((moments.owner >= a) & (moments.owner < b))
        places = places[np.argsort(moments.at_s[places], kind="stable")]
        at_s = moments.at_s[places] + self._shift_s
        # read before this block, but not if the beam stays off here
        again = np.flatnonzero((moments.line >= a) & (moments.owner < a))
        came_hot = (self._found_C[again] > limit.limit_C) & (moments.line[again] < b)
        wait_s = CLEAR_S if came_hot.any() else 0.0
        for number in range(_ROUNDS):
            if wait_s and len(again):
                at_s = np.concatenate([np.full(len(again), before.time_s), at_s])
                places, again = np.concatenate([again, places]), again[:0]
            waited = before.copy()
            waited.advance(before.time_s + wait_s, NO_LINES, *NO_PLACES)
            after = waited.copy()
            read = after.advance(
                float(block.end_s[-1]) + wait_s, block.part(0, len(block.start_s), wait_s),
                at_s + wait_s, moments.place_mm[places])
            mine = moments.line[places] < b  # the others are of later blocks
            end = _BlockEnd(wait_s, after, places, read, _is_cool(read[mine], limit.limit_C))
            if end.is_cool or number == _ROUNDS - 1:
                break
            more_s = wait_for_limit_s(
                waited, PassReadings(moments.place_mm[places[mine]],
                                     at_s[mine] + wait_s - waited.time_s, read[mine]),
                limit.limit_C - limit.aim_K, limit.plate_C, can_divide=can_divide)
            if isinstance(more_s, HottestPlace):
                raise LimitNotKeptError(more_s)
            if more_s <= 0:
                break
            wait_s = max(wait_s + more_s, CLEAR_S)
        return end


def _is_cool(found_C: FloatArray, limit_C: float) -> bool:
    return bool(np.nanmax(found_C, initial=-np.inf) <= limit_C)
