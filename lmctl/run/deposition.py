"""Depositing: lines to the controller, powder to the hoppers, in step with what is executed.

Driven by the motion driver's reports and a timer; between them it does nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.status import StatusReport
from lmctl.run.cell import Cell
from lmctl.run.job_window import JobWindow
from lmctl.run.outlook import Outlook
from lmctl.run.overrides import override_bytes
from lmctl.run.powder_lead import TICK_S, PowderPlan
from lmctl.run.program_clock import ProgramClock
from lmctl.run.recorder import Recorder
from lmctl.run.streamer import Streamer

#: Flows are sent when they differ at the feeders' resolution, 0.01 g/min (process.md 1.4).
_FLOW_DECIMALS = 2

#: An override waits so long for a travel in which it can be set [s].
_OVERRIDE_WITHIN_S = 60.0

#: The travel must begin so much later than powder sent now arrives [s]: a report and two ticks.
_NOTICE_S = 0.3

#: (program time done, program time in all, layer, remaining machine time) [s]
Progress = Callable[[float, float, int, float], None]


class Deposition:
    """One job on one cell, from the first set-point to the last executed line.

    started : whether a line of the job has been sent
    done : called once, when the last line has been executed
    failed : called with what goes wrong in a report or at a tick
    """

    def __init__(
        self, cell: Cell, window: JobWindow, plan: PowderPlan, clock: ProgramClock,
        recorder: Recorder, horizon_s: float, *, done: Callable[[], None],
        failed: Callable[[Exception], None], progress: Progress | None,
    ) -> None:
        self.clock = clock
        self.plan = plan
        self._cell = cell
        self._window = window
        self._recorder = recorder
        self._streamer = Streamer(window, horizon_s)
        self._done = done
        self._failed = failed
        self._progress = progress
        self._outlook = Outlook(window.end_s)
        self._loop = asyncio.get_running_loop()
        self._streaming = False
        self._finished = False
        self.started = False
        self._tick_timer: asyncio.TimerHandle | None = None
        self._tick_due_t = 0.0
        self._names = tuple(hopper.name for hopper in cell.hoppers)
        self._flows_g_min: tuple[float, ...] = (0.0,) * len(self._names)
        self._fed_g = [0.0] * len(self._names)
        self._layer = 0
        self._layer_t = 0.0
        self._percent = 100

    @property
    def executed(self) -> int:
        """Lines of the job known to be executed."""
        return self._cell.motion.executed if self.started else 0

    @property
    def place(self) -> str:
        """Where in the job the run is, for people."""
        if self.executed >= self._window.n_lines:
            return "after the last line"
        return f"layer {self._layer + 1}, program line {self.executed}"

    # --- powder -------------------------------------------------------------------------------

    def powder_on(self) -> None:
        """Send set-points from now on, every tick, where they change."""
        if self._tick_timer is None:
            self._flows_g_min = (-1.0,) * len(self._names)  # the first is always sent
            self._tick_due_t = self._loop.time()
            self.plan.start()
            self._tick()

    def powder_off(self) -> None:
        """Send no more set-points."""
        if self._tick_timer is not None:
            self._tick_timer.cancel()
            self._tick_timer = None

    def _tick(self) -> None:
        self._tick_due_t += TICK_S
        self._tick_timer = self._loop.call_at(self._tick_due_t, self._tick)
        try:
            self._send_flows()
        except Exception as error:
            self.powder_off()
            self._failed(error)

    def _send_flows(self) -> None:
        setpoints = self.plan.setpoints_g_s(self._loop.time())
        for hopper, flow_g_s in enumerate(setpoints):
            self._fed_g[hopper] += flow_g_s * TICK_S
        flows = tuple(round(flow_g_s * 60.0, _FLOW_DECIMALS) for flow_g_s in setpoints)
        if flows != self._flows_g_min:
            self._flows_g_min = flows
            by_name = dict(zip(self._names, flows, strict=True))
            self._recorder.setpoint(by_name)
            self._cell.set_flows(by_name)

    # --- motion -------------------------------------------------------------------------------

    def start_motion(self) -> None:
        """Send the first lines; the rest follows as lines are executed."""
        self.started = self._streaming = True
        self._layer_t = self._loop.time()
        self._release()

    def override_now(self, percent: int) -> None:
        """Set the feed override at once."""
        for byte in override_bytes(percent):
            self._cell.motion.realtime(byte)
        self.clock.set_rate(self._loop.time(), percent / 100.0)

    def override_when_dark(self, percent: int) -> None:
        """Set the feed override in the next travel that powder sent from now on can reach.

        What is in the hoses was sent for the old one. Where no such travel comes soon, at once.
        """
        t = self._loop.time()
        reach_s = self.clock.ahead(t, self.plan.lead_s + _NOTICE_S)
        dark = self._window.next_dark_s(reach_s, self.clock.ahead(t, _OVERRIDE_WITHIN_S))
        if dark is None:
            self.override_now(percent)
        else:
            self.clock.plan_rate(*dark, percent / 100.0)

    def resumed(self) -> None:
        """Motion goes on after a hold."""
        self._outlook.restart()

    def stop_streaming(self) -> None:
        """Send no more lines, whatever is reported."""
        self._streaming = False
        self._cell.motion.discard_queue()

    def on_status(self, report: StatusReport) -> None:
        """Listener of the motion driver: take the place the machine has reached."""
        try:
            self._take(report)
        except Exception as error:
            self._failed(error)

    def on_progress(self) -> None:
        """Listener of the motion driver: more lines are acknowledged or executed."""
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
            self.clock.report(t, motion.executed, position_mm)
            if (due := self.clock.due_rate(t)) is not None:
                self.override_now(round(due * 100.0))
        self._recorder.sample(
            self.executed, position_mm, report.feed_mm_min, report.spindle, self._flows_g_min,
            self._cell.measured_g_min(),
        )
        if self._streaming and self._progress is not None:
            s = self.clock.now(t)
            remaining_s = self._outlook.remaining_s(t, s, self.clock.rate)
            if remaining_s is not None:
                self._progress(s, self._window.end_s, self._layer, remaining_s)

    def _controller_override(self, t: float, percent: int) -> None:
        """What the controller reports counts: its panel may have been used."""
        if percent != self._percent:
            self._percent = percent
            self._recorder.override(percent, "controller")
        self.clock.set_rate(t, percent / 100.0)

    def _go_on(self) -> None:
        motion = self._cell.motion
        self.clock.acknowledge(motion.acknowledged)
        executed = motion.executed
        if completed := self._streamer.completed(executed):
            self._recorder.executed(completed)
        while self._layer < len(self._window.manifest.layers):
            entry = self._window.manifest.layers[self._layer]
            if executed < entry.first_line + entry.n_lines:
                break
            self._layer_done()
        self._window.forget(executed)
        if executed >= self._window.n_lines and not self._finished:
            self._finished = True
            self._done()
        else:
            self._release()

    def _release(self) -> None:
        batch = self._streamer.take(self._cell.motion.executed, self.clock.rate)
        if batch.begun:
            self._recorder.paths(batch.begun)
        if batch.lines:
            self._cell.motion.submit(batch.lines)

    def _layer_done(self) -> None:
        stretch = self._window.stretch(self._layer)
        t = self._loop.time()
        self._recorder.layer(
            layer=self._layer, z_mm=stretch.z_mm, lines=[stretch.first_line, stretch.last_line],
            paths=len(stretch.paths), beam_s=round(stretch.beam_s, 3),
            beam_mm=round(stretch.beam_mm, 3), energy_J=round(stretch.energy_J, 1),
            planned_s=round(float(stretch.end_s[-1] - stretch.start_s[0]), 3),
            lasted_s=round(t - self._layer_t, 3),
            fed_g={
                name: round(fed, 3)
                for name, fed in zip(self._names, self._fed_g, strict=True)
            },
        )
        self._layer += 1
        self._layer_t = t
        self._fed_g = [0.0] * len(self._names)
