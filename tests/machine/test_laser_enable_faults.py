"""A laser-enable contact that does not follow, drops by itself, or cannot be heard."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import MachineError
from lmctl.machine.safety.laser_enable import CONTACT_SETTLE_S, LaserEnable
from simulators.faults.link_tap import drop_chunk
from tests.machine.laser_cell import now, played, wires

PERIOD_S = 0.1


@pytest.mark.parametrize("on", [True, False])
def test_a_contact_has_its_time_and_then_is_at_fault(on):
    output = LaserEnable()
    output.output_word()
    output.on_read_back(False, 0.0)
    output.request(True)
    output.output_word()
    if not on:
        output.on_read_back(True, 0.0)
        output.request(False)
        output.output_word()
    assert output.on_read_back(not on, 1.0) is None
    assert output.on_read_back(not on, 1.0 + 0.9 * CONTACT_SETTLE_S) is None
    assert output.fault_against(on) is None
    fault = output.on_read_back(not on, 1.0 + CONTACT_SETTLE_S)
    seen, commanded = ("off", "on") if on else ("on", "off")
    assert fault.reason == f"its laser-enable output is {seen} and was commanded to be {commanded}"
    assert fault.hint
    assert output.fault_against(on) is fault
    assert output.on_read_back(not on, 9.0) is None  # commanded once
    assert (output.wanted, output.is_pending) == (False, False)
    output.request(True)  # no demand while it is at fault
    assert not output.wanted


def test_what_was_on_and_is_off_is_at_fault_at_once_and_stays_off():
    output = LaserEnable()
    output.output_word()
    output.on_read_back(False, 0.0)
    output.request(True)
    output.output_word()
    output.on_read_back(True, 0.0)
    assert output.on_read_back(False, 0.01).reason.startswith("its laser-enable output is off")
    assert output.fault_against(True) is not None
    assert output.fault_against(False) is None
    assert output.output_word() == 0
    assert output.on_read_back(False, 0.02) is None
    assert not output.has_unsent_change
    output.request(True)
    assert output.output_word() == 1


@wires
def test_a_word_that_is_lost_is_reported_again(wire):
    async def act(cell):
        await cell.on()
        for direction in ("to_device", "to_host"):
            for on in (False, True):
                cell.edge.add_filter(direction, drop_chunk)
                asyncio.get_running_loop().call_later(
                    0.02, cell.edge.remove_filter, direction, drop_chunk)
                cell.driver.request_laser_enable(on)
                began_s = now()
                await cell.driver.wait_for_laser_enable(on)
                assert cell.is_on is on
                # an answer's patience, and on a line the silence after it
                assert now() - began_s <= PERIOD_S + 0.03
        assert (cell.faults, cell.device.relay_opened_s) == ([], [])

    played(act, wire)


@wires
def test_it_stays_off_after_the_device_restarted(wire):
    async def act(cell):
        await cell.on()
        await asyncio.sleep(3.0)
        cell.device.restart()
        assert not cell.is_on
        await asyncio.sleep(1.0)
        await cell.driver.reset_watchdog_relay()
        await asyncio.sleep(1.0)
        assert not cell.is_on
        assert [reason for reason, _ in cell.faults] == ["the device restarted"]
        await cell.on()

    played(act, wire)


@wires
def test_one_that_does_not_drop_is_reported_and_does_not_count_as_dropped(wire):
    async def act(cell):
        await cell.on()
        cell.device.set_output_stuck()
        began_s = now()
        cell.driver.request_laser_enable(False)
        match = "output is on and was commanded to be off"
        with pytest.raises(MachineError, match=match) as caught:
            await cell.driver.wait_for_laser_enable(False)
        assert now() - began_s <= 2 * CONTACT_SETTLE_S + 1e-9
        assert "check the laser-enable output" in caught.value.hint
        assert [reason for reason, _ in cell.faults] == [
            "its laser-enable output is on and was commanded to be off"
        ]
        assert cell.driver.status.laser_enabled is True
        cell.driver.request_laser_enable(True)
        with pytest.raises(MachineError, match="is on and was commanded to be off"):
            await cell.driver.wait_for_laser_enable(True)
        await asyncio.sleep(1.0)
        assert len(cell.faults) == 1
        cell.device.set_output_stuck(False)
        await asyncio.sleep(1.0)
        assert not cell.is_on  # the demand while it was stuck is none now
        await cell.on()

    played(act, wire)


@wires
def test_one_that_does_not_come_is_reported_and_not_awaited(wire):
    async def act(cell):
        cell.device.set_output_stuck()
        cell.driver.request_laser_enable(True)
        with pytest.raises(MachineError, match="output is off and was commanded to be on"):
            await cell.driver.wait_for_laser_enable(True)
        assert len(cell.faults) == 1
        cell.device.set_output_stuck(False)
        await asyncio.sleep(1.0)
        assert not cell.is_on
        await cell.on()

    played(act, wire)


def test_one_that_drops_by_itself_is_reported_at_the_next_beat():
    async def act(cell):
        await cell.on()
        await asyncio.sleep(1.0)
        cell.device.drop_output()
        await asyncio.sleep(PERIOD_S + 0.001)
        assert [reason for reason, _ in cell.faults] == [
            "its laser-enable output is off and was commanded to be on"
        ]
        await cell.driver.wait_for_laser_enable(False)
        await cell.on()

    played(act)


@pytest.mark.parametrize("on", [True, False])
def test_a_device_that_cannot_be_reached_confirms_nothing(on):
    async def act(cell):
        if not on:
            await cell.on()
        cell.device.set_frozen()
        cell.driver.request_laser_enable(on)
        with pytest.raises(MachineError, match="come on within" if on else "drop within"):
            await cell.driver.wait_for_laser_enable(on)
        await asyncio.sleep(0.001)
        assert not cell.is_on
        cell.device.set_frozen(False)
        await asyncio.sleep(1.0)
        assert not cell.is_on
        assert cell.driver.status.laser_enabled is False

    played(act)


def test_answers_that_prove_nothing_do_not_say_that_the_beam_is_off():
    async def act(cell):
        await cell.on()
        read = cell.device.read_input
        cell.device.read_input = lambda address, count: [0] * count
        await asyncio.sleep(PERIOD_S + 0.001)
        assert cell.driver.status.door_closed is False
        assert cell.driver.status.laser_enabled is True
        cell.device.read_input = read

    played(act)
