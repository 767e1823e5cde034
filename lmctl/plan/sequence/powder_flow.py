"""Powder flow the nozzle must deliver over program time: knots of every hopper's flow.

Along beads the flow follows the mixture, linear from vertex to vertex; in mode "lead" as nearly as
hoppers can. From bead to bead it changes while the beam is off: along a ramp that the feeders can
follow (mode "lead"), or at once as soon as the beam is off, as machines without compensation do
("dwell", "none"). In long gaps it stops (`powder_pause`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.sequence.mixture_ramps import (
    MAX_KNOT_SPACING_S,
    NO_LAG_S,
    PowderLimits,
    deliverable_ramp_fraction,
    has_caught_up,
    ramp_knots,
)
from lmctl.plan.sequence.powder_pause import PAUSE_KNOTS, PowderPause, pause_knots

#: A set-point step, as knots of a piecewise-linear flow need one [s].
_STEP_S = 1e-3

#: Flow never stops.
NO_PAUSE = PowderPause(0.0, np.inf)


@dataclass(frozen=True)
class PowderFlow:
    """times_s : (k,) rising; g_s : (k, hoppers) [g/s], linear in between."""

    times_s: FloatArray
    g_s: FloatArray


def powder_flow(
    start_s: float, end_s: float, bead_s: FloatArray, bead_g_s: FloatArray, starts: IndexArray,
    limits: PowderLimits, mode: str, before_g_s: FloatArray, margin_s: float = 0.0,
    pause: PowderPause = NO_PAUSE,
) -> PowderFlow:
    """Flow wanted at the nozzle during one layer, from `start_s` to `end_s`.

    bead_s : (v,) program time at the vertices of m beads; bead_g_s : (v, hoppers) flow wanted there
    starts : (m + 1,) bead k is vertices starts[k] to starts[k + 1]
    mode : "lead", "dwell" or "none"; before_g_s : (hoppers,) flow at the end of the layer before
    margin_s : changes from bead to bead keep so far from the ends of both, where there is time
    pause : when flow stops between beads, in mode "lead"
    """
    knots_s, flow = _knots(
        start_s, bead_s, np.ascontiguousarray(bead_g_s), starts, mode == "lead",
        np.maximum(limits.lag_s, NO_LAG_S), limits.max_flow_g_s, before_g_s,
        margin_s, pause.steady_s, pause.least_off_s)
    return _thinned(np.append(knots_s, end_s), np.vstack([flow, flow[-1:]]))


def followed_flow(
    times_s: FloatArray, wanted_g_s: FloatArray, start_g_s: FloatArray, limits: PowderLimits
) -> PowderFlow:
    """The flow the nozzle can deliver, from `start_g_s` (hoppers,) on, to follow a wanted flow.

    It is the wanted flow where set-points within their bounds can follow. Else all hoppers go
    straight towards it, as fast as the slowest of them can, until they have caught up.

    times_s, wanted_g_s : (k,) rising, (k, hoppers) knots of the flow wanted
    """
    knots_s, flow = _knots(
        float(times_s[0]), times_s, np.ascontiguousarray(wanted_g_s, np.float64),
        np.array([0, len(times_s)]), True, np.maximum(limits.lag_s, NO_LAG_S), limits.max_flow_g_s,
        np.asarray(start_g_s, np.float64), 0.0, 0.0, np.inf)
    return PowderFlow(np.asarray(knots_s[1:]), np.asarray(flow[1:]))


@kernel
def _knots(
    start_s: float, bead_s: FloatArray, wanted: FloatArray, starts: IndexArray, leads: bool,
    lag: FloatArray, most: FloatArray, before: FloatArray, margin_s: float, steady_s: float,
    least_off_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Gap by gap and bead by bead; a gap starts from the flow that the bead before it reached."""
    count = (len(starts) - 1) * (PAUSE_KNOTS + 2)
    for k in range(1, len(bead_s)):
        count += max(1, int(np.ceil((bead_s[k] - bead_s[k - 1]) / MAX_KNOT_SPACING_S)))
    times = np.empty(count)
    flow = np.empty((count, wanted.shape[1]))
    now = before.copy()
    now_s = start_s
    n = 0
    for bead in range(len(starts) - 1):
        first = starts[bead]
        gap_s = bead_s[first] - now_s
        paused = 0
        if leads and gap_s > steady_s + least_off_s:
            paused = pause_knots(now, wanted[first], gap_s, lag, most, steady_s, least_off_s,
                                 times[n:], flow[n:])
        if paused:
            times[n:n + paused] += now_s
            times[n + paused] = bead_s[first]
            _put_between(flow[n + paused], wanted[first], wanted[first], 0.0)
            n = _follow_bead(bead_s, wanted, first, starts[bead + 1], leads, lag, most, times, flow,
                             n + paused + 1)
            now_s = bead_s[starts[bead + 1] - 1]
            _put_between(now, flow[n - 1], flow[n - 1], 0.0)
            continue
        if leads and gap_s > 0.0:
            course_s, share = ramp_knots(
                now, wanted[first], gap_s, lag, most, margin_s)
        else:
            course_s, share = np.array([0.0, min(_STEP_S, gap_s / 2)]), np.array([0.0, 1.0])
        times[n] = now_s
        _put_between(flow[n], now, wanted[first], 0.0)
        n += 1
        for k in range(len(course_s)):
            if course_s[k] < gap_s - 1e-9:
                times[n] = now_s + course_s[k]
                _put_between(flow[n], now, wanted[first], share[k])
                n += 1
        arrived = 1.0
        if leads:
            arrived = _share_at(gap_s, course_s, share) if gap_s > 0.0 else 0.0
        times[n] = bead_s[first]
        _put_between(flow[n], now, wanted[first], arrived)
        n += 1
        n = _follow_bead(
            bead_s, wanted, first, starts[bead + 1], leads, lag, most, times, flow, n)
        now_s = bead_s[starts[bead + 1] - 1]
        _put_between(now, flow[n - 1], flow[n - 1], 0.0)
    return times[:n], flow[:n]


