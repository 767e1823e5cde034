"""A feeder and a catch scale behind wires, and what stands at them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace

import numpy as np

from lmctl.calibration.estimate import Estimate
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.config.measuring import ScaleSettings
from lmctl.machine.measuring.feeder_test import FeederTest
from lmctl.machine.measuring.step_plan import WantedPrecision, plan_steps
from lmctl.machine.scale.driver import CatchScaleDriver
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import serve_tcp as serve_feeder
from simulators.modbus_server import serve_tcp
from simulators.scale.config import ScaleConfig
from simulators.scale.device import SimulatedCatchScale

TRUTH = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.008, catch_efficiency=0.7, dead_time_s=1.6,
    lag_s=0.7, feed_factor_g_rev=2.0, n_min_rpm=0.3, n_max_rpm=30.0, fill_g=1000.0,
    slope_factor=1.04, noise_rsd=0.02, seed=5,
)
HOPPER = HopperSettings(name="A", feeder="F1", channel=1, material="316L", dead_time_s=1.5,
                        lag_s=0.6, min_flow_g_min=1.6, max_flow_g_min=20.0)
SCALE_LAG = Estimate(0.3, 0.005)
WIDE = WantedPrecision(dead_time_s=0.2, lag=0.2, slope=0.03)


class Hands:
    """An operator who is told what to do. late_s : after which they do it"""

    def __init__(self, scale: SimulatedCatchScale, weight_g: float = 100.0) -> None:
        self.scale, self.weight_g, self.late_s = scale, weight_g, 2.317

    async def put_on_weight(self, weight_g: float) -> None:
        await asyncio.sleep(self.late_s)
        self.scale.put_on(self.weight_g)

    async def take_off_weight(self, weight_g: float) -> None:
        await asyncio.sleep(self.late_s)
        self.scale.put_on(-self.weight_g)


class MeasuringCell:
    """device, pan : the simulated feeder and scale; scale : the driver of the latter"""

    def __init__(self, device: PmxFeederDevice, pan: SimulatedCatchScale, scale: CatchScaleDriver,
                 feeder: FeederSettings) -> None:
        self.device, self.pan, self.scale, self.feeder = device, pan, scale, feeder
        self.notices: list[str] = []

    def test(self, limit_s: float = 240.0, wanted: WantedPrecision = WIDE) -> FeederTest:
        return FeederTest(self.feeder, HOPPER, self.scale, SCALE_LAG, plan_steps(HOPPER, limit_s),
                          wanted, self.notices.append)


@asynccontextmanager
async def measuring_cell(
    scale: ScaleConfig | None = None, *, carries_powder: bool = True, **truth
) -> AsyncIterator[MeasuringCell]:
    now = asyncio.get_running_loop().time
    device = PmxFeederDevice(FeederConfig("F1", (replace(TRUTH, **truth),)), now)
    process = device.hoppers[1].process
    pan = SimulatedCatchScale(
        scale or ScaleConfig(), now,
        process.nozzle_flow_g_s if carries_powder else lambda at: np.zeros(len(at)))
    feeder_server, scale_server = await serve_feeder(device), await serve_tcp(pan)
    driver = await CatchScaleDriver.open(ScaleSettings(endpoint=scale_server.endpoint))
    try:
        yield MeasuringCell(device, pan, driver,
                            FeederSettings(name="F1", endpoint=feeder_server.endpoint,
                                           watchdog_s=4.0))
    finally:
        await driver.close()
        await feeder_server.close()
        await scale_server.close()
