"""What the safety device says becomes facts with an age; heartbeats keep its relay closed."""

from __future__ import annotations

import asyncio
import math

import pytest

from firmware_protocol.safety_io import (
    CYCLIC_BLOCK,
    MIRROR_ADDRESS,
    RELAY_FIRST_OUT_CODE,
    SafetyInputBits,
)
from lmctl.errors import MachineError
from lmctl.machine.safety.status import INPUT_BITS
from simulators import virtual_time
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.safety_cell import PERIOD_S, RELAY, driven, now, wires


@wires
def test_facts_come_every_period_with_their_age(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            assert driver.identity.map_version == (1, 1)
            assert driver.status is not None
            await asyncio.sleep(1.05)
            assert len(ears.statuses) == 10
            assert driver.status_age_s == pytest.approx(0.05)
            device.set_door_open()
            device.set_shield_gas(12.5)
            await asyncio.sleep(0.11)
            status = driver.status
            assert status is ears.statuses[-1]
            assert (status.door_closed, status.estop_closed) == (False, True)
            assert [one.text for one in status.open_inputs] == ["the door is open"]
            assert (status.first_out.code, status.trip_count) == (102, 1)
            assert (status.shield_gas_L_min, status.chiller_C) == (12.5, 22.0)
            assert (status.chiller_L_min, status.oxygen_ppm) == (10.0, 20.0)
            assert status.extraction_Pa == 800
            assert status.self_test_ok
            assert ears.faults == []
            assert driver.fault is None

    virtual_time.run_in_virtual_time(main())


FACTS = {
    "estop": "estop_closed", "door": "door_closed", "laser_ready": "laser_ready",
    "laser_fault": "laser_healthy", "back_reflection": "no_back_reflection",
    "chiller": "chiller_ok", "shield_gas": "shield_gas_ok", "extraction": "extraction_ok",
    "oxygen": "oxygen_valid", "key": "key_on",
}


@pytest.mark.parametrize("name", FACTS)
def test_each_input_has_its_fact_and_one_that_is_not_fitted_has_none(name):
    async def main():
        device = SimulatedSafetyDevice(SafetyConfig(), now)
        async with driven(SafetyConfig(), device=device) as (driver, _, _):
            device.set_input(INPUT_BITS[name], False)
            await asyncio.sleep(0.11)
            reported = {other: getattr(driver.status, fact) for other, fact in FACTS.items()}
            assert reported == {other: other != name for other in FACTS}
        others = tuple(other for other in FACTS if other != name)
        async with driven(SafetyConfig(), device=device, fitted=others) as (driver, _, _):
            assert getattr(driver.status, FACTS[name]) is None
            assert driver.status.open_inputs == ()

    virtual_time.run_in_virtual_time(main())


def test_what_the_device_cannot_show_is_none():
    async def main():
        async with driven() as (driver, device, _):
            device.set_shield_gas(None)
            device.set_chiller(None, None)
            device.set_extraction(None)
            device.set_analyser_invalid()
            await asyncio.sleep(0.11)
            status = driver.status
            values = (status.shield_gas_L_min, status.chiller_C, status.chiller_L_min,
                      status.extraction_Pa, status.oxygen_ppm)
            assert values == (None,) * 5
            assert status.oxygen_valid is False

    virtual_time.run_in_virtual_time(main())


@wires
def test_heartbeats_keep_the_relay_and_their_end_opens_it(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            assert driver.status.relay_closed is False
            await driver.reset_watchdog_relay()
            assert driver.status.relay_closed is True
            await asyncio.sleep(60.0)
            device.advance_to_now()
            assert device.relay_opened_s == []
            assert ears.faults == []
            closed_s = now()
        await asyncio.sleep(1.0)
        device.advance_to_now()
        (opened_s,) = device.relay_opened_s
        assert closed_s < opened_s + PERIOD_S <= closed_s + 0.3 + PERIOD_S

    virtual_time.run_in_virtual_time(main())


def test_without_a_relay_a_reset_forgets_what_was_first():
    async def main():
        async with driven(SafetyConfig()) as (driver, device, _):
            assert driver.status.relay_closed is None
            device.set_door_open()
            device.set_door_open(False)
            await asyncio.sleep(0.11)
            assert driver.status.first_out.code == 102
            await driver.reset_watchdog_relay()
            assert driver.status.first_out is None

    virtual_time.run_in_virtual_time(main())


def test_a_relay_that_does_not_close_is_reported():
    async def main():
        async with driven() as (driver, device, _):
            device.write_before = device.write

            def stuck(address, words):
                device.write_before(address, words)
                device.relay_closed = False

            device.write = stuck
            started_s = now()
            with pytest.raises(MachineError, match="relay does not close within"):
                await driver.reset_watchdog_relay()
            assert now() - started_s < 2.0
            device.reply_with_exception(4)
            with pytest.raises(MachineError, match="does not reset its relay: it cannot"):
                await driver.reset_watchdog_relay()

    virtual_time.run_in_virtual_time(main())


@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.5, 1.0])
def test_every_period(period_s):
    async def main():
        settings = {"period_s": period_s, "relay_timeout_s": 3 * period_s}
        async with driven(**settings) as (driver, device, ears):
            await driver.reset_watchdog_relay()
            await asyncio.sleep(20 * period_s)
            assert 19 <= len(ears.statuses) <= 22
            device.set_silent()
            last_s = now() - driver.status_age_s
            await asyncio.sleep(10 * period_s)
            ((reported_s, _),) = ears.faults
            assert reported_s - last_s == pytest.approx(3 * period_s)
            device.set_silent(False)
            device.advance_to_now()
            assert len(device.relay_opened_s) == 1
            assert device.card.first_out == RELAY_FIRST_OUT_CODE

    virtual_time.run_in_virtual_time(main())


def test_the_whole_exchange_is_one_request():
    async def main():
        device = SimulatedSafetyDevice(RELAY, now)
        asked = []
        read, write = device.read_holding, device.write
        device.read_holding = lambda *args: (asked.append(("read", *args)), read(*args))[1]
        device.write = lambda *args: (asked.append(("write", *args)), write(*args))[1]
        async with driven(device=device) as (_, _, _):
            asked.clear()
            await asyncio.sleep(0.11)
        kinds = [(kind, address) for kind, address, _ in asked]
        assert kinds == [("write", 0), ("read", MIRROR_ADDRESS + CYCLIC_BLOCK.address)]
        assert device.read_holding(0, 2)[1] == 300
        assert SafetyInputBits.DOOR_CLOSED in device.card.good
        assert math.isinf(device.next_due_s())

    virtual_time.run_in_virtual_time(main())
