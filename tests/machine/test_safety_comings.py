"""Devices that restart, refuse, are lost and come again, or cannot be opened."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.config.machine import SafetySettings
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.modbus_server import serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.safety_cell import PERIOD_S, RELAY, Ears, Replayed, driven, now, wires


@wires
def test_a_restart_is_seen_and_the_relays_time_set_again(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            await driver.reset_watchdog_relay()
            await asyncio.sleep(5.0)
            device.restart()
            await asyncio.sleep(0.11)
            assert [reason for _, reason in ears.faults] == ["the device restarted"]
            assert driver.status.relay_closed is False
            assert device.read_holding(1, 1) == [300]
            await driver.reset_watchdog_relay()
            assert driver.status.relay_closed is True

    virtual_time.run_in_virtual_time(main())


def test_exceptions_are_reported_in_words():
    async def main():
        async with driven() as (driver, device, ears):
            device.reply_with_exception(6)
            await asyncio.sleep(1.0)
            ((_, reason),) = ears.faults
            assert reason.startswith("no answer for 0.3 s: it is busy (Modbus exception 06), ")
            device.reply_with_exception(None)
            await asyncio.sleep(0.11)
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run_in_virtual_time(main())


def test_a_device_that_still_starts_up_is_waited_for():
    async def main():
        device = SimulatedSafetyDevice(SafetyConfig(boot_s=5.0), now)
        server = await serve_tcp(device)
        started_s = now()
        driver = await SafetyDriver.open(SafetySettings(endpoint=server.endpoint))
        assert 4.9 <= now() - started_s <= 5.2
        await driver.close()
        await server.close()
        device = SimulatedSafetyDevice(SafetyConfig(boot_s=1e6), now)
        server = await serve_tcp(device)
        with pytest.raises(MachineError, match=r"it is busy \(Modbus exception 06\)"):
            await SafetyDriver.open(SafetySettings(endpoint=server.endpoint))
        await server.close()

    virtual_time.run_in_virtual_time(main())


def test_a_lost_connection_is_made_again():
    async def main():
        device = SimulatedSafetyDevice(RELAY, now)
        server = await serve_tcp(device)
        driver = await SafetyDriver.open(SafetySettings(endpoint=server.endpoint))
        driver.callbacks = ears = Ears()
        await asyncio.sleep(0.5)
        server.disconnect_hosts()
        await asyncio.sleep(3.0)
        assert driver.status_age_s <= PERIOD_S + 0.001
        server.go_offline()
        await asyncio.sleep(3.0)
        assert driver.status_age_s > 2.5
        assert ears.faults[-1][1] == "no answer for 0.3 s: there is no connection"
        await driver.close()

    virtual_time.run_in_virtual_time(main())


def test_what_cannot_be_opened():
    async def refused(words: str, device=None, within_s: float = 1.0, **settings):
        device = device or SimulatedSafetyDevice(SafetyConfig(), now)
        server = await serve_tcp(device)
        safety = SafetySettings(**{"endpoint": server.endpoint, **settings})
        started_s = now()
        with pytest.raises(MachineError, match=words) as caught:
            await SafetyDriver.open(safety)
        assert now() - started_s <= within_s
        assert caught.value.hint
        await server.close()
        return caught.value

    async def main():
        await refused("has no watchdog relay", relay_timeout_s=1.0)
        await refused("does not answer", device_id=9)
        silent = SimulatedSafetyDevice(SafetyConfig(), now)
        silent.set_silent()
        await refused("safety device: it does not answer", silent)
        other = Replayed(SafetyConfig(), now)
        other.old = [0x504D, 0x0101, *[0] * 19]
        error = await refused("the device for safety inputs is none", other)
        assert "its DEVICE_ID is 20557, not 21321" in error.where[1]
        other.old = [0x5349, 0x0200, *[0] * 19]
        await refused("speaks another register map", other)
        cached = Replayed(SafetyConfig(), now)
        cached.old = cached.read_input(0, 21)
        # Its uptime stands still: it is watched for a while.
        await refused("does not repeat the heartbeat", cached, within_s=2.0)
        closed = "modbus-tcp://127.0.0.1:1"
        with pytest.raises(MachineError, match="safety device: nothing answers at"):
            await SafetyDriver.open(SafetySettings(endpoint=closed))
        with pytest.raises(ConfigError, match="not an endpoint"):
            await SafetyDriver.open(SafetySettings(endpoint="tcp://127.0.0.1:1"))

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize(
    ("line", "period_s", "hint"),
    [
        ("", 0.1, "to 0.19"),  # 19,200 baud, 8E1
        ("?baud=19200&parity=N", 0.15, "to 0.17"),
        ("?baud=115200&parity=N", 0.02, "to 0.03"),
    ],
)
def test_a_line_too_slow_for_the_period_is_refused(line, period_s, hint):
    async def main():
        with pytest.raises(ConfigError, match="cannot be read every") as caught:
            await SafetyDriver.open(
                SafetySettings(endpoint=f"modbus-rtu:///dev/ttyS99{line}", period_s=period_s)
            )
        assert hint in caught.value.hint

    virtual_time.run_in_virtual_time(main())


def test_closing_ends_even_with_a_dead_device():
    async def main():
        async with driven() as (driver, device, _):
            device.set_silent()
            await asyncio.sleep(1.0)
            started_s = now()
            await driver.close()
            assert now() - started_s < 0.5

    virtual_time.run_in_virtual_time(main())
