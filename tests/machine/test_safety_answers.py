"""Answers that prove nothing: silence, frozen, old, doubled or mangled ones close nothing."""

from __future__ import annotations

import asyncio
import random

import pytest

from firmware_protocol.safety_io import SIO_MAP, SafetyStatusBits
from lmctl.config.machine import SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.safety.driver import SafetyDriver
from simulators import virtual_time
from simulators.faults.link_tap import LinkTap
from simulators.safety.device import SimulatedSafetyDevice
from tests.machine.safety_cell import PERIOD_S, RELAY, Replayed, driven, now, served, wires


@wires
def test_silence_ages_the_facts_and_is_reported_after_three_periods_once(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            await asyncio.sleep(0.55)
            device.set_silent()
            last_s = now() - driver.status_age_s
            await asyncio.sleep(2.0)
            ((reported_s, reason),) = ears.faults
            assert reason.startswith("no answer for 0.3 s: ")
            assert "no byte came back" in reason
            assert reported_s - last_s == pytest.approx(0.3)
            assert driver.status_age_s == pytest.approx(now() - last_s)
            assert "safety device: no answer" in driver.fault.what
            device.set_silent(False)
            await asyncio.sleep(1.0)
            assert driver.status_age_s <= PERIOD_S + 0.001
            assert driver.fault is None
            device.set_silent()
            await asyncio.sleep(1.0)
            assert len(ears.faults) == 2

    virtual_time.run_in_virtual_time(main())


@wires
def test_one_lost_answer_is_no_silence(wire):
    async def main():
        edge = LinkTap()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            await driver.reset_watchdog_relay()
            for _ in range(20):
                await asyncio.sleep(0.5 + 0.01)
                lose_one(edge)
            await asyncio.sleep(0.5)
            assert ears.faults == []
            assert device.relay_opened_s == []

    def lose_one(edge):
        def lost(data, deliver):
            edge.remove_filter("to_host", lost)

        edge.add_filter("to_host", lost)

    virtual_time.run_in_virtual_time(main())


def test_a_frozen_answer_is_no_answer():
    async def main():
        async with driven() as (driver, device, ears):
            opened_s = now()
            await asyncio.sleep(0.55)
            device.set_frozen()
            await asyncio.sleep(1.0)
            ((reported_s, reason),) = ears.faults
            assert reason == "it answers, but with the same data for 0.3 s"
            # the answer just before it froze, and the first frozen one tells what it told
            assert 0.75 <= reported_s - opened_s <= 0.95
            assert driver.status_age_s > 0.9
            device.set_frozen(False)
            await asyncio.sleep(0.11)
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run_in_virtual_time(main())


def replayed(old_words, act):
    async def main():
        device = Replayed(RELAY, now)
        async with driven(device=device) as (driver, _, ears):
            await asyncio.sleep(0.35)
            device.old = old_words(device)
            await act(driver, device, ears)

    virtual_time.run_in_virtual_time(main())


def test_an_answer_from_a_buffer_on_the_way_is_no_answer():
    async def act(driver, device, ears):
        before = driver.status
        device.set_door_open()
        await asyncio.sleep(1.0)
        assert driver.status is before
        assert driver.status_age_s > 0.9
        ((_, reason),) = ears.faults
        assert reason == "it does not repeat the heartbeat for 0.3 s"

    replayed(lambda device: device.read_input(0, 21), act)


def test_zeros_open_everything_at_once_and_are_no_answer():
    async def act(driver, device, ears):
        ears.statuses.clear()
        await asyncio.sleep(0.11)
        (status,) = ears.statuses
        assert len(status.open_inputs) == 10
        assert status.estop_closed is False
        assert status.relay_closed is False
        assert driver.status is status
        assert driver.status_age_s > 0.1
        await asyncio.sleep(1.0)
        assert len(ears.statuses) == 1
        device.old = None
        await asyncio.sleep(0.11)
        assert driver.status.open_inputs == ()

    replayed(lambda device: [0] * 21, act)


def test_an_old_answer_closes_nothing():
    async def act(driver, device, ears):
        old, device.old = device.old, None
        device.set_door_open()
        await asyncio.sleep(0.11)
        assert driver.status.door_closed is False
        device.set_door_open(False)
        device.old = old
        await asyncio.sleep(0.11)
        assert driver.status.door_closed is False

    replayed(lambda device: device.read_input(0, 21), act)


def mangled(kind: str, seed: int):
    """A filter of replies; whatever it does, no reply of it is whole and in time."""
    chance = random.Random(seed)
    loop = asyncio.get_running_loop()

    def act(data, deliver):
        if kind == "garbage":
            deliver(chance.randbytes(len(data)))
        elif kind == "cut":
            deliver(data[: chance.randrange(1, len(data))])
        elif kind == "late":
            loop.call_later(chance.uniform(0.11, 0.35), deliver, data)
        elif kind == "noise":
            deliver(chance.randbytes(chance.randrange(1, 300)))

    return act


@wires
@pytest.mark.parametrize("kind", ["garbage", "cut", "late", "noise"])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_no_whole_answer_in_time_is_silence_and_ends(wire, kind, seed):
    async def main():
        edge = LinkTap()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            await asyncio.sleep(0.55)
            before = driver.status
            bad = mangled(kind, seed)
            edge.add_filter("to_host", bad)
            device.set_oxygen(77.0)
            await asyncio.sleep(2.0)
            assert len(ears.faults) == 1
            assert driver.status_age_s > 1.9
            assert driver.status.oxygen_ppm == before.oxygen_ppm
            edge.remove_filter("to_host", bad)
            await asyncio.sleep(2.5)
            assert driver.status_age_s <= PERIOD_S + 0.001
            assert driver.status.oxygen_ppm == 77.0
            assert len(ears.faults) == 1

    virtual_time.run_in_virtual_time(main())


@wires
def test_doubled_answers_do_no_harm(wire):
    async def main():
        edge = LinkTap()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            def twice(data, deliver):
                deliver(data)
                deliver(data)

            edge.add_filter("to_host", twice)
            for number in range(50):
                device.set_door_open(number % 2 == 0)
                await asyncio.sleep(0.11)
                assert driver.status.door_closed is (number % 2 == 1)
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_doubled_answers_that_come_late_open_and_close_nothing_wrongly():
    async def main():
        edge = LinkTap()
        async with driven(wire="rtu", edge=edge) as (driver, device, _):
            loop = asyncio.get_running_loop()

            def again_later(data, deliver):
                deliver(data)
                loop.call_later(0.1, deliver, data)  # as the next request is under way

            edge.add_filter("to_host", again_later)
            await asyncio.sleep(0.55)
            device.set_door_open()
            await asyncio.sleep(0.5)
            assert driver.status.door_closed is False
            edge.remove_filter("to_host", again_later)
            device.set_door_open(False)
            await asyncio.sleep(1.0)
            assert driver.status.door_closed is True
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run_in_virtual_time(main())


@wires
def test_what_opens_and_closes_between_two_answers_is_reported(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            await driver.reset_watchdog_relay()
            await asyncio.sleep(0.52)
            device.set_door_open()
            device.set_door_open(False)
            await asyncio.sleep(0.2)
            ((_, reason),) = ears.faults
            assert reason == ("something opened and closed again between two answers; "
                              "what opened first: the door is open")
            assert all(status.door_closed for status in ears.statuses)
            await asyncio.sleep(2.0)
            assert len(ears.faults) == 1

    virtual_time.run_in_virtual_time(main())


def test_what_is_seen_open_is_not_reported_as_missed_too_but_another_is():
    async def main():
        async with driven() as (driver, device, ears):
            await driver.reset_watchdog_relay()
            await asyncio.sleep(0.52)
            device.set_door_open()
            device.set_estop_open()
            await asyncio.sleep(0.5)
            device.set_door_open(False)
            await asyncio.sleep(0.5)
            device.set_door_open()
            await asyncio.sleep(0.5)
            assert ears.faults == []
            device.set_analyser_invalid()
            device.set_analyser_invalid(False)
            await asyncio.sleep(0.2)
            assert len(ears.faults) == 1

    virtual_time.run_in_virtual_time(main())


def test_an_input_that_the_cell_does_not_have_may_open_and_close():
    async def main():
        async with driven(fitted=("estop", "door")) as (driver, device, ears):
            await driver.reset_watchdog_relay()
            await asyncio.sleep(0.52)
            device.set_analyser_invalid()
            device.set_analyser_invalid(False)
            await asyncio.sleep(1.0)
            assert ears.faults == []

    virtual_time.run_in_virtual_time(main())


def test_a_device_whose_self_test_fails_closes_nothing():
    class Doubtful(SimulatedSafetyDevice):
        well = True

        def read_input(self, address, count):
            words = super().read_input(address, count)
            status = SIO_MAP.wire_address("STATUS") - address
            if not self.well and 0 <= status < count:
                words[status] &= ~SafetyStatusBits.SELF_TEST_OK.value
            return words

    async def main():
        device = Doubtful(RELAY, now)
        async with driven(device=device) as (driver, _, ears):
            await asyncio.sleep(0.55)
            device.well = False
            await asyncio.sleep(1.0)
            ((_, reason),) = ears.faults
            assert reason.startswith("its self-test failed for 0.")
            assert driver.status_age_s > 0.9
        server = await served(device)
        with pytest.raises(MachineError, match="self-test failed"):
            await SafetyDriver.open(SafetySettings(endpoint=server.endpoint))
        await server.close()

    virtual_time.run_in_virtual_time(main())