@inner_kernel
def _put_between(row: FloatArray, before: FloatArray, after: FloatArray, share: float) -> None:
    """Set a row to what lies between two others; a loop loads faster than array expressions."""
    for k in range(len(row)):
        row[k] = before[k] + share * (after[k] - before[k])


@inner_kernel
def _share_at(at_s: float, course_s: FloatArray, share: FloatArray) -> float:
    """The share that has arrived at a time of a course, linear between its knots."""
    last = len(course_s) - 1
    if at_s <= course_s[0]:
        return float(share[0])
    if at_s >= course_s[last]:
        return float(share[last])
    k = 1
    while course_s[k] <= at_s:
        k += 1
    slope = (share[k] - share[k - 1]) / (course_s[k] - course_s[k - 1])
    return float(slope * (at_s - course_s[k - 1]) + share[k - 1])


@inner_kernel
def _follow_bead(
    bead_s: FloatArray, wanted: FloatArray, first: int, end: int, leads: bool, lag: FloatArray,
    most: FloatArray, times: FloatArray, flow: FloatArray, n: int,
) -> int:
    """Knots along one bead after the one already there; returns how many there are then."""
    goal = np.empty(wanted.shape[1])
    for k in range(first + 1, end):
        lasting = bead_s[k] - bead_s[k - 1]
        if not leads or (
            has_caught_up(flow[n - 1], wanted[k - 1], most)
            and deliverable_ramp_fraction(flow[n - 1], wanted[k], lasting, lag, most) >= 1.0 - 1e-9
        ):
            times[n] = bead_s[k]
            _put_between(flow[n], wanted[k], wanted[k], 0.0)
            n += 1
            continue
        pieces = max(1, int(np.ceil(lasting / MAX_KNOT_SPACING_S)))
        for piece in range(1, pieces + 1):
            times[n] = bead_s[k - 1] + lasting * piece / pieces if piece < pieces else bead_s[k]
            for m in range(len(goal)):
                goal[m] = wanted[k - 1, m] + (wanted[k, m] - wanted[k - 1, m]) * piece / pieces
            share = deliverable_ramp_fraction(flow[n - 1], goal, times[n] - times[n - 1], lag, most)
            _put_between(flow[n], flow[n - 1], goal, min(share, 1.0))
            n += 1
    return n


def _thinned(times_s: FloatArray, flow: FloatArray) -> PowderFlow:
    """Strictly rising times, without knots in the middle of constant stretches."""
    end_s = times_s[-1]
    keep = np.concatenate([[True], np.diff(times_s) > 1e-9])
    times_s, flow = times_s[keep], flow[keep]
    times_s[-1] = end_s
    same = np.asarray((np.abs(np.diff(flow, axis=0)) <= 1e-12).all(axis=1))
    inner_knots = np.zeros(len(times_s), dtype=np.bool_)
    inner_knots[1:-1] = same[1:] & same[:-1]
    return PowderFlow(times_s[~inner_knots], np.maximum(flow[~inner_knots], 0.0))
