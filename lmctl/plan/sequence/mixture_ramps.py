"""Change the mixture while the beam is off: find the time it takes and the course.

All hoppers go from flows a to flows b along one course λ(t) from 0 to 1, w = a + λ(b − a), so the
total volume changes evenly too. A set-point u = w + τ w′ must stay within [0, u_max], which bounds
how fast each hopper may rise (towards u_max) or fall (towards nothing), τ being the hopper's lag.

With the beam on the same bounds hold. The flow follows a faster change of mixture as well as they
allow, and lags behind the wanted flow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.recipe import Recipe

#: Feeders take a new set-point about ten times a second: a faster course would be a step to them.
MIN_RAMP_S = 0.25
#: Volume fraction that may still be missing where the beam comes on; it goes on settling then.
SETTLED_FRACTION = 0.01
#: Where powder is behind, its flow has knots at most so far apart [s].
MAX_KNOT_SPACING_S = 0.05
#: With a margin, changes of volume fraction up to this take no time of their own.
_NO_CHANGE_FRACTION = 0.004
#: A lag below this is none [s].
NO_LAG_S = 1e-6
#: Courses take this much longer than the bounds demand, so that set-points stay off them.
_MARGIN = 1.1
#: λ at which the fastest course is given knots: it closes in on b exponentially.
COURSE_KNOTS = np.append(1 - np.exp(-np.linspace(0, 4.8, 25)), 1.0)
#: Powder has caught up when no more than this share of a hopper's greatest flow is missing.
_CAUGHT_UP = 1e-4


@dataclass(frozen=True)
class PowderLimits:
    """Of every hopper, each (m,) float64: lag [s], greatest flow, and volume deposited per gram."""

    lag_s: FloatArray
    max_flow_g_s: FloatArray
    volume_mm3_g: FloatArray


def powder_limits_of(recipe: Recipe) -> PowderLimits:
    """The limits of the hoppers a recipe uses."""
    return PowderLimits(
        recipe.lag_s, recipe.max_flow_g_s, recipe.catch_efficiency / recipe.density_g_mm3)


def min_ramp_duration_s(
    start: FloatArray, end: FloatArray, limits: PowderLimits, step: float
) -> FloatArray:
    """Shortest time for changes of mixture to have arrived, within `SETTLED`, at the nozzle.

    start, end : (k, m) flows [g/s]; returns (k,) [s]
    step : changes of volume fraction up to this take no time of their own, since beads pass
        through them at full speed
    """
    return np.asarray(_needed(
        np.ascontiguousarray(start), np.ascontiguousarray(end), limits.lag_s, limits.max_flow_g_s,
        limits.volume_mm3_g, step))


def needed_before_beads_s(
    start: FloatArray, end: FloatArray, limits: PowderLimits, step: float, margin_s: float
) -> FloatArray:
    """Time that changes of mixture need with the beam off, margins included, (k,) [s].

    start, end, step : as for `min_ramp_duration_s`
    margin_s : kept free before and after each change; with a margin, small changes need time, too
    """
    if margin_s <= 0:
        return min_ramp_duration_s(start, end, limits, step)
    needed = min_ramp_duration_s(start, end, limits, min(step, _NO_CHANGE_FRACTION))
    return np.asarray(np.where(needed > 0, needed + 2 * margin_s, 0.0))


@kernel
def _needed(
    start: FloatArray, end: FloatArray, lag: FloatArray, most: FloatArray, volume: FloatArray,
    step: float,
) -> FloatArray:
    result = np.zeros(len(start))
    for k in range(len(start)):
        a, b = start[k], end[k]
        if _fraction_change(a, b, volume) <= step * 1.01:
            continue
        times = fastest_course(a, b, lag, most)
        settled, before = times[-1], np.inf
        for i in range(len(COURSE_KNOTS)):
            missing = _fraction_change(a + COURSE_KNOTS[i] * (b - a), b, volume)
            if missing <= SETTLED_FRACTION:
                settled = times[i]
                if i > 0 and before > missing:
                    into = (before - SETTLED_FRACTION) / (before - missing)
                    settled = times[i - 1] + into * (times[i] - times[i - 1])
                break
            before = missing
        result[k] = max(MIN_RAMP_S, min(_linear_time(a, b, lag, most), settled))
    return result


@kernel
def ramp_knots(
    start: FloatArray, end: FloatArray, gap_s: float, lag: FloatArray, most: FloatArray,
    margin_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Knots of the share λ of the change that has arrived: times from the gap's start, values.

    A straight ramp in the middle of the gap where bounds and time allow one; else the fastest
    course, from the gap's start, of which a rest may remain for the time after the gap.

    start, end, lag, most : (m,) flows [g/s], lags [s], greatest flows [g/s]
    margin_s : the change keeps so far from both ends of the gap, as far as there is time
    returns : (k,) rising from ≥ 0, (k,) rising from 0 to 1
    """
    straight = _linear_time(start, end, lag, most)
    if straight <= gap_s:
        even = min(gap_s / 2, max(gap_s - 2 * margin_s, 0.0))
        lasting = min(gap_s, max(straight, even, min(MIN_RAMP_S, gap_s)))
        first = (gap_s - lasting) / 2
        return np.array([first, first + lasting]), np.array([0.0, 1.0])
    times = fastest_course(start, end, lag, most)
    before_s = min(margin_s, max(gap_s - times[-1], 0.0) / 2)
    if times[-1] < gap_s - 2 * before_s:
        times *= (gap_s - 2 * before_s) / times[-1]
    times += before_s
    return times, COURSE_KNOTS.copy()


