"""Wait with the beam off before paths, away from the part where there is time to go there.

Powder stops in a long wait (`powder_pause`), but falls at its begin and before its end. It falls on
the purge position, not on the part, wherever the wait is longer than the way there and back; a
shorter one slows the travel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.line_timing import gap_line_ranges, with_time_for_powder
from lmctl.plan.sequence.moves import (
    Moves,
    join_moves,
    moves_of_kind,
    rounded_to_program_steps,
    with_inserted_moves,
)
from lmctl.plan.sequence.travel import LAYER_REST_S, TravelSettings
from lmctl.plan.sequence.velocity_profile import line_durations

#: Ways with acceleration take up to this much longer than length over speed, and so much more.
_WAY_FACTOR, _WAY_EXTRA_S = 1.3, 2.0
#: A wait shorter than this is none [s].
_NO_WAIT_S = 0.01


@dataclass(frozen=True)
class PurgePosition:
    """Where waits are spent: (3,) program coordinates, and how the nozzle gets there."""

    place_mm: FloatArray
    travel: TravelSettings


def with_waits(
    moves: Moves, start_mm: FloatArray, motion: MotionSettings, waits_s: FloatArray,
    purge: PurgePosition,
) -> Moves:
    """The same lines with each gap before a path longer by its wait, (m,) [s]."""
    if not (waits_s > _NO_WAIT_S).any():
        return moves
    wanted_s = _gap_durations_s(moves, start_mm, motion) + waits_s
    before, inserted, dwelling = [], [], []
    for path in np.flatnonzero(waits_s > _NO_WAIT_S).tolist():
        detour = _detour(moves, start_mm, path, purge)
        if detour is None or _way_s(detour[1], purge) > waits_s[path]:
            continue
        before += [detour[0]] * len(detour[1])
        inserted.append(detour[1])
        dwelling.append(path)
    result = moves
    if inserted:
        more = join_moves(inserted)
        result = with_inserted_moves(moves, np.array(before), more)
        missing_s = (wanted_s - _gap_durations_s(result, start_mm, motion))[dwelling]
        at = np.flatnonzero(_inserted(before, len(moves)))[more.kind == LineKind.DWELL]
        result.dwell_s[at] += np.maximum(missing_s, 0.0)
    needed_s = np.where(waits_s > _NO_WAIT_S, wanted_s, 0.0)
    result = with_time_for_powder(result, start_mm, motion, needed_s)
    return rounded_to_program_steps(result, start_mm)


def _gap_durations_s(moves: Moves, start_mm: FloatArray, motion: MotionSettings) -> FloatArray:
    """Time between the beads before each path and its own, (m,)."""
    ends_s = np.concatenate([[0.0], np.cumsum(line_durations(moves, start_mm, motion))])
    gaps = gap_line_ranges(moves)
    return np.asarray(ends_s[gaps[:, 1]] - ends_s[gaps[:, 0]])


def _detour(
    moves: Moves, start_mm: FloatArray, path: int, purge: PurgePosition
) -> tuple[int, Moves] | None:
    """Lines to the purge position and back over the path's entry, and the line they precede.

    None where no travel leads to the path.
    """
    first, last = gap_line_ranges(moves)[path].tolist()
    travels = first + np.flatnonzero(moves.kind[first:last] == LineKind.TRAVEL)
    if len(travels) == 0:
        return None
    at = int(travels[0])
    place = moves.target_mm[at - 1] if at else start_mm
    entry = moves.target_mm[int(travels[-1])]
    if moves.target_mm[at, 2] > place[2]:  # this travel lifts first
        place = moves.target_mm[at]
        at += 1
    x, y, z = purge.place_mm
    top = max(place[2], entry[2] + purge.travel.clearance_mm, z)
    stops = np.array([[place[0], place[1], top], [x, y, top], [x, y, z], [x, y, top],
                      [entry[0], entry[1], top]])
    ways = moves_of_kind(stops, feed_mm_s=purge.travel.travel_mm_s, kind=LineKind.TRAVEL,
                         fractions=moves.fractions[at])
    dwell = moves_of_kind(purge.place_mm, feed_mm_s=0.0, kind=LineKind.DWELL,
                          fractions=moves.fractions[at], dwell_s=LAYER_REST_S)
    order = np.array([0, 1, 2, 5, 3, 4])
    return at, join_moves([ways, dwell]).select(order)


def _way_s(detour: Moves, purge: PurgePosition) -> float:
    """About how long a detour takes."""
    steps = np.diff(detour.target_mm, axis=0)
    length_mm = float(np.sqrt((steps**2).sum(axis=1)).sum())
    return length_mm / purge.travel.travel_mm_s * _WAY_FACTOR + _WAY_EXTRA_S


def _inserted(before: list[int], count: int) -> BoolArray:
    """Of the lines after insertion, which are new."""
    return np.asarray(np.insert(np.zeros(count, np.bool_), before, True))
