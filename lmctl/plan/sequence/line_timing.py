"""Prepare moves for the controller: no line lasts too long, gaps are long enough for powder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.config.machine import MotionSettings
from lmctl.errors import PlanError
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.flat_arrays import indices_within_stretches
from lmctl.plan.sequence.moves import (
    Moves,
    moves_of_kind,
    rounded_to_program_steps,
    split_moves,
    with_inserted_moves,
)
from lmctl.plan.sequence.velocity_profile import line_durations

#: Travel is not slowed below this to win time; a dwell takes the rest.
_SLOWEST_TRAVEL_MM_S = 0.5
#: A wait shorter than this is none [s].
_NO_WAIT_S = 1e-3
_SPLIT_ROUNDS = 8


def bead_line_ranges(moves: Moves) -> tuple[IndexArray, IndexArray]:
    """First and last bead line of each path, (m,) each; paths are numbered in order."""
    bead = np.flatnonzero(moves.kind == LineKind.BEAD)
    path = moves.path[bead]
    first = np.append(True, path[1:] != path[:-1]) if len(path) else np.empty(0, np.bool_)
    return bead[first], bead[np.roll(first, -1)]


def gap_line_ranges(moves: Moves) -> IndexArray:
    """Lines [a, b) between the bead before each path and its own, in this layer, (m, 2) intp.

    Empty where beads adjoin without lead-in and lead-out.
    """
    first, last = bead_line_ranges(moves)
    return np.column_stack([np.concatenate([[0], last[:-1] + 1]), first])


def with_time_for_powder(
    moves: Moves, start_mm: FloatArray, motion: MotionSettings, needed_s: FloatArray
) -> Moves:
    """Slow the travel before each path so that the powder's change of mixture has time.

    needed_s : (m,) time from the bead before to each path's, by path of this layer
    Slower travel is better than a dwell: powder does not fall on one place, the planner keeps its
    motion, and an override scales the wait with the rest. A gap without travel gets a dwell.
    """
    durations = line_durations(moves, start_mm, motion)
    gaps = gap_line_ranges(moves)
    travels = moves.kind == LineKind.TRAVEL
    short = needed_s - _sums(durations, gaps)
    travel_mm = _sums(np.where(travels, moves.lengths_mm(start_mm), 0.0), gaps)
    travel_s = _sums(np.where(travels, durations, 0.0), gaps)
    late = short > _NO_WAIT_S
    if not late.any():
        return moves
    slow = np.where(late & (travel_mm > 0), travel_mm / (travel_s + np.maximum(short, 0.0)), 0.0)
    path = np.repeat(np.arange(len(gaps)), gaps[:, 1] - gaps[:, 0])
    line = np.repeat(gaps[:, 0], gaps[:, 1] - gaps[:, 0]) + indices_within_stretches(
        gaps[:, 1] - gaps[:, 0])
    slowed = travels[line] & late[path]
    feed = moves.feed_mm_s.copy()
    feed[line[slowed]] = np.minimum(
        feed[line[slowed]], np.maximum(slow[path[slowed]], _SLOWEST_TRAVEL_MM_S))
    waiting = np.flatnonzero(late & (slow < _SLOWEST_TRAVEL_MM_S))
    wait_s = (short - (travel_mm / _SLOWEST_TRAVEL_MM_S - travel_s))[waiting]
    result = replace(moves, feed_mm_s=feed)
    if len(waiting):
        before = _wait_before(moves, waiting, gaps)
        result = with_inserted_moves(result, before, moves_of_kind(
            result.target_mm[np.maximum(before - 1, 0)], feed_mm_s=0.0, kind=LineKind.DWELL,
            fractions=result.fractions[before], dwell_s=wait_s))
    return rounded_to_program_steps(result, start_mm)


def _sums(values: FloatArray, bounds: IndexArray) -> FloatArray:
    """Sums of values over [a, b) for bounds (m, 2)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(total[bounds[:, 1]] - total[bounds[:, 0]])


def _wait_before(moves: Moves, paths: IndexArray, gaps: IndexArray) -> IndexArray:
    """The lines before which the nozzle waits for powder: lead-ins, or else beads."""
    bead = gaps[paths, 1]
    before = np.maximum(bead - 1, 0)
    lead_in = (moves.kind[before] == LineKind.LEAD) & (moves.path[before] == paths) & (
        gaps[paths, 0] < bead)
    return np.asarray(np.where(lead_in, before, bead))


def split_long_lines(
    moves: Moves, start_mm: FloatArray, motion: MotionSettings, longest_s: float
) -> tuple[Moves, FloatArray]:
    """Split every line that lasts longer than `longest_s`; returns lines and durations (n,)."""
    for _ in range(_SPLIT_ROUNDS):
        durations = line_durations(moves, start_mm, motion)
        pieces = np.maximum(1, np.ceil(durations / longest_s - 1e-9).astype(np.intp))
        if pieces.max(initial=1) == 1:
            return moves, durations
        moves = rounded_to_program_steps(split_moves(moves, start_mm, pieces), start_mm)
    raise PlanError(
        f"a move cannot be split into lines of {longest_s:g} s",
        where=f"the longest lasts {durations.max():.3g} s",
        hint="raise motion.send_horizon_s or the acceleration in the machine profile",
    )
