"""When each line of a program ends: the time law of a Grbl-type look-ahead planner.

Every motion is a block with trapezoidal speed: acceleration and speed are bounded along each
axis, the speed where two blocks meet by the junction deviation, and each block must be able to
come to rest within the blocks the controller's buffer holds. Written from the firmware's
documented rules (Grbl wiki and S. Jeon, "Improving Grbl: cornering algorithm", 2011), not from
a simulator, so that each can check the other. Not modelled: the steps of the motors, to which the
firmware rounds positions; segments of a few dozen steps then take corners at high speed (90 mm/s)
up to a tenth more slowly than here.

Strategy: all geometric bounds are vectorised; one compiled pass then finds the speed at each
block's start: not above its junction bound, not above what the block before can accelerate to,
and low enough to stop inside the look-ahead window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.field.kernel import kernel
from lmctl.plan.sequence.moves import Moves

#: cos of the angle between two blocks beyond which they count as reversing or as one line.
_STRAIGHT = 0.999999


def line_durations(moves: Moves, start_mm: FloatArray, motion: MotionSettings) -> FloatArray:
    """Duration of every line, (n,) float64 [s], from rest at `start_mm` to rest after the last.

    Lines without motion (setup, dwell) are reached and left at rest: the firmware drains its
    planner before a dwell and before a change of spindle state.
    """
    steps = np.diff(np.vstack([start_mm, moves.target_mm]), axis=0)
    length = np.linalg.norm(steps, axis=1)
    length[~moves.is_motion()] = 0.0
    moving = length > 0
    unit = np.divide(steps, length[:, None], out=np.zeros_like(steps), where=moving[:, None])
    acceleration = _along(unit, motion.acceleration_mm_s2)
    speed = np.minimum(moves.feed_mm_s, _along(unit, motion.max_speed_mm_s))
    entry_sq = _junction_speed_sq(unit, moving, motion)
    entry_sq = np.minimum(entry_sq, speed**2)
    entry_sq[1:] = np.minimum(entry_sq[1:], speed[:-1] ** 2)
    durations = _durations(length, speed, acceleration, entry_sq, motion.planner_blocks - 1)
    return np.asarray(durations + moves.dwell_s)


def _along(unit: FloatArray, axis_limits: tuple[float, float, float]) -> FloatArray:
    """The limit of each axis seen along a direction: min over axes of limit / |component|."""
    with np.errstate(divide="ignore"):
        seen = np.asarray(axis_limits) / np.abs(unit)
    return np.asarray(np.minimum(seen.min(axis=1), 1e9))


def _junction_speed_sq(unit: FloatArray, moving: NDArray[np.bool_],
                       motion: MotionSettings) -> FloatArray:
    """Largest squared speed where each block begins [mm²/s²]: a d sin(θ/2) / (1 − sin(θ/2)).

    θ is the angle the path turns *through* the corner, 180° being straight on; 0 where either
    neighbour is at rest.
    """
    n = len(unit)
    result = np.zeros(n)
    both = moving[1:] & moving[:-1]
    cos = -np.einsum("ij,ij->i", unit[1:], unit[:-1])
    half_sine = np.sqrt(np.clip(0.5 * (1 - cos), 0, 1))
    change = unit[1:] - unit[:-1]
    size = np.linalg.norm(change, axis=1)
    change = np.divide(change, size[:, None], out=np.ones_like(change), where=size[:, None] > 0)
    acceleration = _along(change, motion.acceleration_mm_s2)
    with np.errstate(divide="ignore"):
        bound = acceleration * motion.junction_deviation_mm * half_sine / (1 - half_sine)
    bound = np.where(cos < -_STRAIGHT, 1e18, np.where(cos > _STRAIGHT, 0.0, bound))
    result[1:] = np.where(both, bound, 0.0)
    return result


@kernel
def _durations(
    length: FloatArray, speed: FloatArray, acceleration: FloatArray, entry_sq: FloatArray,
    window: int,
) -> FloatArray:
    """Time of each block; blocks of no length are rests. All arrays (n,) float64."""
    n = len(length)
    gain = 2.0 * acceleration * length
    start_sq = np.zeros(n + 1)
    for i in range(n):
        if length[i] == 0.0:
            continue
        best = 0.0
        if i > 0 and length[i - 1] > 0.0:
            best = min(entry_sq[i], start_sq[i - 1] + gain[i - 1])
        reach = 0.0
        for j in range(i, min(i + window, n)):
            if length[j] == 0.0:
                best = min(best, reach)
                break
            if j > i:
                best = min(best, reach + entry_sq[j])
            if reach >= best:
                break
            reach += gain[j]
        else:
            best = min(best, reach)
        start_sq[i] = best
    time = np.zeros(n)
    for i in range(n):
        if length[i] == 0.0:
            continue
        v0 = np.sqrt(start_sq[i])
        v1 = 0.0
        if i + 1 < n and length[i + 1] > 0.0:
            v1 = np.sqrt(start_sq[i + 1])
        a = acceleration[i]
        top_sq = min(speed[i] ** 2, 0.5 * (gain[i] + v0 * v0 + v1 * v1))
        top = np.sqrt(top_sq)
        cruise = length[i] - (2.0 * top_sq - v0 * v0 - v1 * v1) / (2.0 * a)
        time[i] = (2.0 * top - v0 - v1) / a + max(cruise, 0.0) / top
    return time
