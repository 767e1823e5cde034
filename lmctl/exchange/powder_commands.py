"""Set-points of hoppers along a program, with the lead of their hoses already applied."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobHopper
from lmctl.preflight.setpoint_rules import SETPOINT_PERIOD_S
from lmctl.run.powder.lead import lead_setpoint, outflow_tolerance_g_min

#: Ticks that a new set-point looks ahead.
_AHEAD = 16
_DECIMALS = 2


class FlowAhead:
    """The flow that a job wants at the nozzle, some layers at a time [g/min].

    Before the first knot it is the first flow, behind the last one the last.
    """

    def __init__(self) -> None:
        self._times_s = np.empty(0)
        self._flows = np.empty((0, 0))

    def add(self, times_s: FloatArray, flow_g_s: FloatArray) -> None:
        """The knots of the next layer. flow_g_s : (k, hoppers)"""
        flows = 60.0 * flow_g_s
        if len(self._times_s):
            times_s, flows = times_s[1:], flows[1:]
            flows = np.concatenate([self._flows, flows])
            times_s = np.concatenate([self._times_s, times_s])
        self._times_s, self._flows = times_s, flows

    def forget_before(self, s: float) -> None:
        """Knots that no time from s on needs."""
        keep = max(0, int(np.searchsorted(self._times_s, s, side="right")) - 1)
        self._times_s, self._flows = self._times_s[keep:], self._flows[keep:]

    def at(self, s: float, hopper: int) -> float:
        """Flow wanted at a program time."""
        return float(np.interp(s, self._times_s, self._flows[:, hopper]))


class LeadingSetpoints:
    """One hopper's set-points: held as long as the outflow stays where it is wanted.

    The modelled outflow of the lag is brought to what is wanted a dead time later, as running does.
    leads : powder mode "lead"; else the flow wanted now is sent
    """

    def __init__(self, hopper: JobHopper, index: int, flow: FlowAhead, *, leads: bool) -> None:
        self._flow = flow
        self._index = index
        self._leads = leads
        self._dead_time_s = hopper.dead_time_s if leads else 0.0
        self._lag_s = hopper.lag_s if leads else 0.0
        self._limit = hopper.max_flow_g_min
        self._outflow = flow.at(0.0, index)
        self.setpoint_g_min = round(self._outflow, _DECIMALS)

    def advance(self, begin_s: float, end_s: float) -> bool:
        """Go on to the stretch from begin to end; whether the set-point changes at its begin."""
        if not self._leads:
            return self._set(self._flow.at(begin_s, self._index))
        wanted = self._flow.at(end_s + self._dead_time_s, self._index)
        held = self._after(self.setpoint_g_min, end_s - begin_s)
        changed = False
        if abs(held - wanted) > outflow_tolerance_g_min(wanted):
            chosen, _ = lead_setpoint(
                self._outflow, self._coming(begin_s), self._lag_s, self._limit)
            changed = self._set(chosen)
            held = self._after(self.setpoint_g_min, end_s - begin_s)
        self._outflow = held
        return changed

    def _set(self, flow_g_min: float) -> bool:
        before, self.setpoint_g_min = self.setpoint_g_min, round(flow_g_min, _DECIMALS)
        return before != self.setpoint_g_min

    def _coming(self, s: float) -> Iterator[float]:
        for tick in range(1, _AHEAD + 1):
            yield self._flow.at(s + self._dead_time_s + tick * SETPOINT_PERIOD_S, self._index)

    def _after(self, setpoint: float, lasting_s: float) -> float:
        if self._lag_s <= 0.0:
            return setpoint
        return setpoint + (self._outflow - setpoint) * math.exp(-lasting_s / self._lag_s)
