"""What to send to the hoppers now, so that the nozzle delivers what the program wants later.

A hopper's flow reaches the nozzle after a dead time θ and through a first-order lag τ
(docs/explanation/powder-delivery.md, Transport delay and lag). With w the flow wanted at the
nozzle against program time s, run at rate r, the
law is u = r·(w(s + rθ) + rτ·w′(s + rθ)), within [0, u_max].

No set-point leaves [0, u_max], the feeder's resolution, or what lies between nothing and its least
steady flow, and each is a telegram. So the law is taken in its exact form for held set-points: the
one that brings the modelled outflow of the lag from where the last set-points have brought it to
r·w at the end of the hold. A set-point is held for as long as the outflow stays within a slack far
below what a composition shows; a new one is chosen to last as long as it can. For short holds that
is the law above, and whatever limits, rounding or a corrected clock have left undone is made good
by the next set-point.

Where rapids or dwells lie ahead, their program time does not run at r, so "rθ ahead" is asked of
the clock, which knows the lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from lmctl.preflight.setpoint_rules import (
    CHOSEN_WITHIN,
    CLOCK_MARGIN_S,
    FLOW_DECIMALS,
    MAX_HOLD_TICKS,
    MIN_OUTFLOW_TOLERANCE_G_MIN,
    OUTFLOW_TOLERANCE_FRACTION,
    SETPOINT_PERIOD_S,
)
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.program_clock import ProgramClock


@dataclass(frozen=True)
class HoseDynamics:
    """Dead time θ and lag τ of one hopper [s], the least and most it delivers [g/min].

    Below `least_g_min` (and above nothing) its disc does not turn steadily, or not at all.
    """

    dead_time_s: float
    lag_s: float
    max_g_min: float
    min_g_min: float = 0.0

    @property
    def settling_s(self) -> float:
        """θ + 4τ: after that, a step has arrived to 98 %.

        Source: docs/explanation/powder-delivery.md, Transport delay and lag.
        """
        return self.dead_time_s + 4.0 * self.lag_s


def remaining_fraction(lag_s: float, tick_s: float = SETPOINT_PERIOD_S) -> float:
    """Share of a change that has not come through a lag after one tick: exp(-tick/τ)."""
    return math.exp(-tick_s / lag_s) if lag_s > 0.0 else 0.0


def outflow_tolerance_g_min(wanted: float) -> float:
    """How far an outflow may be from `wanted` [g/min]."""
    return max(MIN_OUTFLOW_TOLERANCE_G_MIN, OUTFLOW_TOLERANCE_FRACTION * wanted)


def lead_setpoint(
    outflow: float, wanted: Iterable[float], lag_s: float, limit: float,
    tick_s: float = SETPOINT_PERIOD_S,
    least: float = 0.0,
) -> tuple[float, int]:
    """Set-point that keeps a lag's outflow at what is wanted for as many ticks as one can.

    outflow : of the lag now [g/min]
    wanted : outflow wanted at the end of each coming tick; read only as far as the set-point lasts
    limit, least : the most and the least a hopper delivers [g/min]
    returns : 0 or within [least, limit]: what keeps the outflow within `slack_g_min` of `wanted`
        for most ticks and then meets it as nearly as it can, and for how many that is; else what
        meets it after one tick

    On a steady ramp of 0.1 a second a lag of 2 s takes 0.2 more than the flow at mid-hold:

    >>> setpoint, ticks = lead(1.0, [1.01], 2.0, 9.0)
    >>> round(setpoint, 3), ticks
    (1.205, 1)
    """
    rest = remaining_fraction(lag_s, tick_s)
    least_yet, most_yet, left = 0.0, limit, 1.0
    setpoint, lasts = 0.0, 0
    for goal in wanted:
        left *= rest
        slack = CHOSEN_WITHIN * outflow_tolerance_g_min(goal)
        came, from_before = 1.0 - left, outflow * left
        lowest = max(least_yet, (goal - slack - from_before) / came)
        highest = min(most_yet, (goal + slack - from_before) / came)
        if lowest > highest:
            if lasts == 0:  # not even one tick: as near as the hopper can
                setpoint = min(max((goal - from_before) / came, 0.0), limit)
            break
        least_yet, most_yet, lasts = lowest, highest, lasts + 1
        setpoint = min(max((goal - from_before) / came, lowest), highest)
    if setpoint < least:
        return (least if setpoint > least / 2.0 else 0.0), 1
    return setpoint, max(lasts, 1)


class PowderPlan:
    """Set-points for a job's hoppers, in the job's order, by its powder mode.

    mode : "lead" sends what `lead` says; "dwell" and "none" send the flow wanted now (for
        "dwell" the planner has put waiting times into the program)
    volume_factor : on the flows of the job
    """

    def __init__(
        self, mode: str, hoses: Sequence[HoseDynamics], window: JobWindow, clock: ProgramClock,
        volume_factor: float = 1.0,
    ) -> None:
        self._volume_factor = volume_factor
        self._leads = mode == "lead"
        self._window = window
        self._clock = clock
        self._outflow: list[float] | None = None
        self._setpoints: list[float] = []
        self._lasts = [1] * len(hoses)  # ticks for which each set-point was chosen
        self.set_hoses(hoses)

    def set_hoses(self, hoses: Sequence[HoseDynamics]) -> None:
        """Lead powder by these from now on; called before `start`."""
        self._hoses = tuple(hoses)
        self._rests = [remaining_fraction(hose.lag_s) for hose in hoses]
        self.settling_s = max(hose.settling_s for hose in hoses)
        #: How long before motion the set-points begin to follow the program.
        self.lead_s = max(hose.dead_time_s for hose in hoses) if self._leads else 0.0

    def start(self) -> None:
        """The next set-points are the first: the hoses will settle at them."""
        self._outflow = None
        self._lasts = [1] * len(self._hoses)

    def setpoints_g_min(self, t: float, ticks: int = 1) -> list[float]:
        """What to send at t, of each hopper. ticks : since this was last asked."""
        self._setpoints = self._with_lead(t, ticks) if self._leads else self._without_lead(t)
        return self._setpoints

    def _without_lead(self, t: float) -> list[float]:
        s = self._clock.program_time_s(t)
        return [
            round(min(self._wanted_g_min(hopper, s), hose.max_g_min), FLOW_DECIMALS)
            for hopper, hose in enumerate(self._hoses)
        ]

    def _with_lead(self, t: float, ticks: int) -> list[float]:
        if self._outflow is None:
            self._outflow = [self._arriving(hopper, t, 0.0) for hopper in range(len(self._hoses))]
            self._setpoints = list(self._outflow)
        setpoints = []
        for hopper, (hose, rest) in enumerate(zip(self._hoses, self._rests, strict=True)):
            held, outflow = self._setpoints[hopper], self._outflow[hopper]
            outflow = held + (outflow - held) * rest**ticks
            wanted = self._arriving(hopper, t, SETPOINT_PERIOD_S)
            self._lasts[hopper] = max(self._lasts[hopper] - ticks, 1)
            if abs(held + (outflow - held) * rest - wanted) > outflow_tolerance_g_min(wanted):
                held, self._lasts[hopper] = lead_setpoint(
                    outflow, self._coming(hopper, t), hose.lag_s, hose.max_g_min,
                    least=hose.min_g_min)
            held = round(held, FLOW_DECIMALS)
            setpoints.append(held)
            self._outflow[hopper] = outflow
        return setpoints

    def valid_for_s(self, t: float) -> float:
        """How long from t the set-points just found surely do, unless the clock turns."""
        return min(
            max(self._lasts[hopper] * SETPOINT_PERIOD_S, self._steady_s(hopper, t))
            for hopper in range(len(self._hoses))
        )

    def _steady_s(self, hopper: int, t: float) -> float:
        """How long the flow wanted of a hopper stays what it is, where its set-point, to which its
        outflow tends, is near it."""
        if self._clock.is_override_pending:
            return 0.0
        at_s = self._clock.program_time_ahead_s(
            t, self._hoses[hopper].dead_time_s if self._leads else 0.0)
        if self._outflow is not None:
            wanted = self._wanted_g_min(hopper, at_s)
            off = max(abs(self._outflow[hopper] - wanted), abs(self._setpoints[hopper] - wanted))
            if off > outflow_tolerance_g_min(wanted):
                return 0.0
        until_s = self._window.flow_steady_until_s(hopper, at_s)
        return (until_s - at_s) / max(self._clock.rate, 1.0) - CLOCK_MARGIN_S

    def _coming(self, hopper: int, t: float) -> Iterator[float]:
        """What is wanted of a hopper at the end of each coming tick."""
        return (self._arriving(hopper, t, n * SETPOINT_PERIOD_S)
                for n in range(1, MAX_HOLD_TICKS + 1))

    def _arriving(self, hopper: int, t: float, later_s: float) -> float:
        """The flow wanted at the nozzle when what is sent `later_s` after t comes out there."""
        dead_time_s = self._hoses[hopper].dead_time_s
        return self._wanted_g_min(hopper,
                                  self._clock.program_time_ahead_s(t, later_s + dead_time_s))

    def _wanted_g_min(self, hopper: int, s: float) -> float:
        """The flow the nozzle must deliver at program time s.

        The override scales it like beam and speed, so the deposited mass per millimetre stays.
        """
        return (self._window.flow_g_s(hopper, s) * 60.0 * self._clock.override_at(s)
                * self._volume_factor)
