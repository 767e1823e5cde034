"""Where in program time the machine is: planned time driven by reported progress.

A status report gives the line that runs and the nozzle position on it; between reports time runs on
by the planned law times the feed override, and never past what the controller has acknowledged.
Pure: the caller passes the time (loop clock, seconds) with every call.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

from lmctl.run.interlocks.motion_rules import OFF_PATH_MM
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.position_match import nearest_time, time_where_expected

#: A place so much sooner or later on the path than expected is accepted when another report agrees
#: [s]. Planned and real motion differ by less from one report to the next; one changed digit does.
_JUMP_S = 0.2

#: So many reports in a row must agree on a place that is not expected: on the path, and off it.
_AGREE_ON_PATH, _AGREE_OFF_PATH = 2, 3

#: Places doubted in a row that are compared with the newest.
_UNEXPECTED_KEPT = 8

#: Distance allowed between two reports that agree: the travel at the reported speed in so much more
#: time [s], and a rounding [mm].
_AGREE_S, _AGREE_MM = 0.02, 0.05


def _ignore() -> None:
    """Default callback: does nothing."""


@dataclass(frozen=True)
class OverrideChange:
    """The feed override goes from `before` to `after` at program time from_s.

    Powder goes from one to the other evenly by to_s: the beam is off in between.
    """

    from_s: float
    to_s: float
    before: float
    after: float


class _UnexpectedReport(NamedTuple):
    """A place that was not expected."""

    t: float
    position_mm: tuple[float, ...]
    speed_mm_s: float


class ProgramClock:
    """Program time of one run.

    rate : feed override now (1 = as planned)
    reported_s : program time of the last place reported on the path, nothing added for what came
        after
    reported_t : machine time of that report, -inf before the first
    off_mm : distance of the last accepted place from the path of the lines that may be running
    early_s : by how much that place was reached sooner than expected; below 0 where later
    is_in_doubt : the last place reported is not the expected one, and too few others agree yet; it
        counts for nothing so far
    turned : called when anything but the passing of time changes the motion ahead
    The clock is stopped until `run_from`, and again after `stop_at`.
    """

    def __init__(self, window: JobWindow) -> None:
        self.rate = 1.0
        self.turned: Callable[[], None] = _ignore
        self._window = window
        first = window.first_layer()
        self._acknowledged = first.first_line
        self._change: OverrideChange | None = None
        self._known_t = 0.0
        self._known_s = float(first.start_s[0])
        self.reported_s = self._known_s
        self.reported_t = -math.inf
        self.off_mm = self.early_s = 0.0
        self.is_in_doubt = False
        self._unexpected: list[_UnexpectedReport] = []  # since the last place that was expected
        self._limit_s = self._known_s  # program time at the end of the lines acknowledged
        self._runs_from_t = math.inf

    def acknowledge(self, lines: int) -> None:
        """The controller has acknowledged so many lines; time never runs past their end.

        But a dwell is acknowledged when it is over: time runs through one that is next.
        """
        if lines != self._acknowledged:
            self._acknowledged = lines
            self._limit_s = self._window.next_motion_start_s(lines)

    def start_at(self, t: float) -> None:
        """Motion starts, or is to start, at machine time t."""
        self._known_t = self._runs_from_t = t
        self.turned()

    def stop_at(self, t: float) -> None:
        """Motion stops at t; until a report corrects it, program time is what it is by then."""
        self._known_s = self.program_time_s(t)
        self._known_t = t
        self._runs_from_t = math.inf
        self.turned()

    def set_override(self, t: float, rate: float) -> None:
        """The feed override is `rate` from t on."""
        if rate != self.rate:
            self._known_s = self.program_time_s(t)
            self._known_t = t
            self.rate = rate
            if self._change is not None and self._known_s < self._change.from_s:
                self._change = replace(self._change, before=rate)  # turned at the machine's panel
            self.turned()

    def schedule_override(self, from_s: float, to_s: float, rate: float) -> None:
        """The feed override will be set to `rate` when program time is from_s.

        `set_override` then confirms that it has been set; until then it is due.
        """
        self._change = OverrideChange(from_s, to_s, self.rate, rate)
        self.turned()

    def cancel_scheduled_override(self) -> None:
        """No other override is planned any more."""
        if self._change is not None:
            self._change = None
            self.turned()

    def is_override_pending_before(self, s: float) -> bool:
        """Whether a planned override is still to be set, at a program time before s."""
        change = self._change
        return change is not None and self.rate != change.after and change.from_s < s

    @property
    def is_override_pending(self) -> bool:
        """Whether a planned override is still to come, or powder still following it."""
        return self._change is not None

    def due_override(self, t: float) -> float | None:
        """The planned override if it is time to set it, else None."""
        change = self._change
        due = change is not None and self.rate != change.after and self.program_time_s(
            t) >= change.from_s
        return change.after if change is not None and due else None

    def override_due_in_s(self, t: float) -> float:
        """Machine time from t until the planned override is to be set; 0 where it is, or none."""
        change, s = self._change, self.program_time_s(t)
        if change is None or s >= change.from_s:
            return 0.0
        window = self._window
        return window.machine_time_s(change.from_s, self.rate) - window.machine_time_s(s, self.rate)

    def override_at(self, s: float) -> float:
        """The feed override there will be at program time s, as powder is to follow it."""
        change = self._change
        if change is None:
            return self.rate
        share = (s - change.from_s) / (change.to_s - change.from_s)
        return change.before + min(max(share, 0.0), 1.0) * (change.after - change.before)

    def on_report(
        self, t: float, executed: int, position_mm: tuple[float, ...],
        speed_mm_s: float = math.inf,
    ) -> None:
        """A status report: lines executed so far, and where the nozzle was, at t.

        position_mm : program coordinates x, y, z
        speed_mm_s : as reported, inf where that is not known
        """
        expected_s = self.program_time_s(t)
        change = self._change
        if change is not None and expected_s > change.to_s and self.rate == change.after:
            self._change = None
        off_mm = 0.0
        if executed >= self._window.n_lines:
            found_s = expected_s = self._window.end_s
        elif (as_expected_s := time_where_expected(
            self._window, position_mm, expected_s
        )) is not None:
            found_s = as_expected_s
        else:
            found_s, off_mm = nearest_time(
                self._window, executed, self._acknowledged, position_mm, expected_s)
        if off_mm <= OFF_PATH_MM and abs(found_s - expected_s) <= _JUMP_S:
            self._unexpected.clear()
            self.is_in_doubt = False
        else:
            agreeing = self._agreeing(_UnexpectedReport(t, position_mm, speed_mm_s))
            needed = _AGREE_ON_PATH if off_mm <= OFF_PATH_MM else _AGREE_OFF_PATH
            self.is_in_doubt = agreeing < needed
            if self.is_in_doubt:
                return
        self._known_s, self.off_mm, self.early_s = found_s, off_mm, found_s - expected_s
        if off_mm <= OFF_PATH_MM:
            self.reported_s, self.reported_t = found_s, t
        self._known_t = t

    def _agreeing(self, place: _UnexpectedReport) -> int:
        """How many of the places doubted in a row agree with the newest, itself included."""
        agreeing = 1 + sum(
            math.dist(one.position_mm[:3], place.position_mm[:3])
            <= max(one.speed_mm_s, place.speed_mm_s) * (place.t - one.t + _AGREE_S) + _AGREE_MM
            for one in self._unexpected
        )
        self._unexpected = [*self._unexpected[-_UNEXPECTED_KEPT:], place]
        return agreeing

    def program_time_s(self, t: float) -> float:
        """Program time at t [s]; t must not lie before the last call that set something."""
        running_s = t - max(self._known_t, self._runs_from_t)
        if running_s <= 0.0:
            return self._known_s
        reached_s = self._window.advance(self._known_s, running_s, self.rate)
        return max(self._known_s, min(reached_s, self._limit_s))

    def if_not_stopped(self, t: float) -> float:
        """Program time at t if motion has gone on since the last report, acknowledged or not."""
        running_s = max(0.0, t - max(self._known_t, self._runs_from_t))
        return self._window.advance(self._known_s, running_s, self.rate)

    def program_time_ahead_s(self, t: float, machine_s: float) -> float:
        """Program time reached `machine_s` after t, if nothing changes."""
        s, running_s = self.program_time_s(t), t + machine_s - max(t, self._runs_from_t)
        reached_s = self._window.advance(s, running_s, self.rate)
        change = self._change
        if change is None or not s < change.from_s < reached_s:
            return reached_s
        before_s = self.override_due_in_s(t)
        return self._window.advance(change.from_s, running_s - before_s, change.after)
