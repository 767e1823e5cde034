"""Deposition: sends lines to the controller as the machine progresses, and journals it.

Driven by the motion driver: a report shows how far the machine is and so which lines may be sent;
they go out with the next status query. Between reports it does nothing.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace

from firmware_protocol.status import StatusReport
from lmctl.config.machine import MotionSettings
from lmctl.run.cell.devices import Cell
from lmctl.run.execution.deposition_end import beam_off_s, deposition_end, is_at_rest, place_at
from lmctl.run.execution.executed_motion import ExecutedMotion
from lmctl.run.execution.layer_accounts import LayerAccounts
from lmctl.run.interlocks.inputs import ProgramDeviation
from lmctl.run.interlocks.motion_rules import OFF_PATH_MM
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.setpoint_sender import SetpointSender
from lmctl.run.program.feed_override import FeedOverride
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.line_energy import LineEnergyCheck
from lmctl.run.program.line_releaser import LineReleaser
from lmctl.run.program.place import NOTHING_REACHED, PlaceReached, ProgramPlace
from lmctl.run.program.program_clock import ProgramClock
from lmctl.run.program.reentry import Reentry
from lmctl.run.program.remaining_time import RemainingTime

#: Lines wait for the next query only where the horizon holds so many status periods: one passes
#: before they are sent, another before the next are sent, and motion must see its end in time.
_PERIODS_AHEAD = 4

#: (program time done, program time in all, layer, remaining machine time) [s]
Progress = Callable[[float, float, int, float], None]


class Deposition:
    """One job on one cell, from where it is entered to its last line or to the next hold.

    motion : the machine's limits and its link
    entry : how it is entered, None at its first line; reached : what has been executed before
    accounts : of the layers; executed motion is added to them
    started : whether a line of the job has been sent
    stop_before : a line that is not sent, and what is called when all before it is executed
    done : called once, when the last line has been executed
    failed : called with what goes wrong in a report
    """

    def __init__(
        self, cell: Cell, window: JobWindow, clock: ProgramClock, feed: SetpointSender,
        recorder: RunRecorder, accounts: LayerAccounts, motion: MotionSettings, *,
        entry: Reentry | None = None, reached: PlaceReached = NOTHING_REACHED,
        stop_before: tuple[int, Callable[[], None]] | None = None,
        done: Callable[[], None], failed: Callable[[Exception], None], progress: Progress | None,
    ) -> None:
        self.started = False
        self._first_line = window.first_layer().first_line
        self._beam_on_line = 0 if entry is None else entry.beam_on_line
        self._reached = reached
        self._beam_off_s = math.inf
        self._sent = self._first_line - 1  # the last line that may have been sent
        self._cell = cell
        self._window = window
        self._clock = clock
        self._feed = feed
        self._recorder = recorder
        lead_s = cell.motion.identity.dialect.segment_buffer_s
        self._energy = LineEnergyCheck(window, lead_s)
        self._accounts = accounts
        self._entry = entry
        self._motion = ExecutedMotion(window, feed.fed, accounts, lead_s)
        self._streamer = LineReleaser(window, motion.send_horizon_s)
        if stop_before is not None:
            self._streamer.end_before_line(*stop_before)
        self._override = FeedOverride(
            clock, window, lambda: feed.plan.lead_s, motion.status_period_s,
            cell.motion.send_realtime)
        self._done = done
        self._failed = failed
        self._progress = progress
        self._remaining_time = RemainingTime(window.end_s)
        self._loop = asyncio.get_running_loop()
        self._streaming = self._tracking = False
        self._next_lines: list[bytes] = []  # journaled, to go with the next question
        self._may_wait = _PERIODS_AHEAD * motion.status_period_s <= motion.send_horizon_s
        self._seen = self._first_line  # lines executed when last looked at
        self._percent = (100, 100)  # feed and power, as last journaled

    @property
    def lines_executed(self) -> int:
        """Lines of the job known to be executed."""
        return max(self._reached.at_least.line, self._counted)

    @property
    def _counted(self) -> int:
        """The same, but lines to be run again count only once they have been run again."""
        return self._first_line + (self._cell.motion.lines_executed if self.started else 0)

    @property
    def designed_fractions(self) -> dict[str, float] | None:
        """Volume fractions that the part file has at the line under way; None where unknown."""
        return self._window.designed_fractions(self.lines_executed) if self.started else None

    @property
    def lines_sent(self) -> int:
        """Lines of the job, from its first, that may have been sent."""
        return self._sent + 1

    @property
    def reached(self) -> PlaceReached:
        """How far the job had been executed when motion was last stopped."""
        return self._reached

    @property
    def place_text(self) -> str:
        """Where in the job the run is, for people."""
        if self.lines_executed >= self._window.n_lines:
            return "the end of the program"
        return f"layer {self._motion.layer + 1}, program line {self.lines_executed}"

    @property
    def is_in_progress(self) -> bool:
        """Whether lines of the program are being sent and executed, its own waits included."""
        return self._streaming

    @property
    def is_motion_expected(self) -> bool:
        """Whether the program is under way, and not in a wait of its own."""
        if not self._streaming or self.lines_executed >= self._window.n_lines:
            return False
        start_mm, end_mm, _, _ = self._window.line_span_at_program_time(
            self._clock.program_time_s(self._loop.time()))
        return start_mm != end_mm

    @property
    def program_deviation(self) -> ProgramDeviation:
        """How the last report differs from the program; not at all once motion is at rest."""
        if not self._tracking:
            return ProgramDeviation()
        return ProgramDeviation(
            self._clock.off_mm, self._clock.early_s, self._energy.uncommanded_output)

    def job_line(self, tag: int) -> int:
        """The job's number of a line of the stream."""
        return self._first_line + tag

    def start(self) -> None:
        """Send the first lines; the rest follows as the machine reports where it is."""
        self.started = self._streaming = self._tracking = True
        self._begin_accounts()
        self._override.schedule(self._loop.time())
        self._next_lines = self._released()
        self._send()

    def stop(self) -> None:
        """Send no more lines, whatever is reported; those not yet on the wire are dropped.

        Called as beam and motion are taken down: a laser-enable output drops in this moment.
        """
        if self._streaming:
            self._streaming = False
            self._beam_off_s = beam_off_s(self._cell.safety, self._clock, self._loop.time())
            if self._beam_off_s < math.inf:
                self._motion.on_beam_off(self._beam_off_s)
            self._override.cancel()
            self._next_lines.clear()
            self._cell.motion.discard_queue()

    def finish_path(self, path_done: Callable[[], None]) -> None:
        """Send no path that has not begun; `path_done` is called when motion has come to its end.

        Where the job ends with that path, `done` is called instead.
        """
        self._streamer.end_with_path(self._counted, path_done)

    @property
    def standstill_mm(self) -> tuple[float, ...] | None:
        """Machine position at rest, program coordinates; None where it was not reported."""
        motion = self._cell.motion
        return motion.position_mm if is_at_rest(motion) and motion.position_trusted else None

    def place_at_rest(self) -> PlaceReached:
        """Motion has been stopped: how far the job has been executed, and how that is known.

        What is reported later is no longer this job's.
        """
        if self._tracking:
            self.stop()
            self._tracking = False
            self._motion.on_motion_end()
            clock, age_s = self._clock, self._loop.time() - self._clock.reported_t
            ended = deposition_end(
                self._cell.motion, clock, self._window,
                executed_s=min(clock.reported_s, self._energy.bead_short_from_s),
                off_s=self._beam_off_s, sent=self._sent,
                reported_s=self._recorder.now_s() - age_s if age_s < math.inf else None,
            )
            self._reached = self._beyond_approach(ended)
        return self._reached

    def _beyond_approach(self, ended: PlaceReached) -> PlaceReached:
        """What `ended` adds to what had been executed before; the approach adds nothing."""
        before = self._reached
        if max(ended.place, ended.until) <= max(before.place, ProgramPlace(self._beam_on_line)):
            return before
        return replace(ended, place=max(ended.place, before.place),
                       at_least=max(ended.at_least, before.place))

    def _begin_accounts(self) -> None:
        """Motion is about to begin: what was fed until now was for the hose, not for the part."""
        t, entry = self._loop.time(), self._entry
        self._recorder.record_purge(self._feed.fed.take_remaining_fed_g(t))
        self._accounts.follow_place(lambda: (self._motion.reached_place,
                                             self._motion.remaining_bead_mm))
        if entry is not None:
            self._accounts.close_before(entry.layer.index)
            self._accounts.record_reentry(entry.layer.index, entry.repeated_mm)
        self._feed.fed.on_readings(t, self._cell.hopper_readings())
        self._motion.on_motion_start(t)

    # --- feed override ------------------------------------------------------------------------

    def set_override_now(self, percent: int) -> None:
        """Set the feed override at once."""
        self._override.apply_now(self._loop.time(), percent)

    def schedule_override(self, percent: int) -> None:
        """Set the feed override where powder can follow it; before motion starts, from then on."""
        self._override.request(percent)
        if self._streaming:
            self._override.schedule(self._loop.time())

    # --- listeners of the motion driver -------------------------------------------------------

    def on_status(self, report: StatusReport) -> None:
        """Take the place the machine has reached."""
        try:
            self._on_report(report)
        except Exception as error:
            self._failed(error)

    def on_query(self) -> None:
        """A status query is due: send with it the lines that the last report released."""
        try:
            self._send()
        except Exception as error:
            self._failed(error)

    def on_progress(self) -> None:
        """More lines are acknowledged or executed."""
        if not self._streaming:
            return
        try:
            self._on_lines_executed()
        except Exception as error:
            self._failed(error)

    def _on_report(self, report: StatusReport) -> None:
        t, motion = self._loop.time(), self._cell.motion
        position_mm = motion.position_mm
        if position_mm is None:
            return
        readings = self._cell.hopper_readings()
        if self._tracking:
            if report.override_percents is not None:
                self._controller_override(t, report.override_percents)
            self._compare_with_program(t, report, position_mm)
            self._feed.fed.on_readings(t, readings)
            if not self._clock.is_in_doubt:
                self._motion.on_report(
                    t, self._clock.reported_s, report, position_mm, off_mm=self._clock.off_mm,
                    rate=self._clock.rate, overrides=motion.overrides,
                )
        if self._streaming:
            if self._clock.is_override_pending:
                self._override.apply_if_due(t)
            self._next_lines += self._released()
            if not self._may_wait:
                self._send()
            self._report_progress(t)
        self._recorder.record_sample(
            self.lines_executed, position_mm, report.feed_mm_min, report.spindle_speed,
            self._feed.flows_g_min,
            tuple([None if one is None else one.flow_estimated_g_min for one in readings]),
            tuple([None if one is None else one.carrier_L_min for one in readings]),
            self._cell.shield_gas_L_min,
        )

    def _compare_with_program(
        self, t: float, report: StatusReport, position_mm: tuple[float, ...]
    ) -> None:
        """Compare a report with the program; after a doubtful one, query again at once."""
        motion, clock, energy = self._cell.motion, self._clock, self._energy
        feed = report.feed_mm_min
        speed_mm_s = math.inf if feed is None else feed / 60.0
        clock.on_report(t, self._counted, position_mm, speed_mm_s)
        if not clock.is_in_doubt and clock.off_mm <= OFF_PATH_MM:
            energy.on_report(
                report, clock.program_time_s(t), clock.rate,
                overrides_known=motion.are_overrides_known
            )
        if clock.is_in_doubt or energy.is_in_doubt:
            motion.request_confirming_report()

    def _controller_override(self, t: float, overrides: tuple[int, int, int]) -> None:
        """Take the overrides the controller reports: its panel may have been used."""
        feed, _, power = overrides
        if (feed, power) != self._percent:
            self._percent = feed, power
            self._recorder.record_override(feed, "controller", power)
        self._clock.set_override(t, feed / 100.0)

    def _report_progress(self, t: float) -> None:
        if self._progress is None:
            return
        s = self._clock.program_time_s(t)
        remaining_s = self._remaining_time.remaining_s(t, s, self._clock.rate)
        if remaining_s is not None:
            self._progress(s, self._window.end_s, self._motion.layer, remaining_s)

    def _on_lines_executed(self) -> None:
        window, executed = self._window, self._counted
        self._clock.acknowledge(self._first_line + self._cell.motion.lines_acknowledged)
        if executed == self._seen:
            return
        self._seen = executed
        if completed := self._streamer.completed_paths(executed):
            self._recorder.record_paths_executed(completed)
        self._motion.on_lines_executed(self._loop.time(), executed, self._clock.rate)
        # A layer of a few short lines may be executed before a report has counted it.
        window.drop_layers_before(min(executed, self._motion.first_line_needed))
        if executed >= window.n_lines:
            self._streaming = False
            self._done()

    def _released(self) -> list[bytes]:
        """The next lines that may be sent, journaled."""
        batch = self._streamer.release(self._clock.program_time_s(self._loop.time()),
                                       self._clock.rate)
        if batch.begun:
            for layer in dict.fromkeys(path.layer for path in batch.begun):
                self._accounts.open_layer(layer)
            self._recorder.record_paths_started(batch.begun)
        return batch.lines

    def _send(self) -> None:
        if self._next_lines:
            lines, self._next_lines = self._next_lines, []
            self._sent += len(lines)
            self._recorder.sent(self._sent, place_at(self._window, self._clock.reported_s))
            self._cell.motion.submit(lines)
