"""A safety-input device behind a wire, and a driver that has met it."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from lmctl.config.machine import SafetySettings
from lmctl.machine.safety.driver import SafetyDriver
from lmctl.machine.safety.status import SafetyCallbacks, SafetyStatus
from simulators.faults.link_tap import LinkTap
from simulators.modbus_server import ModbusServer, serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice

PERIOD_S = 0.1
RELAY = SafetyConfig(watchdog_relay=True)


class Ears(SafetyCallbacks):
    def __init__(self) -> None:
        self.statuses: list[SafetyStatus] = []
        self.faults: list[tuple[float, str]] = []
        super().__init__(
            self.statuses.append, lambda reason, hint: self.faults.append((now(), reason))
        )


def now() -> float:
    return asyncio.get_running_loop().time()


async def served(device, wire: str = "tcp", edge: LinkTap | None = None) -> ModbusServer:
    if wire == "tcp":
        return await serve_tcp(device, edge=edge)
    return await serve_pty(device, edge, baud=115_200)


@asynccontextmanager
async def driven(
    config: SafetyConfig = RELAY, wire: str = "tcp", edge: LinkTap | None = None,
    device: SimulatedSafetyDevice | None = None, **settings,
) -> AsyncIterator[tuple[SafetyDriver, SimulatedSafetyDevice, Ears]]:
    device = device or SimulatedSafetyDevice(config, asyncio.get_running_loop().time)
    server = await served(device, wire, edge)
    if config.watchdog_relay:
        settings.setdefault("relay_timeout_s", 0.3)
    driver = await SafetyDriver.open(SafetySettings(endpoint=server.endpoint, **settings))
    driver.callbacks = ears = Ears()
    try:
        yield driver, device, ears
    finally:
        await driver.close()
        await server.close()


wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


class Replayed(SimulatedSafetyDevice):
    """A device behind a gateway that gives old words for new ones."""

    old: list[int] | None = None

    def read_input(self, address: int, count: int) -> list[int]:
        words = super().read_input(address, count)
        return words if self.old is None else self.old[address : address + count]
