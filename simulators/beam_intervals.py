"""Exact intervals with the beam on, from a controller's motion trace.

A phase has constant acceleration, so the instant at which a speed is crossed is computed, not
searched in steps. Between phases the axes are at rest; a separate table of the trace holds the
beam power then. Times are on the loop's clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simulators.array_types import FloatArray
from simulators.motion.actions import BEAM_DYNAMIC
from simulators.motion.trace import MotionTrace

#: Times closer together than this count as equal [s].
SAME_TIME_TOLERANCE_S = 1e-9


@dataclass(frozen=True)
class TimeInterval:
    """From begin_s to end_s."""

    begin_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        return self.end_s - self.begin_s


def beam_on_below_speed(speed_mm_s: float, trace: MotionTrace, now_s: float) -> tuple[TimeInterval,
                                                                                      ...]:
    """Return the intervals until now with the beam on and the axes below this speed or at rest."""
    return merge_intervals(np.concatenate([_moving(trace, now_s, speed_mm_s),
                                           _at_standstill(trace, now_s)]))


def merge_intervals(stretches: FloatArray) -> tuple[TimeInterval, ...]:
    """Sort intervals (k, 2) [s] and join those that touch."""
    together: list[list[float]] = []
    for begin_s, end_s in sorted(map(tuple, stretches.tolist())):
        if together and begin_s <= together[-1][1] + SAME_TIME_TOLERANCE_S:
            together[-1][1] = max(together[-1][1], end_s)
        else:
            together.append([begin_s, end_s])
    return tuple(TimeInterval(begin_s, end_s) for begin_s, end_s in together)


def _moving(trace: MotionTrace, now_s: float, below_mm_s: float) -> FloatArray:
    """(k, 2) intervals of motion with the beam on and the speed below below_mm_s."""
    phases = trace.phases()
    begin, end = phases.start_s, np.minimum(phases.end_s, now_s)
    speed, acceleration = phases.speed_mm_s, phases.acceleration_mm_s2
    last = speed + acceleration * (end - begin)
    dynamic = trace.blocks().beam[phases.block] == BEAM_DYNAMIC if len(begin) else begin > 0
    moves = (speed > 0) | (last > 0)
    beam_on = (phases.power > 0) & (begin < end) & (moves | ~dynamic)
    if below_mm_s < math.inf:
        crossing = begin + np.divide(
            below_mm_s - speed, acceleration, out=np.zeros_like(speed),
            where=acceleration != 0,
        )
        beam_on &= np.minimum(speed, last) < below_mm_s
        end = np.where((speed < below_mm_s) & (last > below_mm_s), crossing, end)
        begin = np.where((speed >= below_mm_s) & (last < below_mm_s), crossing, begin)
    return np.column_stack([begin, end])[beam_on]


def _at_standstill(trace: MotionTrace, now_s: float) -> FloatArray:
    """(k, 2) intervals with the beam on and no motion."""
    phases = trace.phases()
    since, power = trace.standstill_power()
    beam_on: list[tuple[float, float]] = []
    ends = np.concatenate([[-math.inf], phases.end_s])
    begins = np.concatenate([phases.start_s, [math.inf]])
    for from_s, to_s, burning in zip(since, [*since[1:], now_s], power, strict=True):
        if burning > 0:
            first = int(np.searchsorted(begins, from_s))
            last = int(np.searchsorted(ends, to_s))
            beam_on += [
                (max(from_s, ends[i]), min(to_s, begins[i], now_s))
                for i in range(first, min(last, len(begins)))
            ]
    return np.array(
        [one for one in beam_on if one[1] - one[0] > SAME_TIME_TOLERANCE_S]).reshape(-1, 2)
