"""When each line of a program ends: the time law of a Grbl-type look-ahead planner.

Every motion is a block with trapezoidal speed: acceleration and speed are bounded along each
axis, the speed where two blocks meet by the junction deviation, and each block must be able to
come to rest within the blocks the controller's buffer holds. Written from the firmware's
documented rules (Grbl wiki and S. Jeon, "Improving Grbl: cornering algorithm", 2011), not from
a simulator, so that each can check the other. Not modelled: the steps of the motors, to which the
firmware rounds positions; segments of a few dozen steps then take corners at high speed (90 mm/s)
up to a tenth more slowly than here.

One compiled pass bounds each block by its geometry; the next finds the speed at each
block's start: not above its junction bound, not above what the block before can accelerate to,
and low enough to stop inside the look-ahead window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import MotionSettings
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.sequence.moves import Moves

#: cos of the angle between two blocks beyond which they count as reversing or as one line.
_STRAIGHT = 0.999999


def line_durations(moves: Moves, start_mm: FloatArray, motion: MotionSettings) -> FloatArray:
    """Duration of every line, (n,) float64 [s], from rest at `start_mm` to rest after the last.

    Lines without motion (setup, dwell) are reached and left at rest: the firmware drains its
    planner before a dwell and before a change of spindle state.
    """
    durations = _durations(
        np.ascontiguousarray(moves.target_mm), np.asarray(start_mm, np.float64), moves.is_motion(),
        moves.feed_mm_s, np.array(motion.acceleration_mm_s2, np.float64),
        np.array(motion.max_speed_mm_s, np.float64), motion.junction_deviation_mm,
        motion.planner_blocks - 1)
    return np.asarray(durations + moves.dwell_s)


@inner_kernel
def _along(limits: FloatArray, x: float, y: float, z: float) -> float:
    """The limit of each axis seen along a direction: min over axes of limit / |component|."""
    seen = 1e9
    if x != 0.0:
        seen = min(seen, limits[0] / abs(x))
    if y != 0.0:
        seen = min(seen, limits[1] / abs(y))
    if z != 0.0:
        seen = min(seen, limits[2] / abs(z))
    return seen


@inner_kernel
def _junction_speed_sq(
    unit: FloatArray, i: int, acceleration_limits: FloatArray, deviation: float
) -> float:
    """Largest squared speed where block i begins [mm²/s²]: a d sin(θ/2) / (1 − sin(θ/2)).

    θ is the angle the path turns *through* the corner, 180° being straight on
    """
    cos = -(unit[i, 0] * unit[i - 1, 0] + unit[i, 1] * unit[i - 1, 1] + unit[i, 2] * unit[i - 1, 2])
    if cos < -_STRAIGHT:
        return 1e18
    if cos > _STRAIGHT:
        return 0.0
    half_sine = np.sqrt(min(max(0.5 * (1 - cos), 0.0), 1.0))
    x, y = unit[i, 0] - unit[i - 1, 0], unit[i, 1] - unit[i - 1, 1]
    z = unit[i, 2] - unit[i - 1, 2]
    size = np.sqrt(x * x + y * y + z * z)
    acceleration = _along(acceleration_limits, x / size, y / size, z / size)
    return float(acceleration * deviation * half_sine / (1 - half_sine))


@kernel
def _durations(
    target: FloatArray, start: FloatArray, is_motion: NDArray[np.bool_], feed: FloatArray,
    acceleration_limits: FloatArray, speed_limits: FloatArray, deviation: float, window: int,
) -> FloatArray:
    """Time of each block, (n,); lines without motion, and blocks of no length, are rests.

    target : (n, 3); feed : (n,); limits : (3,), of the axes; window : blocks looked ahead
    """
    n = len(target)
    length, unit = np.zeros(n), np.zeros((n, 3))
    acceleration, speed, entry_sq = np.empty(n), np.empty(n), np.zeros(n)
    slowest_axis = speed_limits.min()
    for i in range(n):
        x = target[i, 0] - (target[i - 1, 0] if i > 0 else start[0])
        y = target[i, 1] - (target[i - 1, 1] if i > 0 else start[1])
        z = target[i, 2] - (target[i - 1, 2] if i > 0 else start[2])
        size = np.sqrt(x * x + y * y + z * z)
        if is_motion[i] and size > 0.0:
            length[i] = size
            unit[i, 0], unit[i, 1], unit[i, 2] = x / size, y / size, z / size
        acceleration[i] = _along(acceleration_limits, unit[i, 0], unit[i, 1], unit[i, 2])
        speed[i] = feed[i]
        if feed[i] > slowest_axis:  # else no axis is asked for more than it can
            speed[i] = min(feed[i], _along(speed_limits, unit[i, 0], unit[i, 1], unit[i, 2]))
        if i > 0 and length[i] > 0.0 and length[i - 1] > 0.0:
            entry_sq[i] = min(_junction_speed_sq(unit, i, acceleration_limits, deviation),
                              min(speed[i], speed[i - 1]) ** 2)
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
