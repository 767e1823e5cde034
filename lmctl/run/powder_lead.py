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

from lmctl.run.job_window import JobWindow
from lmctl.run.program_clock import ProgramClock

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
    before_g_s: float, after_g_s: float, lag_s: float, limit_g_s: float, tick_s: float = TICK_S
) -> float:
    """Set-point of a hopper that makes the nozzle follow the wanted flow over one tick [g/s].

    before_g_s, after_g_s : flow r·w wanted at the nozzle one dead time after the tick's start
        and end
    lag_s, limit_g_s : τ and u_max
    returns : in [0, u_max]

    A steady ramp of 0.1 g/s² through a lag of 2 s asks for 0.2 g/s above the flow at mid-tick:

    >>> round(lead(1.0, 1.01, 2.0, 9.0), 6)
    1.205
    """
    mean = 0.5 * (before_g_s + after_g_s)
    slope = (after_g_s - before_g_s) / tick_s
    return min(max(mean + lag_s * slope, 0.0), limit_g_s)


class PowderPlan:
    """Set-points for a job's hoppers, in the job's order, by its powder mode.

    mode : "lead" sends what `lead` says; "dwell" and "none" send the flow wanted now (for
        "dwell" the planner has put waiting times into the program)
    """

    def __init__(
        self, mode: str, hoses: Sequence[Hose], window: JobWindow, clock: ProgramClock
    ) -> None:
        self._leads = mode == "lead"
        self._hoses = tuple(hoses)
        self._window = window
        self._clock = clock
        self._reached: list[float] | None = None
        self.settling_s = max(hose.settling_s for hose in hoses)
        #: How long before motion the set-points begin to follow the program.
        self.lead_s = max(hose.dead_time_s for hose in hoses) if self._leads else 0.0

    def start(self) -> None:
        """The next set-points are the first: nothing led lies behind them."""
        self._reached = None

    def setpoints_g_s(self, t: float) -> list[float]:
        """What to send at t, of each hopper [g/s]; to be asked for once a tick."""
        if not self._leads:
            s = self._clock.now(t)
            return [
                min(self._wanted_g_s(hopper, s), hose.limit_g_s)
                for hopper, hose in enumerate(self._hoses)
            ]
        # A tick goes on from where the one before ended, whatever a report has since corrected:
        # so the changes of a ramp add up to the whole ramp.
        before = self._arriving(t, 0.0) if self._reached is None else self._reached
        after = self._reached = self._arriving(t, TICK_S)
        return [
            lead(before[hopper], after[hopper], hose.lag_s, hose.limit_g_s)
            for hopper, hose in enumerate(self._hoses)
        ]

    def _arriving(self, t: float, later_s: float) -> list[float]:
        """The flow wanted at the nozzle when what is sent `later_s` after t comes out there."""
        return [
            self._wanted_g_s(hopper, self._clock.ahead(t, later_s + hose.dead_time_s))
            for hopper, hose in enumerate(self._hoses)
        ]

    def _wanted_g_s(self, hopper: int, s: float) -> float:
        """The flow the nozzle must deliver at program time s.

        It is scaled by the override as beam and speed are, so the mass laid per millimetre stays.
        """
        return self._window.flow_g_s(hopper, s) * self._clock.rate_at(s)
