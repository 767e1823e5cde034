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
        for hopper, late in enumerate(self._dead_time_s):
            knots = known_s + late
            inside = knots[(knots > times_s[0]) & (knots < times_s[-1])]
            grid = np.unique(np.concatenate([times_s[[0, -1]], inside, ask_s]))
            wanted = np.interp(grid - late, known_s, known[:, hopper])
            flow = _follow(grid, wanted, self._lag_s[hopper], self._limit_g_s[hopper],
                           self._flow[hopper], self._leads)
            answer[:, hopper] = flow[np.searchsorted(grid, ask_s)]
            self._flow[hopper] = flow[-1]
        keep = np.searchsorted(known_s, times_s[-1] - self._dead_time_s.max() - 1e-9)
        keep = max(0, int(keep) - 1)
        self._past_s, self._past_g_s = known_s[keep:-1], known[keep:-1]
        return answer


@inner_kernel
def _lagged(y: float, u0: float, u1: float, lasting: float, lag: float) -> float:
    """A first-order lag after its input went linearly from u0 to u1."""
    slope = (u1 - u0) / lasting
    return u1 - lag * slope + (y - u0 + lag * slope) * math.exp(-lasting / lag)


@kernel
def _follow(
    times: FloatArray, wanted: FloatArray, lag: float, limit: float, start: float, leads: bool
) -> FloatArray:
    """Flow at the nozzle at each knot; exact, also where a set-point is clipped."""
    flow = np.empty(len(times))
    y = start
    flow[0] = y
    for k in range(len(times) - 1):
        lasting = times[k + 1] - times[k]
        w0, w1 = wanted[k], wanted[k + 1]
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
        flow[k + 1] = y
    return flow
