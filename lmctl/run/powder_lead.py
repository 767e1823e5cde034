"""What to send to the hoppers now, so that the nozzle delivers what the program wants later.

A hopper's flow reaches the nozzle after a dead time θ and through a first-order lag τ
(process.md 2.1). With w the flow wanted at the nozzle against program time s, run at rate r, the
law is u = r·(w(s + rθ) + rτ·w′(s + rθ)), within [0, u_max]. A set-point holds for one tick, so w
and w′ are taken as means over the tick it will hold for: the mass of a ramp shorter than a few
ticks then comes out right wherever the ticks fall in it. Where rapids or dwells lie ahead, their
program time does not run at r, so "rθ ahead" is asked of the clock, which knows the lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.run.job_window import JobWindow
from lmctl.run.program_clock import ProgramClock

FloatArray = NDArray[np.float64]

#: How often set-points are sent, and so how long each holds [s].
TICK_S = 0.1


@dataclass(frozen=True)
class Hose:
    """Dead time θ and lag τ of one hopper [s], and the most it delivers [g/s]."""

    dead_time_s: float
    lag_s: float
    limit_g_s: float

    @property
    def settling_s(self) -> float:
        """θ + 4τ: after that, a step has arrived to 98 % (process.md 2.2)."""
        return self.dead_time_s + 4.0 * self.lag_s


def lead(
    at_start_g_s: FloatArray, at_end_g_s: FloatArray, lag_s: FloatArray, limit_g_s: FloatArray,
    tick_s: float = TICK_S,
) -> FloatArray:
    """Set-points of all hoppers that make the nozzle follow the wanted flow over one tick.

    at_start_g_s, at_end_g_s : (n_hoppers,) flow r·w wanted at the nozzle, each hopper's dead time
        after the tick's start and end [g/s]
    lag_s, limit_g_s : (n_hoppers,) τ and u_max
    returns : (n_hoppers,) [g/s], each in [0, u_max]

    A steady ramp of 0.1 g/s² through a lag of 2 s asks for 0.2 g/s above the flow at mid-tick:

    >>> lead(np.array([1.0]), np.array([1.01]), np.array([2.0]), np.array([9.0]))
    array([1.205])
    """
    mean = 0.5 * (at_start_g_s + at_end_g_s)
    slope = (at_end_g_s - at_start_g_s) / tick_s
    setpoints: FloatArray = np.clip(mean + lag_s * slope, 0.0, limit_g_s)
    return setpoints


class PowderPlan:
    """Set-points for a job's hoppers, in the job's order, by its powder mode.

    mode : "lead" sends what `lead` says; "dwell" and "none" send the flow wanted now (for
        "dwell" the planner has put waiting times into the program)
    """

    def __init__(
        self, mode: str, hoses: Sequence[Hose], window: JobWindow, clock: ProgramClock
    ) -> None:
        self._leads = mode == "lead"
        self._dead_times_s = tuple(hose.dead_time_s for hose in hoses)
        self._lag_s = np.array([hose.lag_s for hose in hoses])
        self._limit_g_s = np.array([hose.limit_g_s for hose in hoses])
        self._window = window
        self._clock = clock
        self.settling_s = max(hose.settling_s for hose in hoses)
        #: How long before motion the set-points begin to follow the program.
        self.lead_s = max(self._dead_times_s) if self._leads else 0.0

    def setpoints_g_s(self, t: float) -> FloatArray:
        """What to send at t, (n_hoppers,) [g/s]."""
        if not self._leads:
            return np.minimum(self._wanted_g_s(self._clock.now(t)), self._limit_g_s)
        return lead(self._arriving(t, 0.0), self._arriving(t, TICK_S), self._lag_s,
                    self._limit_g_s)

    def _arriving(self, t: float, later_s: float) -> FloatArray:
        """The flow wanted at the nozzle when what is sent `later_s` after t comes out there."""
        return np.array([
            self._wanted_g_s(self._clock.ahead(t, later_s + dead_time_s))[hopper]
            for hopper, dead_time_s in enumerate(self._dead_times_s)
        ])

    def _wanted_g_s(self, s: float) -> FloatArray:
        """The flow the nozzle must deliver at program time s.

        It is scaled by the override as beam and speed are, so the mass laid per millimetre stays.
        """
        flow: FloatArray = self._window.flow_g_s(s) * self._clock.rate_at(s)
        return flow
