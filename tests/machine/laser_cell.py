"""A safety device with a laser-enable output behind a wire, and a driver that has met it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from lmctl.config.machine import SafetySettings
from lmctl.machine.safety.driver import SafetyDriver
from lmctl.machine.safety.status import SafetyCallbacks
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice

LASER_ENABLE = 3
FITTED = SafetyConfig(watchdog_relay=True, laser_enable=True)


def now() -> float:
    return asyncio.get_running_loop().time()


class Cell:
    """Driver and device, with all that was written and told."""

    def __init__(self, driver: SafetyDriver, device: SimulatedSafetyDevice, edge: LinkTap) -> None:
        self.driver, self.device, self.edge = driver, device, edge
        self.words: list[tuple[float, int]] = []
        self.faults: list[tuple[str, str]] = []
        driver.callbacks = SafetyCallbacks(
            on_fault=lambda reason, hint: self.faults.append((reason, hint))
        )
        carry_out = device.write

        def write(address, words):
            written = dict(enumerate(words, address))
            if LASER_ENABLE in written:
                self.words.append((now(), written[LASER_ENABLE]))
            carry_out(address, words)

        device.write = write

    @property
    def is_on(self) -> bool:
        return not self.device.is_laser_enable_off

    async def on(self) -> None:
        self.driver.request_laser_enable(True)
        await self.driver.wait_for_laser_enable(True)


@asynccontextmanager
async def driven(wire: str = "tcp", config: SafetyConfig = FITTED, **settings
                 ) -> AsyncIterator[Cell]:
    device, edge = SimulatedSafetyDevice(config, now), LinkTap()
    server = await (serve_tcp(device, edge=edge) if wire == "tcp"
                    else serve_pty(device, edge, baud=115_200))
    settings = {"relay_timeout_s": 0.3, "laser_enable": True, **settings}
    driver = await SafetyDriver.open(SafetySettings(endpoint=server.endpoint, **settings))
    try:
        await driver.reset_watchdog_relay()
        yield Cell(driver, device, edge)
    finally:
        await driver.close()
        await server.close()


wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


def played(act, wire: str = "tcp", **settings):
    async def main():
        async with driven(wire, **settings) as cell:
            await act(cell)

    virtual_time.run_in_virtual_time(main())
