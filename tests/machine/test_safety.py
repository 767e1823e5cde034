"""The safety driver whole, against the simulated device on the same wires, in virtual time."""

import asyncio
import math
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from firmware_protocol.safety_io import CYCLE_BLOCK, MIRROR, RELAY_CODE, Inputs
from lmctl.config.machine import Safety
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.safety import SafetyDriver
from lmctl.machine.safety_status import BITS, SafetyListener, SafetyStatus
from simulators import virtual_time
from simulators.faults.edge import Edge
from simulators.modbus_server import ModbusServer, serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SafetyDevice

PERIOD_S = 0.1
RELAY = SafetyConfig(watchdog_relay=True)


class Ears(SafetyListener):
    def __init__(self) -> None:
        self.statuses: list[SafetyStatus] = []
        self.faults: list[tuple[float, str]] = []
        super().__init__(
            self.statuses.append, lambda reason, hint: self.faults.append((now(), reason))
        )


def now() -> float:
    return asyncio.get_running_loop().time()


async def served(device, wire: str = "tcp", edge: Edge | None = None) -> ModbusServer:
    if wire == "tcp":
        return await serve_tcp(device, edge=edge)
    return await serve_pty(device, edge, baud=115_200)


@asynccontextmanager
async def driven(
    config: SafetyConfig = RELAY, wire: str = "tcp", edge: Edge | None = None,
    device: SafetyDevice | None = None, **settings,
) -> AsyncIterator[tuple[SafetyDriver, SafetyDevice, Ears]]:
    device = device or SafetyDevice(config, asyncio.get_running_loop().time)
    server = await served(device, wire, edge)
    if config.watchdog_relay:
        settings.setdefault("relay_timeout_s", 0.3)
    driver = await SafetyDriver.open(Safety(endpoint=server.endpoint, **settings))
    driver.listener = ears = Ears()
    try:
        yield driver, device, ears
    finally:
        await driver.close()
        await server.close()


wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


