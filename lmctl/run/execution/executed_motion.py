"""What the machine has executed, from the places, speeds and powers that its controller reports.

A report gives the nozzle position on the program's lines. What lies between two reported places has
been executed, its length is known to the micrometre, and it took the time between the reports. How
that time divides over lines with the beam on and others is taken from the plan of those few lines.
Beam energy is the energy per millimetre reported (power over speed) times that length. Where no
report shows a power, or reports failed for a while, the figures are named inferred.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.status import StatusReport
from lmctl.run.execution.layer_accounts import LayerAccounts
from lmctl.run.journal.figures import ExecutionFigures
from lmctl.run.powder.fed import FedPowder
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.layer_program import LayerProgram
from lmctl.run.program.place import ProgramPlace
from lmctl.run.program.reported_power import reported_energy_ratio

#: Reports further apart than this leave what lies between them inferred [s].
_REPORTED_WITHIN_S = 1.0

#: So near to the end of the program it is at its end: places are rounded [s].
_END_S = 0.01

#: Braking to a stop takes at most twice the time that the same way takes at speed, and not more
#: than this longer: 10 mm/s at 500 mm/s² [s].
_BRAKING_S = 0.01

#: A place within this of the one before has not moved [mm].
_SAME_MM = 0.002


@dataclass(frozen=True)
class _Span:
    """A stretch of motion: program times, and the machine times at which they were reached."""

    begin_s: float
    end_s: float
    begin_t: float
    end_t: float

    def time_at(self, s: float, window: JobWindow, rate: float) -> float:
        """Machine time at a program time in it."""
        planned_s = (window.machine_time_s(self.end_s, rate)
                     - window.machine_time_s(self.begin_s, rate))
        if planned_s <= 0.0:
            return self.end_t
        passed = window.machine_time_s(s, rate) - window.machine_time_s(self.begin_s, rate)
        return self.begin_t + (self.end_t - self.begin_t) * passed / planned_s


class ExecutedMotion:
    """Integrates the reports made between the start of motion and the next hold.

    lead_s : feed and power reported are those of motion prepared, up to so much ahead
    Times t are the loop's [s], times s are the program's.
    """

    def __init__(
        self, window: JobWindow, fed: FedPowder, accounts: LayerAccounts, lead_s: float
    ) -> None:
        self._window = window
        self._fed = fed
        self._accounts = accounts
        self._lead_s = lead_s
        self._layer: LayerProgram = window.first_layer()
        self._t = self._end_t = 0.0
        self._s = float(self._layer.start_s[0])
        self._position_mm: tuple[float, ...] = ()
        self._ratio: float | None = None  # of the last report
        self._last_ratio = 1.0
        self._has_moved = self._is_over = False
        self._beam_off_s = float("inf")

    @property
    def layer(self) -> int:
        """The layer that runs."""
        return self._layer.index

    @property
    def first_line_needed(self) -> int:
        """The first line of the layer that is counted: no earlier line is read again."""
        return self._layer.first_line

    def on_motion_start(self, t: float) -> None:
        """The first lines are sent at t."""
        self._t = self._end_t = t
        self._accounts.open_layer(self._layer.index)

    def on_beam_off(self, s: float) -> None:
        """The laser was disabled at program time s: what moves on has no beam."""
        self._beam_off_s = min(self._beam_off_s, s)

    def on_report(
        self, t: float, s: float, report: StatusReport, position_mm: tuple[float, ...], *,
        off_mm: float, rate: float, overrides: tuple[int, int, int],
    ) -> None:
        """A status report. s : program time of its place; off_mm : how far off the path that is."""
        if self._is_over:
            return
        ratio = reported_energy_ratio(self._window, report, s, rate, overrides[2], self._lead_s)
        if s > self._s:
            at_rest = _is_at_rest(report) or s >= self._window.end_s - _END_S
            self._moved(t, s, rate, ratio, at_rest=at_rest)
        elif self._has_moved and self._has_stopped(position_mm):
            if not _is_at_rest(report) and s < self._window.end_s - _END_S:
                self._add(_Span(self._s, self._s, self._t, t), rate, 1.0, inferred=False)
            self._t = t
        elif not self._has_moved:
            self._t = t
        self._ratio = ratio
        self._last_ratio = self._last_ratio if ratio is None else ratio
        self._position_mm = position_mm
        self._accounts.on_report(self._layer.index, off_mm, overrides)

    def on_lines_executed(self, t: float, lines: int, rate: float) -> None:
        """So many lines of the job are known to be executed: layers that they end are over."""
        if lines < self._window.n_lines:
            self._accounts.close_before(self._layer.index, lines)
            return
        if self._s < self._window.end_s:
            self._moved(t, self._window.end_s, rate, None, at_rest=True)
        self.on_motion_end()
        self._accounts.close_all(self.reached_place, self.remaining_bead_mm)

    def on_motion_end(self) -> None:
        """Motion has ended, here or at a hold: what is reported later is not counted."""
        self._is_over = True
        self._accounts.leave_layer(self._layer.index, self._fed.weight_g(self._end_t))

    @property
    def remaining_bead_mm(self) -> float:
        """Beam-on path of this layer that is left to run."""
        planned = self._layer.planned
        return planned.all_lines.path_mm - planned.up_to_program_time(self._s).path_mm

    @property
    def reached_place(self) -> ProgramPlace:
        """The place up to which motion is counted."""
        window, s = self._window, self._s
        line = window.line_at_program_time(s)
        start_s, end_s = window.line_start_s(line), window.line_start_s(line + 1)
        share = (s - start_s) / (end_s - start_s) if end_s > start_s else 0.0
        return ProgramPlace(line, min(max(share, 0.0), 1.0))

    def _has_stopped(self, position_mm: tuple[float, ...]) -> bool:
        return len(position_mm) == len(self._position_mm) and all(
            abs(now - before) < _SAME_MM
            for now, before in zip(position_mm, self._position_mm, strict=True)
        )

    def _moved(
        self, t: float, s: float, rate: float, ratio: float | None, *, at_rest: bool
    ) -> None:
        """Motion has come from the last place counted to s."""
        begin_t, end_t = self._t, t
        by_plan = self._window.machine_time_s(s, rate) - self._window.machine_time_s(self._s, rate)
        if not self._has_moved:
            begin_t = max(begin_t, t - by_plan)  # it was at rest until then
        elif at_rest:
            # It has been at rest since.
            end_t = min(end_t, begin_t + by_plan + min(by_plan, _BRAKING_S))
        known = [one for one in (self._ratio, ratio) if one is not None]
        mean = sum(known) / len(known) if known else self._last_ratio
        inferred = not known or t - self._t > _REPORTED_WITHIN_S
        self._has_moved = True
        self._add(_Span(self._s, s, begin_t, end_t), rate, mean, inferred=inferred)
        self._t, self._s = t, s

    def _add(self, span: _Span, rate: float, ratio: float, *, inferred: bool) -> None:
        """Count a span, layer by layer."""
        last = len(self._window.manifest.layers) - 1
        begin_s, begin_t = span.begin_s, span.begin_t
        while span.end_s > self._layer.ends_s[-1] and self._layer.index < last:
            border_s = self._layer.ends_s[-1]
            border_t = span.time_at(border_s, self._window, rate)
            self._count(_Span(begin_s, border_s, begin_t, border_t), rate, ratio, inferred)
            self._accounts.leave_layer(self._layer.index, self._fed.weight_g(border_t))
            self._layer = self._window.layer_program(self._layer.index + 1)
            self._accounts.open_layer(self._layer.index)
            begin_s, begin_t = border_s, border_t
        self._count(_Span(begin_s, span.end_s, begin_t, span.end_t), rate, ratio, inferred)

    def _count(self, span: _Span, rate: float, ratio: float, inferred: bool) -> None:
        """Count a span within the layer that runs."""
        totals = self._layer.totals
        before = totals.up_to_program_time(min(span.begin_s, self._beam_off_s))
        after = totals.up_to_program_time(min(span.end_s, self._beam_off_s))
        by_plan = (
            self._window.machine_time_s(span.end_s,
                                        rate) - self._window.machine_time_s(span.begin_s, rate))
        lasted_s = span.end_t - span.begin_t
        pace = lasted_s / by_plan if by_plan > 0.0 else 0.0
        self._end_t = span.end_t
        powder_s = max(span.begin_s, self._layer.planned.beam_from_s)
        powder_t = span.end_t
        if powder_s < span.end_s or span.begin_s == span.end_s > powder_s:
            powder_t = span.time_at(powder_s, self._window, rate)
            if not self._accounts.is_weighed(self._layer.index):
                self._accounts.start_weighing(self._layer.index, self._fed.weight_g(powder_t))
        self._accounts.add_figures(self._layer.index, ExecutionFigures(
            after.path_mm - before.path_mm, (after.beam_s - before.beam_s) / rate * pace,
            (after.energy_J - before.energy_J) * ratio, lasted_s,
            self._fed.take_fed_g(powder_t, span.end_t),
        ), inferred=inferred)


def _is_at_rest(report: StatusReport) -> bool:
    """Whether motion has been ended: a dwell of the program, or a wait for lines, is no end."""
    return report.is_held or report.state in ("Alarm", "Sleep")
