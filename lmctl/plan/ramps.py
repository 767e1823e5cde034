"""Changing the mixture while the beam is off: how long it must take, and along which course.

All hoppers go from flows a to flows b along one course λ(t) from 0 to 1, w = a + λ(b − a), so the
total volume changes evenly too. A set-point u = w + τ w′ must stay within [0, u_max], which bounds
how fast each hopper may rise (towards u_max) or fall (towards nothing): process.md 2.3.

Under a lit beam the same bounds hold; a mixture that changes faster is followed as well as they
allow, behind what is wanted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Feeders take a new set-point about ten times a second: a faster course would be a step to them.
LEAST_RAMP_S = 0.25
#: Volume fraction that may still be missing where the beam comes on; it goes on settling then.
SETTLED = 0.01
#: Courses take this much longer than the bounds demand, so that set-points stay off them.
_MARGIN = 1.1
#: λ at which the fastest course is given knots: it closes in on b exponentially.
_COURSE = np.append(1 - np.exp(-np.linspace(0, 4.8, 25)), 1.0)
#: Where powder is behind, its flow has knots at most so far apart [s],
_PIECE_S = 0.05
#: and it has caught up when no more than this share of a hopper's greatest flow is missing.
_CAUGHT_UP = 1e-4
#: A lag below this is none [s].
_NO_LAG_S = 1e-6


@dataclass(frozen=True)
class Limits:
    """Of every hopper, each (m,) float64: lag [s], greatest flow, and volume laid per gram fed."""

    lag_s: FloatArray
    max_flow_g_s: FloatArray
    volume_mm3_g: FloatArray


def needed_s(start: FloatArray, end: FloatArray, limits: Limits, step: float) -> float:
    """Shortest time for a change of mixture to have arrived, within `SETTLED`, at the nozzle.

    start, end : (m,) flows [g/s]; step : changes of volume fraction up to this are waited for
        by no one, since beads take them in their stride
    """
    change = np.abs(_fractions(end[None], limits) - _fractions(start[None], limits)).max()
    if change <= step * 1.01:
        return 0.0
    course_s = _fastest_course_s(start, end, limits)
    missing = np.abs(
        _fractions(start + _COURSE[:, None] * (end - start), limits)
        - _fractions(end[None], limits)
    ).max(axis=1)
    settled_s = float(np.interp(-SETTLED, -missing, course_s))
    return max(LEAST_RAMP_S, min(_linear_s(start, end, limits), settled_s))


def ramp(
    start: FloatArray, end: FloatArray, gap_s: float, limits: Limits
) -> tuple[FloatArray, FloatArray]:
    """Knots of the share λ of the change that has arrived: times from the gap's start, values.

    A straight ramp in the middle of the gap where bounds and time allow one; else the fastest
    course, from the gap's start, of which a rest may remain for the time after the gap.
    returns : (k,) rising from ≥ 0, (k,) rising from 0 to 1
    """
    straight = _linear_s(start, end, limits)
    if straight <= gap_s:
        lasting = min(gap_s, max(straight, gap_s / 2, min(LEAST_RAMP_S, gap_s)))
        first = (gap_s - lasting) / 2
        return np.array([first, first + lasting]), np.array([0.0, 1.0])
    course_s = _fastest_course_s(start, end, limits)
    if course_s[-1] < gap_s:
        course_s = course_s * (gap_s / course_s[-1])
    return course_s, _COURSE


def followed(
    times_s: FloatArray, wanted_g_s: FloatArray, start_g_s: FloatArray, limits: Limits
) -> tuple[FloatArray, FloatArray]:
    """What the nozzle can be brought to deliver, from `start_g_s` (m,) on, of a flow wanted.

    Where set-points within their bounds can follow, it is what is wanted. Else all hoppers go
    straight towards it, at the pace of the slowest, until they have caught up.

    times_s, wanted_g_s : (k,) rising, (k, m) knots of the flow wanted
    returns : (q,) rising, among them all of times_s; (q, m)
    """
    return _followed(
        times_s, wanted_g_s, start_g_s, np.maximum(limits.lag_s, _NO_LAG_S), limits.max_flow_g_s)


@njit(cache=True)
def _share_of_way(
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


@njit(cache=True)
def _followed(
    times: FloatArray, wanted: FloatArray, start: FloatArray, lag: FloatArray, most: FloatArray
) -> tuple[FloatArray, FloatArray]:
    count = 1
    for k in range(len(times) - 1):
        count += max(1, int(np.ceil((times[k + 1] - times[k]) / _PIECE_S)))
    at = np.empty(count)
    flow = np.empty((count, wanted.shape[1]))
    at[0], flow[0] = times[0], start
    n = 1
    for k in range(len(times) - 1):
        lasting = times[k + 1] - times[k]
        caught_up = (np.abs(flow[n - 1] - wanted[k]) <= _CAUGHT_UP * most).all()
        share = _share_of_way(flow[n - 1], wanted[k + 1], lasting, lag, most)
        if caught_up and share >= 1.0 - 1e-9:
            at[n], flow[n] = times[k + 1], wanted[k + 1]
            n += 1
            continue
        pieces = max(1, int(np.ceil(lasting / _PIECE_S)))
        for piece in range(1, pieces + 1):
            at[n] = times[k] + lasting * piece / pieces if piece < pieces else times[k + 1]
            goal = wanted[k] + (wanted[k + 1] - wanted[k]) * piece / pieces
            share = _share_of_way(flow[n - 1], goal, at[n] - at[n - 1], lag, most)
            flow[n] = flow[n - 1] + min(share, 1.0) * (goal - flow[n - 1])
            n += 1
    return at[:n], flow[:n]


def _fractions(flow: FloatArray, limits: Limits) -> FloatArray:
    volume = flow * limits.volume_mm3_g
    return np.asarray(volume / volume.sum(axis=1, keepdims=True))


def _linear_s(start: FloatArray, end: FloatArray, limits: Limits) -> float:
    """Shortest straight ramp; infinite where a hopper is to stop or to reach its greatest flow."""
    room = np.where(end > start, limits.max_flow_g_s - end, end)
    change = np.abs(end - start)
    slow = limits.lag_s * np.where(change > 1e-12, change, 0.0)
    time = np.where(slow > 0, np.inf, 0.0)
    np.divide(slow, room, out=time, where=room > 1e-9)
    return float(time.max()) * _MARGIN


def _fastest_course_s(start: FloatArray, end: FloatArray, limits: Limits) -> FloatArray:
    """When the fastest course reaches each of `_COURSE`: the slowest hopper sets the pace.

    Saturated, a flow w falls as dt = −τ dw / w and rises as dt = τ dw / (u_max − w).
    """
    flow = start + _COURSE[:, None] * (end - start)
    room = np.where(end > start, limits.max_flow_g_s - flow, flow)
    room = np.maximum(room, 1e-3 * np.maximum(np.abs(end - start), 1e-12))  # never quite reached
    time = limits.lag_s * np.abs(np.diff(np.log(room), axis=0))
    return np.concatenate([[0.0], np.cumsum(time.max(axis=1))]) * _MARGIN
