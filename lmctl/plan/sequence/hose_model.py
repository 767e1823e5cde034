"""Predict what the nozzle deposits: the planner's own model of powder in hose and mixer.

Each hopper: dead time θ, then a first-order lag τ. With lead, the set-point is
u(t) = clip(w(t + θ) + τ w′(t + θ), 0, u_max), so θ cancels and the flow at the nozzle is w itself
wherever u meets no bound; without, u is w, and both θ and τ show.
"""

from __future__ import annotations

import math

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel

#: A lag below this is none [s].
_NO_LAG_S = 1e-6


class HoseModel:
    """Flow of every hopper at the nozzle as program time goes on; before it starts, settled.

    leads : whether set-points lead by θ and τ (powder mode "lead")
    """

    def __init__(
        self, dead_time_s: FloatArray, lag_s: FloatArray, limit_g_s: FloatArray, *, leads: bool
    ) -> None:
        self._dead_time_s = np.zeros_like(dead_time_s) if leads else dead_time_s
        self._lag_s = np.maximum(lag_s, _NO_LAG_S)
        self._limit_g_s = limit_g_s
        self._leads = leads
        self._flow: FloatArray | None = None
        self._past_s = np.empty(0)
        self._past_g_s = np.empty((0, len(lag_s)))

    def advance(self, times_s: FloatArray, wanted_g_s: FloatArray, ask_s: FloatArray) -> FloatArray:
        """Go on by one layer of the program.

        times_s, wanted_g_s : (k,), (k, m) knots of the wanted flow, going on from the last layer
        ask_s : (q,) rising times within the layer
        returns : (q, m) flow at the nozzle [g/s]
        """
        known_s = np.concatenate([self._past_s, times_s])
        known = np.concatenate([self._past_g_s, wanted_g_s])
        if self._flow is None:
            self._flow = wanted_g_s[0].copy()
        answer = np.empty((len(ask_s), known.shape[1]))
        _follow(known_s, np.ascontiguousarray(known), float(times_s[0]), float(times_s[-1]),
                self._dead_time_s, self._lag_s, self._limit_g_s, self._leads, ask_s, self._flow,
                answer)
        keep = np.searchsorted(known_s, times_s[-1] - self._dead_time_s.max() - 1e-9)
        keep = max(0, int(keep) - 1)
        self._past_s, self._past_g_s = known_s[keep:-1], known[keep:-1]
        return answer


@inner_kernel
def _lagged(y: float, u0: float, u1: float, lasting: float, lag: float) -> float:
    """A first-order lag after its input went linearly from u0 to u1."""
    slope = (u1 - u0) / lasting
    return u1 - lag * slope + (y - u0 + lag * slope) * math.exp(-lasting / lag)


@inner_kernel
def _followed(
    y: float, w0: float, w1: float, lasting: float, lag: float, limit: float, leads: bool
) -> float:
    """Flow at the nozzle after the wanted flow went linearly from w0 to w1; exact, also where a
    set-point is clipped."""
    ahead = lag * (w1 - w0) / lasting if leads else 0.0
    u0, u1 = w0 + ahead, w1 + ahead
    # The set-point is linear between the places where it meets a bound.
    at = 0.0
    while at < 1.0:
        u = u0 + at * (u1 - u0)
        stop = 1.0
        for bound in (0.0, limit):
            if u1 != u0:
                cross = (bound - u0) / (u1 - u0)
                if at + 1e-12 < cross < stop:
                    stop = cross
        end = u0 + stop * (u1 - u0)
        y = _lagged(y, min(max(u, 0.0), limit), min(max(end, 0.0), limit),
                    (stop - at) * lasting, lag)
        at = stop
    return y


@kernel
def _follow(
    known_s: FloatArray, known: FloatArray, begin_s: float, end_s: float, dead_time: FloatArray,
    lag: FloatArray, limit: FloatArray, leads: bool, ask_s: FloatArray, flow: FloatArray,
    answer: FloatArray,
) -> None:
    """Flow at the nozzle from one time to another, from knot to knot and question to question.

    known_s, known : (k,), (k, m) wanted; flow : (m,) at the nozzle, goes on to `end_s`
    ask_s : (q,) rising; answer : (q, m), filled
    """
    n = len(known_s)
    for hopper in range(len(flow)):
        late, y = dead_time[hopper], flow[hopper]
        now, k = begin_s, 0
        while k < n and known_s[k] + late <= now:
            k += 1
        w0 = _wanted(known_s, known, hopper, k, now - late)
        asked = 0
        while asked < len(ask_s) or now < end_s:
            goal = end_s
            if k < n:
                goal = min(goal, known_s[k] + late)
            if asked < len(ask_s):
                goal = min(goal, ask_s[asked])
            if goal > now:
                w1 = _wanted(known_s, known, hopper, k, goal - late)
                y = _followed(y, w0, w1, goal - now, lag[hopper], limit[hopper], leads)
                now, w0 = goal, w1
            while asked < len(ask_s) and ask_s[asked] <= now:
                answer[asked, hopper] = y
                asked += 1
            while k < n and known_s[k] + late <= now:
                k += 1
            if asked < len(ask_s) and now >= end_s:  # nothing is known of later
                while asked < len(ask_s):
                    answer[asked, hopper] = y
                    asked += 1
        flow[hopper] = y


@inner_kernel
def _wanted(
    known_s: FloatArray, known: FloatArray, hopper: int, after: int, at_s: float
) -> float:
    """The flow wanted at a time before knot `after` and not before the one ahead of that."""
    last = len(known_s) - 1
    if after <= 0:
        return float(known[0, hopper])
    if after > last:
        return float(known[last, hopper])
    slope = (known[after, hopper] - known[after - 1, hopper]) / (
        known_s[after] - known_s[after - 1])
    return float(known[after - 1, hopper] + slope * (at_s - known_s[after - 1]))
