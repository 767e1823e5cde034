"""Disturbed wires are ridden out: half-open connections, stray bytes, echoes, slow connecting."""

import asyncio

import pytest

from lmctl.config.machine import FeederSettings, SafetySettings
from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.modbus.client import ModbusLink, NoReplyError
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.faults.filters import ExactEcho, StrayBytes
from simulators.faults.link_tap import LinkTap, drop_chunk
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.server import FeederRegisters
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.feeder_cell import ONE, hopper, now
from tests.machine.feeder_cell import Ears as FeederEars
from tests.machine.safety_cell import PERIOD_S, RELAY
from tests.machine.safety_cell import Ears as SafetyEars
from tests.machine.safety_cell import driven as safety_driven


def test_a_half_open_connection_is_reopened_before_the_safety_device_is_silent():
    async def main():
        edge = LinkTap()
        async with safety_driven(edge=edge) as (driver, _, ears):
            driver.request_laser_enable(True)
            oldest_s = 0.0
            for at in range(20):
                await asyncio.sleep(0.5 + 0.013 * at)
                edge.make_connections_half_open()
                for _ in range(40):
                    await asyncio.sleep(0.01)
                    oldest_s = max(oldest_s, driver.status_age_s)
            assert ears.faults == []
            assert oldest_s < 3 * PERIOD_S
            assert driver.status.relay_closed is not None
            return oldest_s

    # one answer lost, and the next is there
    assert virtual_time.run_in_virtual_time(main()) <= 2.1 * PERIOD_S


def test_a_half_open_connection_is_reopened_before_the_feeder_is_silent():
    async def main():
        edge = LinkTap()
        device = PmxFeederDevice(ONE, now)
        server = await serve_tcp(FeederRegisters(device), edge=edge)
        driver = await FeederDriver.open(FeederSettings(name="F1", endpoint=server.endpoint),
                                         (hopper(),))
        driver.callbacks = ears = FeederEars()
        await driver.start_gas()
        for at in range(10):
            await asyncio.sleep(3.0 + 0.13 * at)
            edge.make_connections_half_open()
        await asyncio.sleep(3.0)
        await driver.close()
        await server.close()
        return ears.faults

    assert virtual_time.run_in_virtual_time(main()) == []


def test_a_device_that_answers_nothing_is_not_made_to_connect_each_time():
    async def main():
        edge = LinkTap()
        edge.add_filter("to_device", drop_chunk)
        server = await serve_tcp(FeederRegisters(PmxFeederDevice(ONE, now)), edge=edge)
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=1), timeout_s=0.1)
        for at in range(100):
            with pytest.raises(NoReplyError):
                await link.read_input(0, 1)
            await asyncio.sleep(0.1 * (at + 1) - now())
        await link.close()
        await server.close()
        return [at_s for at_s, came in edge.host_was_there if came]

    assert 4 <= len(virtual_time.run_in_virtual_time(main())) <= 8  # doubling: 1, 2, 4 ... requests


def test_connecting_takes_its_own_time_and_not_a_period(monkeypatch):
    make = asyncio.BaseEventLoop.create_connection

    async def slow(self, *args, **keywords):
        await asyncio.sleep(0.5)  # as a lost first packet takes it
        return await make(self, *args, **keywords)

    monkeypatch.setattr(asyncio.BaseEventLoop, "create_connection", slow)

    async def main():
        server = await serve_tcp(SimulatedSafetyDevice(RELAY, now))
        driver = await SafetyDriver.open(SafetySettings(endpoint=server.endpoint,
                                                        period_s=PERIOD_S))
        await driver.close()
        await server.close()

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("device_id", [1, 3, 247])
@pytest.mark.parametrize("disturbance", ["stray", "echo", "both"])
def test_rtu_answers_are_found_behind_stray_bytes_and_after_an_echo(device_id, disturbance):
    async def main():
        edge = LinkTap()
        device = PmxFeederDevice(type(ONE)("F1", ONE.hoppers, device_id=device_id), now)
        server = await serve_pty(FeederRegisters(device), edge)
        if disturbance != "stray":
            edge.add_filter("to_device", ExactEcho(edge.send_to_host))
        if disturbance != "echo":
            edge.add_filter("to_host", StrayBytes(3))
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=device_id), timeout_s=0.2)
        found = 0
        for at in range(50):
            await link.write(20, [at, 2, 3])
            found += list(await link.read_holding(20, 3)) == [at, 2, 3]
            found += list(await link.exchange(20, [at], 500, 1)) == [0x504D]
        await link.close()
        await server.close()
        return found

    assert virtual_time.run_in_virtual_time(main()) == 100


