"""Sending set-points to the feeders: every tick, where they change."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from lmctl.run.cell import Cell
from lmctl.run.powder_lead import TICK_S, PowderPlan
from lmctl.run.recorder import Recorder


class PowderFeed:
    """The set-points of one run.

    flows_g_min : last sent, in the order of the job's hoppers
    failed : called with what goes wrong at a tick; no set-point is sent after that
    """

    def __init__(
        self, cell: Cell, plan: PowderPlan, recorder: Recorder,
        failed: Callable[[Exception], None],
    ) -> None:
        self.plan = plan
        self._cell = cell
        self._recorder = recorder
        self._failed = failed
        self._loop = asyncio.get_running_loop()
        self._names = tuple(hopper.name for hopper in cell.hoppers)
        self.flows_g_min: tuple[float, ...] = (0.0,) * len(self._names)
        self._fed_g = [0.0] * len(self._names)
        self._timer: asyncio.TimerHandle | None = None
        self._due_t = 0.0

    def on(self) -> None:
        """Send set-points from now on; the first at once."""
        if self._timer is None:
            self.flows_g_min = (-1.0,) * len(self._names)  # whatever comes first is a change
            self._due_t = self._loop.time()
            self.plan.start()
            self._tick()

    def off(self) -> None:
        """Send no more set-points. (It is for the feeders' own command to stop the discs.)"""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self.flows_g_min = (0.0,) * len(self._names)
            self._recorder.setpoint(dict(zip(self._names, self.flows_g_min, strict=True)))

    def take_fed_g(self) -> dict[str, float]:
        """What the set-points since the last call asked for, by hopper [g]."""
        fed = dict(zip(self._names, self._fed_g, strict=True))
        self._fed_g = [0.0] * len(self._names)
        return fed

    def _tick(self) -> None:
        self._due_t += TICK_S
        self._timer = self._loop.call_at(self._due_t, self._tick)
        try:
            self._send()
        except Exception as error:
            self.off()
            self._failed(error)

    def _send(self) -> None:
        flows = tuple(self.plan.setpoints_g_min(self._loop.time()))
        for hopper, flow_g_min in enumerate(flows):
            self._fed_g[hopper] += flow_g_min * TICK_S / 60.0
        if flows != self.flows_g_min:
            self.flows_g_min = flows
            by_name = dict(zip(self._names, flows, strict=True))
            self._recorder.setpoint(by_name)
            self._cell.set_flows(by_name)
