"""The laser-enable output: its rules by hand, then driver and simulated device on their wires."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmctl.config.machine import Safety
from lmctl.errors import MachineError
from lmctl.machine.laser_enable import SETTLE_S, LaserEnable
from lmctl.machine.look_modbus import look_at_safety
from lmctl.machine.safety import SafetyDriver
from lmctl.machine.safety_status import SafetyListener
from simulators import virtual_time
from simulators.faults.edge import Edge, nothing_passes
from simulators.modbus_server import serve_pty, serve_tcp
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SafetyDevice
from simulators.safety.laser_output import LaserOutput

LASER_ENABLE = 3
FITTED = SafetyConfig(watchdog_relay=True, laser_enable=True)
PERIOD_S = 0.1


# --- the rules ------------------------------------------------------------------------------------


def test_on_is_told_only_after_off_was_read_back():
    output = LaserEnable()
    output.demand(True)
    assert output.word() == 0
    assert output.read_back(False, 0.0) is None
    assert output.has_news
    assert output.word() == 1
    assert not output.is_shown(True)
    assert output.read_back(True, 0.0) is None
    assert output.is_shown(True)
    assert not output.pending
    output.demand(False)
    assert (output.has_news, output.pending, output.word()) == (True, True, 0)
    output.demand(True)  # before the 0 is known to have come
    assert output.word() == 0


@pytest.mark.parametrize("on", [True, False])
def test_a_contact_has_its_time_and_then_is_at_fault(on):
    output = LaserEnable()
    output.word()
    output.read_back(False, 0.0)
    output.demand(True)
    output.word()
    if not on:
        output.read_back(True, 0.0)
        output.demand(False)
        output.word()
    assert output.read_back(not on, 1.0) is None
    assert output.read_back(not on, 1.0 + 0.9 * SETTLE_S) is None
    assert output.against(on) is None
    fault = output.read_back(not on, 1.0 + SETTLE_S)
    seen, told = ("off", "on") if on else ("on", "off")
    assert fault.reason == f"its laser-enable output is {seen} and was told to be {told}"
    assert fault.hint
    assert output.against(on) is fault
    assert output.read_back(not on, 9.0) is None  # told once
    assert (output.wanted, output.pending) == (False, False)
    output.demand(True)  # no demand while it is at fault
    assert not output.wanted


def test_what_was_on_and_is_off_is_at_fault_at_once_and_stays_off():
    output = LaserEnable()
    output.word()
    output.read_back(False, 0.0)
    output.demand(True)
    output.word()
    output.read_back(True, 0.0)
    assert output.read_back(False, 0.01).reason.startswith("its laser-enable output is off")
    assert output.against(True) is not None
    assert output.against(False) is None
    assert output.word() == 0
    assert output.read_back(False, 0.02) is None
    assert not output.has_news
    output.demand(True)
    assert output.word() == 1


@given(st.lists(st.sampled_from(["on", "off", "beat", "lost", "trip", "restart"])))
def test_whatever_happens_the_output_is_on_only_since_a_demand_that_was_not_taken_back(acts):
    host, device = LaserEnable(), LaserOutput()
    may_be_on, now_s = False, 0.0  # since the last demand: not taken back, not tripped
    for act in acts:
        now_s += 1.0
        if act in ("on", "off"):
            host.demand(act == "on")
            may_be_on = host.wanted
        elif act in ("trip", "restart"):
            may_be_on &= act == "trip" and not device.is_on
            (device.drop if act == "trip" else device.forget)()
            if act == "restart":
                host.restarted()  # as its uptime tells, before the next word
        else:
            device.tell(host.word(), may_come_on=True)
            if act == "beat":
                host.read_back(device.is_on, now_s)
            assert may_be_on or not device.is_on


# --- on the wire ----------------------------------------------------------------------------------


def now() -> float:
    return asyncio.get_running_loop().time()


class Cell:
    """Driver and device, with all that was written and told."""

    def __init__(self, driver: SafetyDriver, device: SafetyDevice, edge: Edge) -> None:
        self.driver, self.device, self.edge = driver, device, edge
        self.words: list[tuple[float, int]] = []
        self.faults: list[tuple[str, str]] = []
        driver.listener = SafetyListener(
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
        return not self.device.laser_cut

    async def on(self) -> None:
        self.driver.enable_laser(True)
        await self.driver.laser_enabled(True)


@asynccontextmanager
async def driven(wire: str = "tcp", config: SafetyConfig = FITTED, **settings
                 ) -> AsyncIterator[Cell]:
    device, edge = SafetyDevice(config, now), Edge()
    server = await (serve_tcp(device, edge=edge) if wire == "tcp"
                    else serve_pty(device, edge, baud=115_200))
    settings = {"relay_timeout_s": 0.3, "laser_enable": True, **settings}
    driver = await SafetyDriver.open(Safety(endpoint=server.endpoint, **settings))
    try:
        await driver.reset_relay()
        yield Cell(driver, device, edge)
    finally:
        await driver.close()
        await server.close()


wires = pytest.mark.parametrize("wire", ["tcp", "rtu"])


def played(act, wire: str = "tcp", **settings):
    async def main():
        async with driven(wire, **settings) as cell:
            await act(cell)

    virtual_time.run(main())


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
        cell.driver.enable_laser(False)
        await cell.driver.laser_enabled(False)
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
        cell.driver.enable_laser(False)
        cell.driver.enable_laser(True)
        cell.driver.enable_laser(False)
        cell.driver.enable_laser(True)
        await cell.driver.laser_enabled(True)
        assert cell.is_on
        cell.driver.enable_laser(False)
        cell.driver.enable_laser(True)
        cell.driver.enable_laser(False)
        await asyncio.sleep(0.5)
        assert not cell.is_on
        assert cell.faults == []

    played(act, wire)


@wires
def test_a_word_that_is_lost_is_told_again(wire):
    async def act(cell):
        await cell.on()
        for direction in ("to_device", "to_host"):
            for on in (False, True):
                cell.edge.put(direction, nothing_passes)
                asyncio.get_running_loop().call_later(
                    0.02, cell.edge.take, direction, nothing_passes)
                cell.driver.enable_laser(on)
                began_s = now()
                await cell.driver.laser_enabled(on)
                assert cell.is_on is on
                # an answer's patience, and on a line the silence after it
                assert now() - began_s <= PERIOD_S + 0.03
        assert (cell.faults, cell.device.relay_opened_s) == ([], [])

    played(act, wire)


@wires
def test_it_drops_with_the_watchdog_relay_and_heartbeats_do_not_bring_it_back(wire):
    async def act(cell):
        await cell.on()
        cell.edge.put("to_device", nothing_passes)
        await asyncio.sleep(0.5)
        cell.device.settle()
        assert not cell.is_on
        cell.faults.clear()
        cell.edge.take("to_device", nothing_passes)
        await asyncio.sleep(2.0)
        assert not cell.is_on
        (fault,) = cell.faults
        assert fault[0] == "its laser-enable output is off and was told to be on"
        assert "drops with the watchdog relay, which is open" in fault[1]
        await cell.driver.reset_relay()
        await asyncio.sleep(1.0)
        assert (cell.is_on, cell.driver.status.relay_closed) == (False, True)
        await cell.on()
        assert cell.is_on

    played(act, wire)


@wires
def test_it_stays_off_after_the_device_restarted(wire):
    async def act(cell):
        await cell.on()
        await asyncio.sleep(3.0)
        cell.device.restart()
        assert not cell.is_on
        await asyncio.sleep(1.0)
        await cell.driver.reset_relay()
        await asyncio.sleep(1.0)
        assert not cell.is_on
        assert [reason for reason, _ in cell.faults] == ["the device restarted"]
        await cell.on()

    played(act, wire)


@wires
def test_one_that_does_not_drop_is_told_and_does_not_count_as_dropped(wire):
    async def act(cell):
        await cell.on()
        cell.device.stick_output()
        began_s = now()
        cell.driver.enable_laser(False)
        with pytest.raises(MachineError, match="output is on and was told to be off") as caught:
            await cell.driver.laser_enabled(False)
        assert now() - began_s <= 2 * SETTLE_S
        assert "check the laser-enable output" in caught.value.hint
        assert [reason for reason, _ in cell.faults] == [
            "its laser-enable output is on and was told to be off"
        ]
        assert cell.driver.status.laser_enabled is True
        cell.driver.enable_laser(True)
        with pytest.raises(MachineError, match="is on and was told to be off"):
            await cell.driver.laser_enabled(True)
        await asyncio.sleep(1.0)
        assert len(cell.faults) == 1
        cell.device.stick_output(False)
        await asyncio.sleep(1.0)
        assert not cell.is_on  # the demand while it was stuck is none now
        await cell.on()

    played(act, wire)


@wires
def test_one_that_does_not_come_is_told_and_not_awaited(wire):
    async def act(cell):
        cell.device.stick_output()
        cell.driver.enable_laser(True)
        with pytest.raises(MachineError, match="output is off and was told to be on"):
            await cell.driver.laser_enabled(True)
        assert len(cell.faults) == 1
        cell.device.stick_output(False)
        await asyncio.sleep(1.0)
        assert not cell.is_on
        await cell.on()

    played(act, wire)


def test_one_that_drops_by_itself_is_told_at_the_next_beat():
    async def act(cell):
        await cell.on()
        await asyncio.sleep(1.0)
        cell.device.drop_output()
        await asyncio.sleep(PERIOD_S + 0.001)
        assert [reason for reason, _ in cell.faults] == [
            "its laser-enable output is off and was told to be on"
        ]
        await cell.driver.laser_enabled(False)
        await cell.on()

    played(act)


@pytest.mark.parametrize("on", [True, False])
def test_a_device_that_cannot_be_heard_confirms_nothing(on):
    async def act(cell):
        if not on:
            await cell.on()
        cell.device.freeze()
        cell.driver.enable_laser(on)
        with pytest.raises(MachineError, match="come on within" if on else "drop within"):
            await cell.driver.laser_enabled(on)
        await asyncio.sleep(0.001)
        assert not cell.is_on
        cell.device.freeze(False)
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


@wires
def test_closing_drops_it_before_the_watchdog_would(wire):
    async def main():
        async with driven(wire) as cell:
            await cell.on()
        assert not cell.is_on
        assert not cell.device.relay_open

    virtual_time.run(main())


def test_without_an_output_nothing_is_written_and_nothing_awaited():
    async def act(cell):
        cell.driver.enable_laser(True)
        await cell.driver.laser_enabled(True)
        await asyncio.sleep(1.0)
        assert (cell.words, cell.faults) == ([], [])
        assert cell.driver.status.laser_enabled is None

    played(act, config=SafetyConfig(watchdog_relay=True), laser_enable=False)


def test_a_device_without_one_is_refused():
    async def main():
        server = await serve_tcp(SafetyDevice(SafetyConfig(watchdog_relay=True), now))
        safety = Safety(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        with pytest.raises(MachineError, match="has no laser-enable output") as caught:
            await SafetyDriver.open(safety)
        assert caught.value.where[1] == "the profile says laser_enable = true"
        await server.close()

    virtual_time.run(main())


def test_a_look_tells_it_and_leaves_it():
    async def main():
        device = SafetyDevice(FITTED, now)
        server = await serve_tcp(device)
        safety = Safety(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        assert (await look_at_safety(safety)).laser_enabled is False
        device.write(0, [1, 60_000, 0xC105])
        device.write(LASER_ENABLE, [1])
        assert (await look_at_safety(safety)).laser_enabled is True
        assert not device.laser_cut
        await server.close()

    virtual_time.run(main())


def test_a_new_host_finds_it_off_whatever_the_last_one_left():
    async def main():
        device = SafetyDevice(FITTED, now)
        device.write(0, [7, 60_000, 0xC105])
        device.write(LASER_ENABLE, [1])
        server = await serve_tcp(device)
        safety = Safety(endpoint=server.endpoint, relay_timeout_s=0.3, laser_enable=True)
        driver = await SafetyDriver.open(safety)
        assert device.laser_cut
        assert driver.status.laser_enabled is False
        await driver.close()
        await server.close()

    virtual_time.run(main())