@wires
def test_facts_come_every_period_with_their_age(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            assert driver.identity.map_version == (1, 1)
            assert driver.status is not None
            await asyncio.sleep(1.05)
            assert len(ears.statuses) == 10
            assert driver.status_age_s == pytest.approx(0.05)
            device.open_door()
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

    virtual_time.run(main())


FACTS = {
    "estop": "estop_closed", "door": "door_closed", "laser_ready": "laser_ready",
    "laser_fault": "laser_healthy", "back_reflection": "no_back_reflection",
    "chiller": "chiller_ok", "shield_gas": "shield_gas_ok", "extraction": "extraction_ok",
    "oxygen": "oxygen_valid", "key": "key_on",
}


@pytest.mark.parametrize("name", FACTS)
def test_each_input_has_its_fact_and_one_that_is_not_fitted_has_none(name):
    async def main():
        device = SafetyDevice(SafetyConfig(), now)
        async with driven(SafetyConfig(), device=device) as (driver, _, _):
            device.set_input(BITS[name], False)
            await asyncio.sleep(0.11)
            told = {other: getattr(driver.status, fact) for other, fact in FACTS.items()}
            assert told == {other: other != name for other in FACTS}
        others = tuple(other for other in FACTS if other != name)
        async with driven(SafetyConfig(), device=device, fitted=others) as (driver, _, _):
            assert getattr(driver.status, FACTS[name]) is None
            assert driver.status.open_inputs == ()

    virtual_time.run(main())


def test_what_the_device_cannot_tell_is_none():
    async def main():
        async with driven() as (driver, device, _):
            device.set_shield_gas(None)
            device.set_chiller(None, None)
            device.set_extraction(None)
            device.invalidate_analyser()
            await asyncio.sleep(0.11)
            status = driver.status
            values = (status.shield_gas_L_min, status.chiller_C, status.chiller_L_min,
                      status.extraction_Pa, status.oxygen_ppm)
            assert values == (None,) * 5
            assert status.oxygen_valid is False

    virtual_time.run(main())


@wires
def test_heartbeats_keep_the_relay_and_their_end_opens_it(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            assert driver.status.relay_closed is False
            await driver.reset_relay()
            assert driver.status.relay_closed is True
            await asyncio.sleep(60.0)
            device.settle()
            assert device.relay_opened_s == []
            assert ears.faults == []
            closed_s = now()
        await asyncio.sleep(1.0)
        device.settle()
        (opened_s,) = device.relay_opened_s
        assert closed_s < opened_s + PERIOD_S <= closed_s + 0.3 + PERIOD_S

    virtual_time.run(main())


def test_without_a_relay_a_reset_forgets_what_was_first():
    async def main():
        async with driven(SafetyConfig()) as (driver, device, _):
            assert driver.status.relay_closed is None
            device.open_door()
            device.open_door(False)
            await asyncio.sleep(0.11)
            assert driver.status.first_out.code == 102
            await driver.reset_relay()
            assert driver.status.first_out is None

    virtual_time.run(main())


def test_a_relay_that_does_not_close_is_told():
    async def main():
        async with driven() as (driver, device, _):
            device.write_before = device.write

            def stuck(address, words):
                device.write_before(address, words)
                device.relay_closed = False

            device.write = stuck
            started_s = now()
            with pytest.raises(MachineError, match="relay does not close within"):
                await driver.reset_relay()
            assert now() - started_s < 2.0
            device.refuse(4)
            with pytest.raises(MachineError, match="does not reset its relay: it cannot"):
                await driver.reset_relay()

    virtual_time.run(main())


@wires
def test_silence_ages_the_facts_and_is_told_after_three_periods_once(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            await asyncio.sleep(0.55)
            device.silence()
            last_s = now() - driver.status_age_s
            await asyncio.sleep(2.0)
            ((told_s, reason),) = ears.faults
            assert reason == "no answer for 0.3 s"
            assert told_s - last_s == pytest.approx(0.3)
            assert driver.status_age_s == pytest.approx(now() - last_s)
            assert "safety device: no answer" in driver.fault.what
            device.silence(False)
            await asyncio.sleep(1.0)
            assert driver.status_age_s <= PERIOD_S + 0.001
            assert driver.fault is None
            device.silence()
            await asyncio.sleep(1.0)
            assert len(ears.faults) == 2

    virtual_time.run(main())


@wires
def test_one_lost_answer_is_no_silence(wire):
    async def main():
        edge = Edge()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            await driver.reset_relay()
            for _ in range(20):
                await asyncio.sleep(0.5 + 0.01)
                lose_one(edge)
            await asyncio.sleep(0.5)
            assert ears.faults == []
            assert device.relay_opened_s == []

    def lose_one(edge):
        def lost(data, deliver):
            edge.take("to_host", lost)

        edge.put("to_host", lost)

    virtual_time.run(main())


def test_a_frozen_answer_is_no_answer():
    async def main():
        async with driven() as (driver, device, ears):
            await asyncio.sleep(0.55)
            device.freeze()
            await asyncio.sleep(1.0)
            ((told_s, reason),) = ears.faults
            assert reason == "it answers, but with the same data for 0.3 s"
            # the answer just before it froze, and the first frozen one tells what it told
            assert 0.75 <= told_s <= 0.95
            assert driver.status_age_s > 0.9
            device.freeze(False)
            await asyncio.sleep(0.11)
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run(main())


class Replayed(SafetyDevice):
    """A device behind a gateway that gives old words for new ones."""

    old: list[int] | None = None

    def read_input(self, address: int, count: int) -> list[int]:
        words = super().read_input(address, count)
        return words if self.old is None else self.old[address : address + count]


def replayed(old_words, act):
    async def main():
        device = Replayed(RELAY, now)
        async with driven(device=device) as (driver, _, ears):
            await asyncio.sleep(0.35)
            device.old = old_words(device)
            await act(driver, device, ears)

    virtual_time.run(main())


def test_an_answer_from_a_buffer_on_the_way_is_no_answer():
    async def act(driver, device, ears):
        before = driver.status
        device.open_door()
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
        device.open_door()
        await asyncio.sleep(0.11)
        assert driver.status.door_closed is False
        device.open_door(False)
        device.old = old
        await asyncio.sleep(0.11)
        assert driver.status.door_closed is False

    replayed(lambda device: device.read_input(0, 21), act)


@wires
def test_a_restart_is_seen_and_the_relays_time_set_again(wire):
    async def main():
        async with driven(wire=wire) as (driver, device, ears):
            await driver.reset_relay()
            await asyncio.sleep(5.0)
            device.restart()
            await asyncio.sleep(0.11)
            assert [reason for _, reason in ears.faults] == ["the device restarted"]
            assert driver.status.relay_closed is False
            assert device.read_holding(1, 1) == [300]
            await driver.reset_relay()
            assert driver.status.relay_closed is True

    virtual_time.run(main())


def test_exceptions_are_told_in_words():
    async def main():
        async with driven() as (driver, device, ears):
            device.refuse(6)
            await asyncio.sleep(1.0)
            ((_, reason),) = ears.faults
            assert "it refuses to answer: it is busy (Modbus exception 06)" in reason
            device.refuse(None)
            await asyncio.sleep(0.11)
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run(main())


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
        edge = Edge()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            await asyncio.sleep(0.55)
            before = driver.status
            bad = mangled(kind, seed)
            edge.put("to_host", bad)
            device.set_oxygen(77.0)
            await asyncio.sleep(2.0)
            assert len(ears.faults) == 1
            assert driver.status_age_s > 1.9
            assert driver.status.oxygen_ppm == before.oxygen_ppm
            edge.take("to_host", bad)
            await asyncio.sleep(2.5)
            assert driver.status_age_s <= PERIOD_S + 0.001
            assert driver.status.oxygen_ppm == 77.0
            assert len(ears.faults) == 1

    virtual_time.run(main())


@wires
def test_doubled_answers_do_no_harm(wire):
    async def main():
        edge = Edge()
        async with driven(wire=wire, edge=edge) as (driver, device, ears):
            def twice(data, deliver):
                deliver(data)
                deliver(data)

            edge.put("to_host", twice)
            for number in range(50):
                device.open_door(number % 2 == 0)
                await asyncio.sleep(0.11)
                assert driver.status.door_closed is (number % 2 == 1)
            assert ears.faults == []

    virtual_time.run(main())


def test_doubled_answers_that_come_late_open_and_close_nothing_wrongly():
    async def main():
        edge = Edge()
        async with driven(wire="rtu", edge=edge) as (driver, device, _):
            loop = asyncio.get_running_loop()

            def again_later(data, deliver):
                deliver(data)
                loop.call_later(0.1, deliver, data)  # as the next request is under way

            edge.put("to_host", again_later)
            await asyncio.sleep(0.55)
            device.open_door()
            await asyncio.sleep(0.5)
            assert driver.status.door_closed is False
            edge.take("to_host", again_later)
            device.open_door(False)
            await asyncio.sleep(1.0)
            assert driver.status.door_closed is True
            assert driver.status_age_s <= PERIOD_S + 0.001

    virtual_time.run(main())


def test_a_lost_connection_is_made_again():
    async def main():
        device = SafetyDevice(RELAY, now)
        server = await serve_tcp(device)
        driver = await SafetyDriver.open(Safety(endpoint=server.endpoint))
        driver.listener = ears = Ears()
        await asyncio.sleep(0.5)
        server.drop_hosts()
        await asyncio.sleep(3.0)
        assert driver.status_age_s <= PERIOD_S + 0.001
        server.stop()
        await asyncio.sleep(3.0)
        assert driver.status_age_s > 2.5
        assert ears.faults[-1][1] == "no answer for 0.3 s"
        await driver.close()

    virtual_time.run(main())


def test_what_cannot_be_opened():
    async def refused(words: str, device=None, **settings):
        device = device or SafetyDevice(SafetyConfig(), now)
        server = await serve_tcp(device)
        safety = Safety(**{"endpoint": server.endpoint, **settings})
        started_s = now()
        with pytest.raises(MachineError, match=words) as caught:
            await SafetyDriver.open(safety)
        assert now() - started_s <= 1.0
        assert caught.value.hint
        await server.close()
        return caught.value

    async def main():
        await refused("has no watchdog relay", relay_timeout_s=1.0)
        await refused("does not answer", device_id=9)
        silent = SafetyDevice(SafetyConfig(), now)
        silent.silence()
        await refused("safety device: it does not answer", silent)
        busy = SafetyDevice(SafetyConfig(boot_s=5.0), now)
        await refused("it refuses to answer: it is busy", busy)
        other = Replayed(SafetyConfig(), now)
        other.old = [0x504D, 0x0101, *[0] * 19]
        error = await refused("the device for safety inputs is none", other)
        assert "its DEVICE_ID is 20557, not 21321" in error.where[1]
        other.old = [0x5349, 0x0200, *[0] * 19]
        await refused("speaks another register map", other)
        cached = Replayed(SafetyConfig(), now)
        cached.old = cached.read_input(0, 21)
        await refused("does not repeat the heartbeat", cached)
        closed = "modbus-tcp://127.0.0.1:1"
        with pytest.raises(MachineError, match="safety device: nothing answers at"):
            await SafetyDriver.open(Safety(endpoint=closed))
        with pytest.raises(ConfigError, match="not an endpoint"):
            await SafetyDriver.open(Safety(endpoint="tcp://127.0.0.1:1"))

    virtual_time.run(main())


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
                Safety(endpoint=f"modbus-rtu:///dev/ttyS99{line}", period_s=period_s)
            )
        assert hint in caught.value.hint

    virtual_time.run(main())


@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.5, 1.0])
def test_every_period(period_s):
    async def main():
        settings = {"period_s": period_s, "relay_timeout_s": 3 * period_s}
        async with driven(**settings) as (driver, device, ears):
            await driver.reset_relay()
            await asyncio.sleep(20 * period_s)
            assert 19 <= len(ears.statuses) <= 22
            device.silence()
            last_s = now() - driver.status_age_s
            await asyncio.sleep(10 * period_s)
            ((told_s, _),) = ears.faults
            assert told_s - last_s == pytest.approx(3 * period_s)
            device.silence(False)
            device.settle()
            assert len(device.relay_opened_s) == 1
            assert device.card.first_out == RELAY_CODE

    virtual_time.run(main())


def test_closing_ends_even_with_a_dead_device():
    async def main():
        async with driven() as (driver, device, _):
            device.silence()
            await asyncio.sleep(1.0)
            started_s = now()
            await driver.close()
            assert now() - started_s < 0.5

    virtual_time.run(main())


def test_the_whole_exchange_is_one_request():
    async def main():
        device = SafetyDevice(RELAY, now)
        asked = []
        read, write = device.read_holding, device.write
        device.read_holding = lambda *args: (asked.append(("read", *args)), read(*args))[1]
        device.write = lambda *args: (asked.append(("write", *args)), write(*args))[1]
        async with driven(device=device) as (_, _, _):
            asked.clear()
            await asyncio.sleep(0.11)
        kinds = [(kind, address) for kind, address, _ in asked]
        assert kinds == [("write", 0), ("read", MIRROR + CYCLE_BLOCK.address)]
        assert device.read_holding(0, 2)[1] == 300
        assert Inputs.DOOR_CLOSED in device.card.good
        assert math.isinf(device.next_due_s())

    virtual_time.run(main())
