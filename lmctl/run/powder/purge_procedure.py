"""Gas, then powder until it is steady, at the purge position; over a catch scale it also measures.

Every start of a run and every return to the part goes this way.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.job.schema import JobManifest
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.run.cell.devices import Cell
from lmctl.run.interlocks.alarms import RunAlarms
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.hose_calibration import HoseCalibration
from lmctl.run.powder.layer_purge import LayerPurges
from lmctl.run.powder.purge_measurement import PurgeMeasurement
from lmctl.run.powder.setpoint_sender import SetpointSender

#: Beyond its own settling time a feeder may take so long to call its powder stable.
_STABLE_PATIENCE_S = 60.0


class PurgeProcedure:
    """The purges of one run.

    hoses : dead times and lags in use
    layers : between layers, where the profile asks for them; None where it does not, and for a job
        without powder, which measures nothing either
    """

    def __init__(
        self, manifest: JobManifest, profile: MachineProfile, hoppers: Sequence[HopperSettings],
        alarms: RunAlarms, recorder: RunRecorder,
    ) -> None:
        use, scale = profile.calibration_use, profile.scale
        self.hoses = HoseCalibration(hoppers, use, alarms, recorder)
        self.layers: LayerPurges | None = None
        self._measurement: PurgeMeasurement | None = None
        if scale is not None and scale.purge is not None and manifest.powder_mode != "none":
            self._measurement = PurgeMeasurement(
                scale, hoppers, use, self.hoses, recorder)
            if scale.purge.every_layers:
                self.layers = LayerPurges(manifest, scale.purge.every_layers)

    async def switch_gas_on(self, cell: Cell) -> None:
        """Return when the pre-flow is over; meanwhile the scale is looked for, if there is one."""
        if self._measurement is None:
            await cell.for_each_feeder(FeederDriver.start_gas)
            return
        preparing = asyncio.create_task(self._measurement.prepare())
        try:
            await cell.for_each_feeder(FeederDriver.start_gas)
            await preparing
        finally:
            preparing.cancel()
            await asyncio.gather(preparing, return_exceptions=True)

    async def switch_powder_on(self, cell: Cell, feed: SetpointSender) -> None:
        """At the flows of the first line, or at the low ones that a measurement begins with."""
        lows = None if self._measurement is None else self._measurement.low_flows_g_min
        if lows is None:
            feed.start()
        else:
            feed.hold_flows(lows)
        await cell.for_each_feeder(FeederDriver.start_powder)

    async def settle(self, cell: Cell, feed: SetpointSender) -> None:
        """Measure where that is prepared. Then wait θ + 4τ, until hose outflow equals inflow, and
        until the feeders report stable."""
        if self._measurement is not None:
            await self._measurement.measure(feed)
            feed.plan.set_hoses(self.hoses.dynamics())
            feed.start()
        await asyncio.sleep(feed.plan.settling_s)
        await cell.wait_until(
            lambda: all(f.status is not None and f.status.stable for f in cell.feeders),
            _STABLE_PATIENCE_S, "stable powder",
        )

    async def close(self) -> None:
        """Disconnect from the scale."""
        if self._measurement is not None:
            await self._measurement.close()
