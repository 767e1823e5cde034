"""A device whose answers get lost now and then is opened all the same, whichever answer it is."""

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from firmware_protocol.device_map import DeviceMap
from lmctl.config.machine import FeederSettings, SafetySettings
from lmctl.config.measuring import ScaleSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.safety.driver import SafetyDriver
from lmctl.machine.scale.driver import CatchScaleDriver
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.mapped_device import MappedFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_quirks import ModbusQuirks
from simulators.modbus_server import ModbusServer, serve_pty, serve_tcp
from simulators.safety.device import SimulatedSafetyDevice
from simulators.scale.config import ScaleConfig
from simulators.scale.device import SimulatedCatchScale
from tests.machine.feeder_cell import ONE, hopper, now
from tests.machine.safety_cell import RELAY
from tests.machine.test_feeder_maps import MAPS

#: More answers than any device gives while it is opened; a test that comes here loses none.
MOST_ANSWERS = 60


class AnswersLost:
    """Drops `count` answers in a row, after `before`. were_lost : whether it came to that"""

    def __init__(self, before: int, count: int) -> None:
        self._seen, self._before, self._count = 0, before, count

    @property
    def were_lost(self) -> bool:
        return self._seen > self._before

    def __call__(self, data, deliver) -> None:
        self._seen += 1
        if not self._before < self._seen <= self._before + self._count:
            deliver(data)


async def feeder_over_tcp(edge: LinkTap) -> tuple[ModbusServer, Callable[[], Awaitable]]:
    server = await serve_tcp(FeederRegisters(PmxFeederDevice(ONE, now)), edge=edge)
    settings = FeederSettings(name="F1", endpoint=server.endpoint)
    return server, lambda: FeederDriver.open(settings, (hopper(),))


async def feeder_over_rtu(edge: LinkTap) -> tuple[ModbusServer, Callable[[], Awaitable]]:
    server = await serve_pty(FeederRegisters(PmxFeederDevice(ONE, now)), edge)
    settings = FeederSettings(name="F1", endpoint=server.endpoint)
    return server, lambda: FeederDriver.open(settings, (hopper(),))


async def feeder_with_a_map(
    device_map: DeviceMap, edge: LinkTap
) -> tuple[ModbusServer, Callable[[], Awaitable]]:
    device = PmxFeederDevice(replace(ONE, has_watchdog=device_map.feeder.has_watchdog), now)
    units = MappedFeederDevice(device, device_map).units()
    own = units.pop(None)
    server = await serve_tcp(
        own, edge=edge, units={one.device_id: one for one in units.values()},
        quirks=ModbusQuirks(0, device_map.max_registers, device_map.function_codes))
    settings = FeederSettings(name="F1", endpoint=server.endpoint, map="of the test")
    return server, lambda: FeederDriver.open(settings.with_device_map(device_map), (hopper(),))


async def safety_device(edge: LinkTap) -> tuple[ModbusServer, Callable[[], Awaitable]]:
    server = await serve_tcp(SimulatedSafetyDevice(RELAY, now), edge=edge)
    settings = SafetySettings(endpoint=server.endpoint, relay_timeout_s=0.3)
    return server, lambda: SafetyDriver.open(settings)


async def catch_scale(edge: LinkTap) -> tuple[ModbusServer, Callable[[], Awaitable]]:
    server = await serve_tcp(SimulatedCatchScale(ScaleConfig(), now, np.zeros_like), edge=edge)
    settings = ScaleSettings(endpoint=server.endpoint)
    return server, lambda: CatchScaleDriver.open(settings)


devices = pytest.mark.parametrize("device", [
    feeder_over_tcp, feeder_over_rtu, safety_device, catch_scale,
    *(pytest.param(partial(feeder_with_a_map, MAPS[name]), id=f"map_{name}") for name in MAPS),
])


def opening(device, before: int, lost: int) -> bool:
    """Open a device while answers get lost; returns whether the opening came to these answers."""
    async def main():
        edge = LinkTap()
        server, driver_of = await device(edge)
        losses = AnswersLost(before, lost)
        edge.add_filter("to_host", losses)
        try:
            driver = await driver_of()
            await driver.close()
        finally:
            await server.close()
        return losses.were_lost

    return virtual_time.run_in_virtual_time(main())


@devices
@pytest.mark.parametrize("lost", [1, 2])
def test_an_answer_lost_while_a_device_is_opened_is_asked_for_again(device, lost):
    before = 0
    while opening(device, before, lost):
        before += 1
        assert before < MOST_ANSWERS
    assert before >= 3


@devices
def test_a_device_that_stays_silent_while_it_is_opened_is_named(device):
    for before in range(3):
        with pytest.raises(MachineError, match=r"no byte came back in \d+ requests") as it:
            opening(device, before, MOST_ANSWERS)
        assert it.value.where
        assert it.value.hint
