"""Sending set-points to the feeders: every tick at which they may change, where they do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from lmctl.machine.timer_wheel import align_to_tick
from lmctl.preflight.setpoint_rules import MAX_TICKS, SETPOINT_PERIOD_S
from lmctl.run.cell.devices import Cell
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.fed import FedPowder
from lmctl.run.powder.lead import PowderPlan
from lmctl.run.program.program_clock import ProgramClock


class SetpointSender:
    """The set-points of one run.

    flows_g_min : last sent, in the order of the job's hoppers
    fed : what they have fed since
    failed : called with what goes wrong at a tick; no set-point is sent after that
    """

    def __init__(
        self, cell: Cell, plan: PowderPlan, clock: ProgramClock, recorder: RunRecorder,
        failed: Callable[[Exception], None],
    ) -> None:
        self.plan = plan
        self._cell = cell
        self._recorder = recorder
        self._failed = failed
        self._loop = asyncio.get_running_loop()
        self._names = tuple(hopper.name for hopper in cell.hoppers)
        self.flows_g_min: tuple[float, ...] = (0.0,) * len(self._names)
        self.fed = FedPowder(self._names, self._loop.time())
        self._is_on = False
        self._ticked_t = 0.0
        self._timer: asyncio.TimerHandle | None = None
        clock.turned = self._look_again

    def hold_flows(self, flows_g_min: tuple[float, ...]) -> None:
        """Send these set-points, in the order of the job's hoppers, and no others until `start`."""
        self._change(flows_g_min)
        self._cell.set_flows(dict(zip(self._names, flows_g_min, strict=True)))

    def start(self) -> None:
        """Send set-points from now on; the first at once."""
        if not self._is_on:
            self._is_on = True
            self.plan.start()
            self._ticked_t = align_to_tick(self._loop.time(), -1.0)
            self._tick(0)

    def stop(self) -> None:
        """Send no more set-points. (It is for the feeders' own command to stop the discs.)"""
        self._is_on = False
        if self._timer is not None:
            self._timer.cancel()
        if any(self.flows_g_min):
            self._change((0.0,) * len(self._names))

    def _tick(self, ticks: int) -> None:
        """ticks : since the last one."""
        self._ticked_t = self._after(ticks)
        try:
            flows = tuple(self.plan.setpoints_g_min(self._ticked_t, ticks))
            if flows != self.flows_g_min:
                self._change(flows)
                self._cell.set_flows(dict(zip(self._names, flows, strict=True)))
            rest = round(self.plan.valid_for_s(self._ticked_t) / SETPOINT_PERIOD_S, 6)
        except Exception as error:
            self._is_on = False
            self._failed(error)
            return
        self._tick_after(int(min(max(rest, 1), MAX_TICKS)))

    def _tick_after(self, ticks: int) -> None:
        self._timer = self._loop.call_at(self._after(ticks), self._tick, ticks)

    def _after(self, ticks: int) -> float:
        return align_to_tick(self._ticked_t + ticks * SETPOINT_PERIOD_S, -1.0)

    def _look_again(self) -> None:
        """What lies ahead has changed: the very next tick is due."""
        if self._is_on and self._timer is not None:
            self._timer.cancel()
            self._tick_after(int((self._loop.time() - self._ticked_t) / SETPOINT_PERIOD_S) + 1)

    def _change(self, flows_g_min: tuple[float, ...]) -> None:
        self.flows_g_min = flows_g_min
        self.fed.set_flows(self._loop.time(), flows_g_min)
        self._recorder.record_setpoint(dict(zip(self._names, flows_g_min, strict=True)))