@inner_kernel
def fastest_course(
    start: FloatArray, end: FloatArray, lag: FloatArray, most: FloatArray
) -> FloatArray:
    """When the fastest course reaches each of `COURSE`: the slowest hopper sets it.

    Saturated, a flow w falls as dt = −τ dw / w and rises as dt = τ dw / (u_max − w).
    """
    times = np.zeros(len(COURSE_KNOTS))
    for i in range(1, len(COURSE_KNOTS)):
        slowest = 0.0
        for m in range(len(start)):
            change = end[m] - start[m]
            never = 1e-3 * max(abs(change), 1e-12)  # a bound is never quite reached
            ends = (start[m] + COURSE_KNOTS[i - 1] * change, start[m] + COURSE_KNOTS[i] * change)
            room = max(most[m] - ends[0] if change > 0 else ends[0], never)
            left = max(most[m] - ends[1] if change > 0 else ends[1], never)
            slowest = max(slowest, lag[m] * abs(np.log(left / room)))
        times[i] = times[i - 1] + _MARGIN * slowest
    return times


@inner_kernel
def _linear_time(start: FloatArray, end: FloatArray, lag: FloatArray, most: FloatArray) -> float:
    """Shortest straight ramp; infinite where a hopper is to stop or to reach its greatest flow."""
    longest = 0.0
    for m in range(len(start)):
        change = abs(end[m] - start[m])
        if change <= 1e-12 or lag[m] == 0.0:
            continue
        room = most[m] - end[m] if end[m] > start[m] else end[m]
        longest = max(longest, lag[m] * change / room if room > 1e-9 else np.inf)
    return longest * _MARGIN


@inner_kernel
def _fraction_change(start: FloatArray, end: FloatArray, volume: FloatArray) -> float:
    """Greatest change of volume fraction between two flows."""
    total, other, most = 0.0, 0.0, 0.0
    for m in range(len(start)):
        total += start[m] * volume[m]
        other += end[m] * volume[m]
    for m in range(len(start)):
        most = max(most, abs(end[m] * volume[m] / other - start[m] * volume[m] / total))
    return most


@inner_kernel
def deliverable_ramp_fraction(
    flow: FloatArray, goal: FloatArray, lasting: float, lag: FloatArray, most: FloatArray
) -> float:
    """Share of a straight change that keeps w + τ w′ within [0, u_max] for its whole time."""
    share = 1.0
    for m in range(len(flow)):
        change = goal[m] - flow[m]
        if abs(change) <= 1e-12:
            continue
        room = (most[m] - flow[m]) if change > 0 else flow[m]
        share = min(share, room * lasting / (lasting + lag[m]) / abs(change))
    return max(share, 0.0)


@inner_kernel
def approach_flow(flow: FloatArray, goal: FloatArray, share: float) -> None:
    """Change a flow, in place, by a share of what it differs from another; 1 makes them equal."""
    for m in range(len(flow)):
        flow[m] = goal[m] if share == 1.0 else flow[m] + share * (goal[m] - flow[m])


@inner_kernel
def has_caught_up(flow: FloatArray, wanted: FloatArray, most: FloatArray) -> bool:
    """Whether a flow equals the wanted flow, within the share `_CAUGHT_UP`."""
    missing = 0.0
    for m in range(len(flow)):
        missing = max(missing, abs(flow[m] - wanted[m]) - _CAUGHT_UP * most[m])
    return missing <= 0.0
