"""The laser-enable output: when it is told on, when it drops, and what a new host finds."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmctl.config.machine import SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.manual.inspect_modbus import inspect_safety
from lmctl.machine.safety.driver import SafetyDriver
from lmctl.machine.safety.laser_enable import LaserEnable
from simulators import virtual_time
from simulators.faults.link_tap import drop_chunk
from simulators.modbus_server import serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from simulators.safety.laser_output import LaserEnableOutput
from tests.machine.laser_cell import FITTED, LASER_ENABLE, driven, now, played, wires


def test_on_is_reported_only_after_off_was_read_back():
    output = LaserEnable()
    output.request(True)
    assert output.output_word() == 0
    assert output.on_read_back(False, 0.0) is None
    assert output.has_unsent_change
    assert output.output_word() == 1
    assert not output.is_confirmed(True)
    assert output.on_read_back(True, 0.0) is None
    assert output.is_confirmed(True)
    assert not output.is_pending
    output.request(False)
    assert (output.has_unsent_change, output.is_pending, output.output_word()) == (True, True, 0)
    output.request(True)  # before the 0 is known to have come
    assert output.output_word() == 0


@given(st.lists(st.sampled_from(["on", "off", "beat", "lost", "trip", "restart"])))
def test_whatever_happens_the_output_is_on_only_since_a_demand_that_was_not_taken_back(acts):
    host, device = LaserEnable(), LaserEnableOutput()
    may_be_on, now_s = False, 0.0  # since the last demand: not taken back, not tripped
    for act in acts:
        now_s += 1.0
        if act in ("on", "off"):
            host.request(act == "on")
            may_be_on = host.wanted
        elif act in ("trip", "restart"):
            may_be_on &= act == "trip" and not device.is_on
            (device.drop if act == "trip" else device.power_cycle)()
            if act == "restart":
                host.on_restart()  # as its uptime tells, before the next word
        else:
            device.command(host.output_word(), may_come_on=True)
            if act == "beat":
                host.on_read_back(device.is_on, now_s)
            assert may_be_on or not device.is_on


@wires
def test_it_comes_on_and_drops_at_once_in_requests_of_their_own(wire):
    async def act(cell):
        assert cell.driver.status.laser_enabled is False
        await asyncio.sleep(0.05)
        began_s = now()
        await cell.on()
        assert (cell.is_on, cell.driver.status.laser_enabled) == (True, True)
        await asyncio.sleep(1.0)
        assert cell.is_on
        dropped_s = now()
        cell.driver.request_laser_enable(False)
        await cell.driver.wait_for_laser_enable(False)
        assert (cell.is_on, cell.driver.status.laser_enabled) == (False, False)
        assert now() == dropped_s
        assert cell.words[0] == (began_s, 1)
        assert [at_s for at_s, word in cell.words if word == 0] == [dropped_s]
        # in every request of the beat, and the beat goes on
        assert len(cell.words) == pytest.approx(12, abs=1)
        await asyncio.sleep(1.0)
        assert len(cell.words) == pytest.approx(22, abs=1)
        assert (cell.faults, cell.device.relay_opened_s) == ([], [])

    played(act, wire)


@wires
def test_on_and_off_and_on_in_one_breath_is_an_edge(wire):
    async def act(cell):
        await cell.on()
        cell.words.clear()
        cell.driver.request_laser_enable(False)
        cell.driver.request_laser_enable(True)
        cell.driver.request_laser_enable(False)
        cell.driver.request_laser_enable(True)
        await cell.driver.wait_for_laser_enable(True)
        assert cell.is_on
        cell.driver.request_laser_enable(False)
        cell.driver.request_laser_enable(True)
        cell.driver.request_laser_enable(False)
        await asyncio.sleep(0.5)
        assert not cell.is_on
        assert cell.faults == []

    played(act, wire)


@wires
def test_it_drops_with_the_watchdog_relay_and_heartbeats_do_not_bring_it_back(wire):
    async def act(cell):
        await cell.on()
        cell.edge.add_filter("to_device", drop_chunk)
        await asyncio.sleep(0.5)
        cell.device.advance_to_now()
        assert not cell.is_on
        cell.faults.clear()
        cell.edge.remove_filter("to_device", drop_chunk)
        await asyncio.sleep(2.0)
        assert not cell.is_on
        (fault,) = cell.faults
        assert fault[0] == "its laser-enable output is off and was commanded to be on"
        assert "drops with the watchdog relay, which is open" in fault[1]
        await cell.driver.reset_watchdog_relay()
        await asyncio.sleep(1.0)
        assert (cell.is_on, cell.driver.status.relay_closed) == (False, True)
        await cell.on()
        assert cell.is_on

    played(act, wire)


@wires
def test_closing_drops_it_before_the_watchdog_would(wire):
    async def main():
        async with driven(wire) as cell:
            await cell.on()
        assert not cell.is_on
        assert not cell.device.is_relay_open

    virtual_time.run_in_virtual_time(main())


def test_without_an_output_nothing_is_written_and_nothing_awaited():
    async def act(cell):
        cell.driver.request_laser_enable(True)
        await cell.driver.wait_for_laser_enable(True)
        await asyncio.sleep(1.0)
        assert (cell.words, cell.faults) == ([], [])
        assert cell.driver.status.laser_enabled is None

    played(act, config=SafetyConfig(watchdog_relay=True), laser_enable=False)


def test_a_device_without_one_is_refused():
    async def main():
        server = await serve_tcp(SimulatedSafetyDevice(SafetyConfig(watchdog_relay=True), now))
        safety = SafetySettings(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        with pytest.raises(MachineError, match="has no laser-enable output") as caught:
            await SafetyDriver.open(safety)
        assert caught.value.where[1] == "the profile says laser_enable = true"
        await server.close()

    virtual_time.run_in_virtual_time(main())


def test_a_look_shows_it_and_leaves_it():
    async def main():
        device = SimulatedSafetyDevice(FITTED, now)
        server = await serve_tcp(device)
        safety = SafetySettings(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        assert (await inspect_safety(safety)).laser_enabled is False
        device.write(0, [1, 60_000, 0xC105])
        device.write(LASER_ENABLE, [1])
        assert (await inspect_safety(safety)).laser_enabled is True
        assert not device.is_laser_enable_off
        await server.close()

    virtual_time.run_in_virtual_time(main())


def test_a_new_host_finds_it_off_whatever_the_last_one_left():
    async def main():
        device = SimulatedSafetyDevice(FITTED, now)
        device.write(0, [7, 60_000, 0xC105])
        device.write(LASER_ENABLE, [1])
        server = await serve_tcp(device)
        safety = SafetySettings(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        driver = await SafetyDriver.open(safety)
        assert device.is_laser_enable_off
        assert driver.status.laser_enabled is False
        await driver.close()
        await server.close()

    virtual_time.run_in_virtual_time(main())
