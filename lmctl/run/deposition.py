"""Depositing: lines to the controller as the machine gets on, and the journal of it.

Driven by the motion driver's reports; between them it does nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.status import StatusReport
from lmctl.run.cell import Cell
from lmctl.run.job_window import JobWindow
from lmctl.run.outlook import Outlook
from lmctl.run.overrides import override_bytes
from lmctl.run.powder_feed import PowderFeed
from lmctl.run.program_clock import ProgramClock
from lmctl.run.recorder import Recorder
from lmctl.run.streamer import Streamer

#: An override waits so long for a travel in which it can be set [s].
_OVERRIDE_WITHIN_S = 60.0

#: The travel must begin so much later than powder sent now arrives [s]: a report and two ticks.
_NOTICE_S = 0.3

#: (program time done, program time in all, layer, remaining machine time) [s]
Progress = Callable[[float, float, int, float], None]


class Deposition:
    """One job on one cell, from the first line to the last executed one.

    started : whether a line of the job has been sent
    done : called once, when the last line has been executed
    failed : called with what goes wrong in a report
    """

    def __init__(
        self, cell: Cell, window: JobWindow, clock: ProgramClock, feed: PowderFeed,
        recorder: Recorder, horizon_s: float, *, done: Callable[[], None],
        failed: Callable[[Exception], None], progress: Progress | None,
    ) -> None:
        self.started = False
        self._cell = cell
        self._window = window
        self._clock = clock
        self._feed = feed
        self._recorder = recorder
        self._streamer = Streamer(window, horizon_s)
        self._done = done
        self._failed = failed
        self._progress = progress
        self._outlook = Outlook(window.end_s)
        self._loop = asyncio.get_running_loop()
        self._streaming = False
        self._seen = 0  # lines executed when last looked at
        self._layer = 0
        self._layer_t = 0.0
        self._layer_fed_g: dict[str, float] = {}
        self._percent = 100

    @property
    def executed(self) -> int:
        """Lines of the job known to be executed."""
        return self._cell.motion.executed if self.started else 0

    @property
    def place(self) -> str:
        """Where in the job the run is, for people."""
        if self.executed >= self._window.n_lines:
            return "the end of the program"
        return f"layer {self._layer + 1}, program line {self.executed}"

    def start(self) -> None:
        """Send the first lines; the rest follows as the machine reports where it is."""
        self.started = self._streaming = True
        self._layer_t = self._loop.time()
        self._recorder.purged(self._feed.take_fed_g())
        self._release()

    def held(self) -> None:
        """Motion is to stop for a while: powder fed from now on is not this layer's."""
        self._count_fed()

    def resumed(self) -> None:
        """Motion goes on after a hold."""
        self._recorder.purged(self._feed.take_fed_g())
        self._outlook.restart()

    def stop(self) -> None:
        """Send no more lines, whatever is reported; those not yet on the wire are dropped."""
        self._streaming = False
        self._cell.motion.discard_queue()

    # --- feed override ------------------------------------------------------------------------

    def override_now(self, percent: int) -> None:
        """Set the feed override at once."""
        for byte in override_bytes(percent):
            self._cell.motion.realtime(byte)
        self._clock.set_rate(self._loop.time(), percent / 100.0)

    def override_when_dark(self, percent: int) -> None:
        """Set the feed override in the next travel that powder sent from now on can reach.

        What is in the hoses was sent for the old one. Where no such travel comes soon, at once.
        """
        t = self._loop.time()
        reach_s = self._clock.ahead(t, self._feed.plan.lead_s + _NOTICE_S)
        dark = self._window.next_dark_s(reach_s, self._clock.ahead(t, _OVERRIDE_WITHIN_S))
        if dark is None:
            self.override_now(percent)
        else:
            self._clock.plan_rate(*dark, percent / 100.0)

    # --- listeners of the motion driver -------------------------------------------------------

    def on_status(self, report: StatusReport) -> None:
        """Take the place the machine has reached."""
        try:
            self._take(report)
        except Exception as error:
            self._failed(error)

    def on_progress(self) -> None:
        """More lines are acknowledged or executed."""
        if not self._streaming:
            return
        try:
            self._go_on()
        except Exception as error:
            self._failed(error)

    def _take(self, report: StatusReport) -> None:
        t, motion = self._loop.time(), self._cell.motion
        position_mm = motion.position_mm
        if position_mm is None:
            return
        if self._streaming:
            if report.overrides is not None:
                self._controller_override(t, report.overrides[0])
            self._clock.report(t, motion.executed, position_mm)
            if (due := self._clock.due_rate(t)) is not None:
                self.override_now(round(due * 100.0))
            self._release()
            self._tell(t)
        self._recorder.sample(
            self.executed, position_mm, report.feed_mm_min, report.spindle,
            self._feed.flows_g_min, self._cell.measured_g_min(),
        )

    def _controller_override(self, t: float, percent: int) -> None:
        """What the controller reports counts: its panel may have been used."""
        if percent != self._percent:
            self._percent = percent
            self._recorder.override(percent, "controller")
        self._clock.set_rate(t, percent / 100.0)

    def _tell(self, t: float) -> None:
        if self._progress is None:
            return
        s = self._clock.now(t)
        remaining_s = self._outlook.remaining_s(t, s, self._clock.rate)
        if remaining_s is not None:
            self._progress(s, self._window.end_s, self._layer, remaining_s)

    def _go_on(self) -> None:
        motion, window = self._cell.motion, self._window
        executed = motion.executed
        self._clock.acknowledge(motion.acknowledged)
        if executed == self._seen:
            return
        self._seen = executed
        if completed := self._streamer.completed(executed):
            self._recorder.executed(completed)
        while self._layer < len(window.manifest.layers):
            stretch = window.stretch(self._layer)
            if executed <= stretch.last_line:
                break
            self._layer_done()
        window.forget(executed)
        if executed >= window.n_lines:
            self._streaming = False
            self._done()

    def _release(self) -> None:
        batch = self._streamer.take(self._clock.now(self._loop.time()), self._clock.rate)
        if batch.begun:
            self._recorder.paths(batch.begun)
        if batch.lines:
            self._cell.motion.submit(batch.lines)

    def _layer_done(self) -> None:
        stretch = self._window.stretch(self._layer)
        t = self._loop.time()
        self._count_fed()
        self._recorder.layer(
            layer=self._layer, z_mm=stretch.z_mm, lines=[stretch.first_line, stretch.last_line],
            paths=len(stretch.paths), beam_s=round(stretch.beam_s, 3),
            beam_mm=round(stretch.beam_mm, 3), energy_J=round(stretch.energy_J, 1),
            planned_s=round(float(stretch.end_s[-1] - stretch.start_s[0]), 3),
            lasted_s=round(t - self._layer_t, 3),
            fed_g={name: round(fed, 3) for name, fed in self._layer_fed_g.items()},
        )
        self._layer += 1
        self._layer_t = t
        self._layer_fed_g.clear()

    def _count_fed(self) -> None:
        for name, fed in self._feed.take_fed_g().items():
            self._layer_fed_g[name] = self._layer_fed_g.get(name, 0.0) + fed
