"""A simulated feeder behind a wire, and a driver that has met it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.feeder.status import FeederCallbacks
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import serve_tcp
from simulators.modbus_server import ModbusServer

TRUTH = HopperConfig(
    channel=1, material="316L", density_g_mm3=0.008, catch_efficiency=0.7, dead_time_s=3.0,
    lag_s=1.0, feed_factor_g_rev=2.0, n_min_rpm=0.3, n_max_rpm=30.0, fill_g=1000.0,
)
ONE = FeederConfig("F1", (TRUTH,))
#: How feeders are served: the fixture `wire` sets it.
SERVING = {"by": serve_tcp}


def hopper(name: str = "A", channel: int = 1, **changes) -> HopperSettings:
    return HopperSettings(**{"name": name, "feeder": "F1", "channel": channel, "material": "316L",
                             "dead_time_s": 3.0, "lag_s": 1.0, "max_flow_g_min": 60.0} | changes)


class Ears(FeederCallbacks):
    def __init__(self) -> None:
        self.statuses, self.faults = [], []
        super().__init__(self.statuses.append, self.faults.append)


@asynccontextmanager
async def simulated(config: FeederConfig) -> AsyncIterator[tuple]:
    device = PmxFeederDevice(config, asyncio.get_running_loop().time)
    server: ModbusServer = await SERVING["by"](device)
    try:
        yield device, server
    finally:
        await server.close()


@asynccontextmanager
async def driven(
    config: FeederConfig = ONE, *hoppers: HopperSettings, **settings
) -> AsyncIterator[tuple[FeederDriver, PmxFeederDevice, ModbusServer, Ears]]:
    async with simulated(config) as (device, server):
        feeder = FeederSettings(name="F1", endpoint=server.endpoint, **settings)
        driver = await FeederDriver.open(feeder, hoppers or (hopper(),))
        driver.callbacks = ears = Ears()
        try:
            yield driver, device, server, ears
        finally:
            await driver.close()


def now() -> float:
    return asyncio.get_running_loop().time()


def disc_rpm(device: PmxFeederDevice, channel: int = 1) -> float:
    device.advance_to_now()
    return device.hoppers[channel].process.disc_rpm(now())


async def feeding(driver: FeederDriver, flow_g_min: float = 6.0) -> None:
    await driver.start_gas()
    driver.set_flows({h.name: flow_g_min for h in driver.hoppers})
    await driver.start_powder()
    await driver.wait_until_stable(30.0)


only_tcp = pytest.mark.parametrize("wire", ["tcp"], indirect=True)