def silence_of(wire: str, disturb, *, device_id: int = 1, requests: int = 3) -> MachineError:
    """What a link says after some requests to a device whose wire is disturbed."""
    async def main():
        edge = LinkTap()
        server = await (serve_tcp if wire == "tcp" else serve_pty)(
            FeederRegisters(PmxFeederDevice(ONE, now)), edge=edge)
        link = await ModbusLink.open(
            ModbusDevice(endpoint=server.endpoint, device_id=device_id), timeout_s=0.2)
        disturb(edge)
        for _ in range(requests):
            with pytest.raises(NoReplyError) as caught:
                await link.read_input(0, 1)
        await link.close()
        await server.close()
        return caught.value

    return virtual_time.run_in_virtual_time(main())


def damaged(data, deliver):
    deliver(data[:-1] + bytes((data[-1] ^ 1,)))


def late(edge):
    waiting = []

    def hold_back(data, deliver):
        waiting.append(data)
        if len(waiting) > 1:
            deliver(waiting[-2])

    edge.add_filter("to_host", hold_back)


@pytest.mark.parametrize(("wire", "disturb", "words"), [
    ("rtu", lambda edge: edge.add_filter("to_device", drop_chunk),
     "no byte came back in 3 requests"),
    ("tcp", lambda edge: edge.add_filter("to_device", drop_chunk),
     "no byte came back in 3 requests"),
    ("rtu", lambda edge: edge.add_filter("to_host", damaged), "3 answers came damaged"),
    ("rtu", lambda edge: edge.add_filter("to_host", lambda data, deliver: deliver(bytes(
        byte * 37 & 0xE0 | 0x18 for byte in data))), "bytes came that are no Modbus frame"),
    ("tcp", late, "2 answers came later than 0.2 s"),
    ("tcp", lambda edge: edge.set_open(False), "there is no connection"),
])
def test_silence_says_what_was_seen(wire, disturb, words):
    error = silence_of(wire, disturb)
    assert "it does not answer: " in error.what
    assert words in error.what
    assert error.hint


def test_a_relay_reset_is_taken_though_the_last_host_left_the_same_heartbeat():
    """A device counts only a change of the heartbeat; 1 was this driver's first one always."""
    async def main():
        device = SimulatedSafetyDevice(RELAY, now)
        server = await serve_tcp(device)
        for _ in range(3):
            device.write(0, [1])
            await asyncio.sleep(10.0)
            safety = SafetySettings(endpoint=server.endpoint, relay_timeout_s=0.3)
            driver = await SafetyDriver.open(safety)
            await driver.reset_watchdog_relay()
            assert driver.status.relay_closed
            await driver.close()
        await server.close()

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("code", [5, 6, 10, 11])
def test_the_laser_enable_output_drops_as_soon_as_a_gateway_lets_the_word_through(code):
    from simulators.safety.config import SafetyConfig

    async def main():
        config = SafetyConfig(watchdog_relay=True, laser_enable=True)
        async with safety_driven(config, laser_enable=True, relay_timeout_s=5.0) as (
            driver, device, _,
        ):
            await driver.reset_watchdog_relay()
            driver.request_laser_enable(True)
            await driver.wait_for_laser_enable(True)
            device.reply_with_exception(code)
            driver.request_laser_enable(False)
            await asyncio.sleep(0.9)
            device.reply_with_exception(None)
            freed_s = now()
            await driver.wait_for_laser_enable(False)
            return now() - freed_s

    assert virtual_time.run_in_virtual_time(main()) <= 0.15


def test_a_gateway_that_does_not_reach_the_safety_device_is_named():
    async def main():
        async with safety_driven() as (driver, device, _):
            ears = SafetyEars()
            driver.callbacks = ears
            device.reply_with_exception(11)
            await asyncio.sleep(1.0)
            return ears.faults

    ((_, reason),) = virtual_time.run_in_virtual_time(main())
    assert "its gateway got no answer from it (Modbus exception 11)" in reason
