"""Predict the set-points that running will send: held from tick to tick, rounded, within a slack.

Running looks at the flow wanted at ticks of 0.1 s and keeps a set-point for as long as the modelled
outflow of the hose's lag stays within a slack of it (`lmctl.preflight.setpoint_rules`). Here the
same is done in program time, at the planned rate. A job starts at a tick, its longest dead time
before the program does; so ticks are counted from there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.preflight.setpoint_rules import (
    CHOSEN_WITHIN,
    CLOCK_MARGIN_S,
    FLOW_DECIMALS,
    MAX_HOLD_TICKS,
    MAX_TICKS,
    MIN_OUTFLOW_TOLERANCE_G_MIN,
    OUTFLOW_TOLERANCE_FRACTION,
    SETPOINT_PERIOD_S,
)

_STEPS = 10.0**FLOW_DECIMALS


class HopperValues(Protocol):
    """What is believed of a hopper: of a profile with its calibration, or as a job has it."""

    @property
    def dead_time_s(self) -> float: ...
    @property
    def lag_s(self) -> float: ...
    @property
    def min_flow_g_min(self) -> float: ...
    @property
    def max_flow_g_min(self) -> float: ...
    @property
    def slope(self) -> float: ...
    @property
    def offset_g_min(self) -> float: ...


@dataclass(frozen=True)
class SetpointChanges:
    """What hoppers are set to, each held until the next change.

    time_s : (k,) float64, program times, rising
    setpoint_g_min : (k, hoppers) float64, as sent: rounded, and 0 for a disc that stands still
    """

    time_s: FloatArray
    setpoint_g_min: FloatArray

    def since(self, begin_s: float) -> SetpointChanges:
        """The changes in force at a time and after it."""
        first = max(int(np.searchsorted(self.time_s, begin_s, side="right")) - 1, 0)
        return SetpointChanges(self.time_s[first:], self.setpoint_g_min[first:])

    def until(self, end_s: float) -> SetpointChanges:
        """The changes up to a time."""
        end = int(np.searchsorted(self.time_s, end_s, side="right"))
        return SetpointChanges(self.time_s[:end], self.setpoint_g_min[:end])


class HeldSetpoints:
    """Predicts set-points as flow becomes known, layer by layer.

    hoppers : of the job, with the values that running will believe
    leads : powder mode "lead"
    known_until_s : program time up to which set-points are predicted
    """

    def __init__(self, hoppers: Sequence[HopperValues], *, leads: bool) -> None:
        self._dead_time_s = np.array([hopper.dead_time_s if leads else 0.0 for hopper in hoppers])
        self._lag_s = np.array([hopper.lag_s for hopper in hoppers])
        self._least = np.array([hopper.min_flow_g_min for hopper in hoppers])
        self._most = np.array([hopper.max_flow_g_min for hopper in hoppers])
        self._slope = np.array([hopper.slope for hopper in hoppers])
        self._offset = np.array([hopper.offset_g_min for hopper in hoppers])
        self._leads = leads
        self._ahead_s = float(self._dead_time_s.max()) + (MAX_HOLD_TICKS + 1) * SETPOINT_PERIOD_S
        self._times_s = np.empty(0)
        self._g_min = np.empty((0, len(hoppers)))
        self._state: FloatArray | None = None
        self._first_s = -float(self._dead_time_s.max())
        self._tick, self._since = 0, 0
        self._changes = SetpointChanges(np.empty(0), np.empty((0, len(hoppers))))
        self.known_until_s = -math.inf

    def add_flow(self, times_s: FloatArray, flow_g_s: FloatArray) -> None:
        """Knots of the flow wanted of each hopper, (k,) and (k, hoppers), after those so far."""
        if self._state is None:
            first = flow_g_s[0] * 60.0
            self._state = np.column_stack([first, first, np.ones_like(first)])
        self._times_s = np.concatenate([self._times_s, times_s])
        self._g_min = np.concatenate([self._g_min, flow_g_s * 60.0])
        self._predict_until(float(self._times_s[-1]) - self._ahead_s)

    def finish(self) -> None:
        """The flow ends as it is: predict all set-points that are left."""
        if self._state is not None:
            self._predict_until(float(self._times_s[-1]) + SETPOINT_PERIOD_S)

    def changes_since(self, begin_s: float) -> SetpointChanges:
        """What hoppers are set to from begin_s on, up to `known_until_s`."""
        return self._changes.since(begin_s)

    def forget_before(self, time_s: float) -> None:
        """Drop the changes that are over by then."""
        self._changes = self._changes.since(time_s)

    def _predict_until(self, end_s: float) -> None:
        assert self._state is not None, "flow was added"
        ticks = math.floor((end_s - self._first_s) / SETPOINT_PERIOD_S + 1e-9)
        if ticks < self._tick:
            return
        changed, flows, count, self._tick, self._since = _held(
            self._times_s - self._first_s, self._g_min, self._dead_time_s, self._lag_s, self._least,
            self._most, self._state, self._tick, self._since, ticks, self._leads)
        setpoints = np.round((flows[:count] - self._offset) / self._slope, FLOW_DECIMALS)
        setpoints = np.where(flows[:count] > 0.0, np.maximum(setpoints, 0.0), 0.0)
        changed_s = self._first_s + changed[:count] * SETPOINT_PERIOD_S
        self._changes = SetpointChanges(
            np.concatenate([self._changes.time_s, changed_s]),
            np.concatenate([self._changes.setpoint_g_min, setpoints]))
        self.known_until_s = self._first_s + ticks * SETPOINT_PERIOD_S
        next_s = self._first_s + self._tick * SETPOINT_PERIOD_S
        kept = max(int(np.searchsorted(self._times_s, next_s)) - 1, 0)
        self._times_s, self._g_min = self._times_s[kept:], self._g_min[kept:]


@kernel
def _held(
    times: FloatArray, wanted: FloatArray, dead: FloatArray, lag: FloatArray, least: FloatArray,
    most: FloatArray, state: FloatArray, tick: int, since: int, last: int, leads: bool,
) -> tuple[NDArray[np.int64], FloatArray, int, int, int]:
    """Ticks from `tick` to `last` at which set-points change, the flows set then, how many there
    are, the next tick that is looked at, and how many ticks after the one before that is.

    state : (m, 3) of each hopper: modelled outflow and set-point at the last tick [g/min], and for
        how many ticks that is to last; changed in place
    since : ticks from the last one that was looked at to `tick`; 0 for the first of a job
    """
    m = wanted.shape[1]
    changed = np.empty(last - tick + 1, np.int64)
    flows = np.empty((last - tick + 1, m))
    now = np.empty(m)
    count = 0
    while tick <= last:
        t = tick * SETPOINT_PERIOD_S  # since the first tick, as `times` are
        rest_s = np.inf
        differs = False
        for h in range(m):
            if leads:
                flow = _chosen(times, wanted, h, t, dead[h], lag[h], least[h], most[h], state,
                               since)
            else:
                flow = min(_at(times, wanted, h, t), most[h])
                state[h, 2] = 1.0
            flow = np.round(flow * _STEPS) / _STEPS
            differs = differs or flow != state[h, 1] or since == 0
            state[h, 1] = flow
            now[h] = flow
            rest_s = min(rest_s, max(state[h, 2] * SETPOINT_PERIOD_S,
                                     _steady_s(times, wanted, h, t + dead[h], state, leads)))
        if differs:
            changed[count] = tick
            for h in range(m):
                flows[count, h] = now[h]
            count += 1
        since = int(min(max(rest_s / SETPOINT_PERIOD_S + 1e-6, 1.0), MAX_TICKS))
        tick += since
    return changed, flows, count, tick, since


@inner_kernel
def _chosen(
    times: FloatArray, wanted: FloatArray, h: int, t: float, dead: float, lag: float,
    least: float, most: float, state: FloatArray, since: int,
) -> float:
    """The set-point of one hopper at a tick, `since` ticks after the last one."""
    rest = math.exp(-SETPOINT_PERIOD_S / lag) if lag > 0.0 else 0.0
    held = state[h, 1]
    outflow = held + (state[h, 0] - held) * rest**since
    state[h, 0] = outflow
    state[h, 2] = max(state[h, 2] - since, 1.0)
    goal = _at(times, wanted, h, t + dead + SETPOINT_PERIOD_S)
    if abs(held + (outflow - held) * rest - goal) <= _slack(goal):
        return float(held)
    lowest_yet, most_yet, left = 0.0, most, 1.0
    setpoint, lasts = 0.0, 0
    for n in range(1, MAX_HOLD_TICKS + 1):
        goal = _at(times, wanted, h, t + dead + n * SETPOINT_PERIOD_S)
        left *= rest
        slack = CHOSEN_WITHIN * _slack(goal)
        came, before = 1.0 - left, outflow * left
        low = max(lowest_yet, (goal - slack - before) / came)
        high = min(most_yet, (goal + slack - before) / came)
        if low > high:
            if lasts == 0:
                setpoint = min(max((goal - before) / came, 0.0), most)
            break
        lowest_yet, most_yet, lasts = low, high, lasts + 1
        setpoint = min(max((goal - before) / came, low), high)
    if setpoint < least:
        setpoint, lasts = (least if setpoint > least / 2.0 else 0.0), 1
    state[h, 2] = max(lasts, 1)
    return float(setpoint)


@inner_kernel
def _slack(goal: float) -> float:
    return max(MIN_OUTFLOW_TOLERANCE_G_MIN, OUTFLOW_TOLERANCE_FRACTION * goal)


@inner_kernel
def _at(times: FloatArray, wanted: FloatArray, h: int, s: float) -> float:
    """The flow wanted of a hopper at a program time; before and after the knots that of the ends.
    """
    k = int(np.searchsorted(times, s, side="right"))
    if k == 0 or k == len(times):
        return float(wanted[min(k, len(times) - 1), h])
    share = (s - times[k - 1]) / (times[k] - times[k - 1])
    return float(wanted[k - 1, h] + share * (wanted[k, h] - wanted[k - 1, h]))


@inner_kernel
def _steady_s(
    times: FloatArray, wanted: FloatArray, h: int, at: float, state: FloatArray, leads: bool
) -> float:
    """How long the flow wanted stays what it is, where its set-point and outflow are near it."""
    k = np.searchsorted(times, at, side="right")
    goal = _at(times, wanted, h, at)
    if leads and max(abs(state[h, 0] - goal), abs(state[h, 1] - goal)) > _slack(goal):
        return 0.0
    steady = k
    while 0 < steady < len(times) and wanted[steady, h] == wanted[steady - 1, h]:
        steady += 1
    until = times[steady - 1] if steady > k else at
    return float(until - at) - CLOCK_MARGIN_S
