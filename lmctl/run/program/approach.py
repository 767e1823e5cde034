"""The way back to a path, beam off, as program lines that fit the send horizon, each with its time.

Powder leaves its hopper some seconds before it reaches the nozzle, so the time of every approach
move must be known before it is made. Travel moves therefore begin and end at rest: a short dwell
stands between them, and both firmwares come to rest before a dwell. A straight move from rest to
rest lasts exactly as its speed and acceleration give, whatever junction deviation is set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings

#: Between two travel moves [s]. Grbl counts dwells in steps of 50 ms.
TRAVEL_DWELL_S = 0.05

#: A line no longer than this counts as constant speed, also where the nozzle accelerates [s].
_EVEN_S = 0.05


@dataclass(frozen=True)
class ApproachMove:
    """One line to be sent, a move or, where it ends where it starts, a dwell.

    is_run_up : run at the path's own speed, not from rest to rest
    """

    start_mm: FloatArray
    end_mm: FloatArray
    speed_mm_s: float
    duration_s: float
    is_run_up: bool = False

    @property
    def is_dwell(self) -> bool:
        return self.speed_mm_s == 0.0


def travel_moves(
    start_mm: FloatArray, corners_mm: Sequence[FloatArray], motion: MotionSettings, least_mm: float
) -> list[ApproachMove]:
    """Straight moves from a start through corners at full speed, with a dwell at the end of each.

    least_mm : corners nearer than this to the one before are left out
    """
    made: list[ApproachMove] = []
    at_mm = start_mm
    for corner_mm in corners_mm:
        away_mm = corner_mm - at_mm
        length_mm = float(np.linalg.norm(away_mm))
        if length_mm < least_mm:
            continue
        speed_mm_s = axis_limit_along(motion.max_speed_mm_s, away_mm)
        move = _RestToRest(length_mm, speed_mm_s,
                           axis_limit_along(motion.acceleration_mm_s2, away_mm))
        before_mm, before_s = at_mm, 0.0
        for until_s in _line_ends_s(move, motion):
            covered = move.travelled_mm(until_s) / length_mm if until_s < move.lasting_s else 1.0
            end_mm = np.round(at_mm + covered * away_mm, 3)
            made.append(ApproachMove(before_mm, end_mm, speed_mm_s, until_s - before_s))
            before_mm, before_s = end_mm, until_s
        made.append(ApproachMove(before_mm, before_mm, 0.0, TRAVEL_DWELL_S))
        at_mm = corner_mm
    return made


def _line_ends_s(move: _RestToRest, motion: MotionSettings) -> list[float]:
    """When the lines of a move end: short ones where it accelerates and brakes.

    A line counts as run at constant speed, so a report from a long accelerating line would set the
    clock wrong, and powder with it. But the controller must see far enough ahead to brake in time.
    At cruising speed a line lasts a quarter of the send horizon at most.
    """
    ramp_s = move.ramp_s
    pieces = min(max(1, math.ceil(ramp_s / _EVEN_S)), (motion.planner_blocks - 1) // 2)
    ramp = [ramp_s * k / pieces for k in range(1, pieces + 1)]
    cruising_s = move.lasting_s - 2.0 * ramp_s
    parts = math.ceil(cruising_s / (motion.send_horizon_s / 4.0) - 1e-9)
    cruise = [ramp_s + cruising_s * k / parts for k in range(1, parts + 1)]
    return [*ramp, *cruise, *(move.lasting_s - ramp_s + t for t in ramp[:-1]), move.lasting_s]


def axis_limit_along(axis_limits: Sequence[float], direction: FloatArray) -> float:
    """An axis limit applied to a straight move: the least of limit over |component|."""
    unit = np.abs(direction) / np.linalg.norm(direction)
    return float(min(limit / part for limit, part in zip(axis_limits, unit, strict=True) if part))


@dataclass(frozen=True)
class _RestToRest:
    """A straight move that begins and ends at rest, with trapezoidal speed."""

    length_mm: float
    speed_mm_s: float
    acceleration_mm_s2: float

    @property
    def ramp_s(self) -> float:
        """Acceleration time and braking time."""
        return min(self.speed_mm_s / self.acceleration_mm_s2,
                   math.sqrt(self.length_mm / self.acceleration_mm_s2))

    @property
    def lasting_s(self) -> float:
        if self.length_mm < self.speed_mm_s**2 / self.acceleration_mm_s2:
            return 2.0 * self.ramp_s
        return self.length_mm / self.speed_mm_s + self.ramp_s

    def travelled_mm(self, t_s: float) -> float:
        """Distance made after t_s."""
        if t_s > self.lasting_s / 2.0:
            return self.length_mm - self.travelled_mm(self.lasting_s - t_s)
        if t_s <= self.ramp_s:
            return self.acceleration_mm_s2 * t_s**2 / 2.0
        return (self.acceleration_mm_s2 * self.ramp_s**2 / 2.0
                + self.speed_mm_s * (t_s - self.ramp_s))


def acceleration_time_loss_s(distance_mm: float, speed_mm_s: float,
                             acceleration_mm_s2: float) -> float:
    """Extra time for a distance from rest, compared with the same distance at speed."""
    ramp_mm = speed_mm_s**2 / (2.0 * acceleration_mm_s2)
    if distance_mm >= ramp_mm:
        return speed_mm_s / (2.0 * acceleration_mm_s2)
    return math.sqrt(2.0 * distance_mm / acceleration_mm_s2) - distance_mm / speed_mm_s
