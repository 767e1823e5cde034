"""Moves made ready for the controller: no line too long in time, gaps long enough for powder."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lmctl.config.machine import Motion
from lmctl.errors import PlanError
from lmctl.job.schema import LineKind
from lmctl.plan.moves import Moves, join, lines, on_raster
from lmctl.plan.time_law import line_durations

FloatArray = NDArray[np.float64]

#: Travel is not slowed below this to win time; a dwell takes the rest.
_SLOWEST_TRAVEL_MM_S = 0.5
_SPLIT_ROUNDS = 8


def gap_lines(moves: Moves, path: int) -> NDArray[np.intp]:
    """Indices of the lines between the bead before a path and its own, in this layer.

    None where beads adjoin without lead-in and lead-out.
    """
    bead = np.flatnonzero((moves.kind == LineKind.BEAD) & (moves.path == path))[0]
    before = np.flatnonzero(moves.kind[:bead] == LineKind.BEAD)
    return np.arange(before[-1] + 1 if len(before) else 0, bead)


def with_time_for_powder(
    moves: Moves, start_mm: FloatArray, motion: Motion, needed_s: Callable[[int], float]
) -> Moves:
    """Slow the travel before each path so that the powder's change of mixture has time.

    needed_s : time from the bead before to this path's, by path of this layer (0, 1, …)
    Slower travel rather than a dwell: powder does not fall on one place, the planner keeps its
    motion, and an override scales the wait with the rest. Where there is no way to travel, dwell.
    """
    n_paths = int(moves.path.max(initial=-1)) + 1
    durations = line_durations(moves, start_mm, motion)
    length = np.linalg.norm(np.diff(np.vstack([start_mm, moves.target_mm]), axis=0), axis=1)
    feed = moves.feed_mm_s.copy()
    waits: dict[int, float] = {}
    for path in range(n_paths):
        gap = gap_lines(moves, path)
        short = needed_s(path) - float(durations[gap].sum())
        if short <= 1e-3:
            continue
        travel = gap[moves.kind[gap] == LineKind.TRAVEL]
        way = float(length[travel].sum())
        slow = way / (float(durations[travel].sum()) + short) if way > 0 else 0.0
        feed[travel] = np.minimum(feed[travel], max(slow, _SLOWEST_TRAVEL_MM_S))
        if slow < _SLOWEST_TRAVEL_MM_S:
            gone_s = way / _SLOWEST_TRAVEL_MM_S - float(durations[travel].sum())
            waits[_wait_before(moves, path, gap)] = short - gone_s
    slowed = on_raster(Moves(
        moves.target_mm, feed, moves.power_W, moves.kind, moves.path, moves.fractions,
        moves.dwell_s), start_mm)
    if not waits:
        return slowed
    parts, done = [], 0
    for index, wait_s in sorted(waits.items()):
        before = max(index - 1, 0)
        parts.append(slowed.take(np.arange(done, index)))
        parts.append(lines(slowed.target_mm[before], feed_mm_s=0.0, kind=LineKind.DWELL,
                           fractions=slowed.fractions[index], dwell_s=wait_s))
        done = index
    parts.append(slowed.take(np.arange(done, len(slowed))))
    return join(parts)


def _wait_before(moves: Moves, path: int, gap: NDArray[np.intp]) -> int:
    """The line before which powder is waited for: the lead-in, or the bead where there is none."""
    if len(gap) and moves.kind[gap[-1]] == LineKind.LEAD and moves.path[gap[-1]] == path:
        return int(gap[-1])
    bead = (moves.kind == LineKind.BEAD) & (moves.path == path)
    return int(np.flatnonzero(bead)[0])


def in_short_lines(
    moves: Moves, start_mm: FloatArray, motion: Motion, longest_s: float
) -> tuple[Moves, FloatArray]:
    """Split every line that lasts longer than `longest_s`; returns lines and durations (n,)."""
    for _ in range(_SPLIT_ROUNDS):
        durations = line_durations(moves, start_mm, motion)
        pieces = np.maximum(1, np.ceil(durations / longest_s - 1e-9).astype(np.intp))
        if pieces.max(initial=1) == 1:
            return moves, durations
        moves = on_raster(_split(moves, start_mm, pieces), start_mm)
    raise PlanError(
        f"a move cannot be split into lines of {longest_s:g} s",
        where=f"the longest lasts {durations.max():.3g} s",
        hint="raise motion.send_horizon_s or the acceleration in the machine profile",
    )


def _split(moves: Moves, start_mm: FloatArray, pieces: NDArray[np.intp]) -> Moves:
    """Each line in so many equal pieces; positions and fractions linear between its ends."""
    index = np.repeat(np.arange(len(moves)), pieces)
    number = np.arange(len(index)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((number + 1) / pieces[index])[:, None]
    before = np.vstack([start_mm, moves.target_mm[:-1]])
    mixture_before = np.vstack([moves.fractions[:1], moves.fractions[:-1]])
    result = moves.take(index)
    bead = (result.kind == LineKind.BEAD)[:, None]
    return Moves(
        target_mm=before[index] + share * (moves.target_mm - before)[index],
        feed_mm_s=result.feed_mm_s, power_W=result.power_W, kind=result.kind, path=result.path,
        fractions=np.where(
            bead, mixture_before[index] + share * (moves.fractions - mixture_before)[index],
            result.fractions),
        dwell_s=result.dwell_s / pieces[index],
    )
