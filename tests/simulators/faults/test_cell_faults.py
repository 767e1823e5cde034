"""Faults of the safety device and of the cell as a whole, and that every kind can happen."""

import asyncio

import pytest

from firmware_protocol.safety_io import RELAY_RESET_KEY, SIO_MAP, SafetyInputBits, SafetyStatusBits
from simulators.faults.injectors import INJECTORS
from simulators.faults.kinds import FAULT_KINDS, Fault, FaultTarget

RELAY = [("watchdog_relay = false", "watchdog_relay = true")]


def word(cell, name):
    """The last word of a register."""
    register, at = SIO_MAP[name], SIO_MAP.wire_address(name)
    return cell.bench.safety.read_input(at, register.word_count)[-1]


async def under_way(cell):
    await cell.send("G21 G90 G94\nM4 S0\n", then_s=0.5)
    cell.feed("F1")
    await asyncio.sleep(20.0)
    await cell.send("N5 G1 X200 F600 S500\n", then_s=1.0)


def test_kinds_and_acts_are_of_the_same_names():
    assert FAULT_KINDS.keys() == INJECTORS.keys()


def a_fault_of(kind):
    device = {FaultTarget.MODBUS: "F1", FaultTarget.FEEDER: "F1",
              FaultTarget.HOPPER: "F1"}.get(kind.target)
    return Fault.create(kind.name, device or "", **{p.name: 5.0 for p in kind.parameters
                                                 if p.default is None})


@pytest.mark.parametrize("kind", FAULT_KINDS.values(), ids=FAULT_KINDS)
def test_every_kind_happens_to_a_cell_at_work_and_ends_where_it_lasts(play, kind):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        number = cell.board.inject(a_fault_of(kind), for_s=2.0 if kind.is_lasting else None)
        await asyncio.sleep(5.0)
        (happened,) = cell.board.injected
        cell.board.clear(number)  # a second time, without effect
        assert cell.board.injected == (happened,)
        return happened, at_s

    happened, at_s = play(scene)
    assert happened.at_s == at_s
    assert happened.cleared_s == (pytest.approx(at_s + 2.0) if kind.is_lasting else None)


def test_emergency_stop_reaches_everything(play):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        number = cell.inject("estop")
        said = await cell.send("?", then_s=0.1)
        seen = cell.judge.beam_off_at_s(at_s), cell.judge.powder_stop("F1").commanded_s
        open_bits = word(cell, "INPUTS")
        cell.board.clear(number)
        return at_s, said, seen, open_bits, word(cell, "INPUTS")

    at_s, said, seen, open_bits, closed_bits = play(scene)
    assert b"ALARM:10" in said
    assert seen == (pytest.approx(at_s), pytest.approx(at_s))
    assert not open_bits & SafetyInputBits.ESTOP_CLOSED
    assert closed_bits & SafetyInputBits.ESTOP_CLOSED


def test_the_door_reaches_controller_and_safety_device_but_not_the_feeders(play):
    async def scene(cell):
        await under_way(cell)
        at_s = cell.now_s
        cell.inject("door", for_s=3.0)
        said = await cell.send("?", then_s=0.5) + await cell.send("?", then_s=0.1)
        bits = word(cell, "INPUTS")
        await asyncio.sleep(3.0)
        return at_s, said, bits, cell.judge, word(cell, "INPUTS")

    at_s, said, bits, judge, later = play(scene)
    assert b"<Door:1" in said
    assert not bits & SafetyInputBits.DOOR_CLOSED
    assert later & SafetyInputBits.DOOR_CLOSED
    assert judge.beam_off_at_s(at_s) < at_s + 0.2
    assert judge.powder_stop("F1") is None


@pytest.mark.parametrize(
    ("kind", "values", "name", "reads"),
    [("shield_gas_low", {"flow_L_min": 3.0}, "SHIELD_GAS", 3.0),
     ("chiller_fails", {"flow_L_min": 1.0, "temperature_C": 45.0}, "CHILLER_TEMP", 45.0),
     ("oxygen_high", {"ppm": 900.0}, "OXYGEN", 900.0),
     ("extraction_low", {"pressure_Pa": 10}, "EXTRACTION_DP", 10.0)],
)
def test_what_the_safety_device_reads(play, kind, values, name, reads):
    async def scene(cell):
        before = word(cell, name)
        cell.inject(kind, **values, for_s=1.0)
        during = word(cell, name)
        await asyncio.sleep(1.1)
        return before, during, word(cell, name)

    before, during, after = play(scene)
    assert during / SIO_MAP[name].counts_per_unit == pytest.approx(reads)
    assert before == after != during


def test_an_invalid_analyser(play):
    async def scene(cell):
        cell.inject("analyser_invalid", for_s=1.0)
        during = word(cell, "INPUTS")
        await asyncio.sleep(1.1)
        return during & SafetyInputBits.OXYGEN_VALID, word(cell,
                                                           "INPUTS") & SafetyInputBits.OXYGEN_VALID

    assert play(scene) == (0, SafetyInputBits.OXYGEN_VALID)


def test_a_stuck_safety_device_stands_still_with_its_tick(play):
    async def scene(cell):
        cell.inject("safety_stuck", for_s=2.0)
        first = word(cell, "TICK"), word(cell, "INPUTS")
        await asyncio.sleep(1.0)
        cell.inject("door")
        second = word(cell, "TICK"), word(cell, "INPUTS")
        await asyncio.sleep(1.5)
        return first, second, (word(cell, "TICK"), word(cell, "INPUTS"))

    first, second, third = play(scene)
    assert first == second
    assert third[0] != first[0]
    assert not third[1] & SafetyInputBits.DOOR_CLOSED


def test_a_safety_device_that_restarts_opens_its_relay(play):
    async def scene(cell):
        device = cell.bench.safety
        device.write(SIO_MAP.wire_address("HEARTBEAT"), [1])
        device.write(SIO_MAP.wire_address("RELAY_RESET"), [RELAY_RESET_KEY])
        closed = word(cell, "STATUS") & SafetyStatusBits.RELAY_CLOSED
        cell.inject("safety_restarts")
        return closed, word(cell, "STATUS") & SafetyStatusBits.RELAY_CLOSED, await cell.send("?")

    closed, opened, said = play(scene, *RELAY)
    assert (closed, opened) == (SafetyStatusBits.RELAY_CLOSED, 0)
    assert b"<Door" in said


def test_without_a_safety_device_estop_and_door_go_to_the_others(play):
    async def scene(cell):
        cell.bench.safety = None  # as on a bench without one
        number = cell.inject("estop")
        opened = (await cell.send("?"), cell.bench.feeders["F2"].estop_open)
        cell.board.clear(number)
        await cell.send(b"\x18")
        await cell.send("$X\n")
        cell.inject("door", for_s=1.0)
        door = await cell.send("?")
        with pytest.raises(ValueError, match="no safety device"):
            cell.inject("oxygen_high")
        return opened, door, cell.bench.feeders["F2"].estop_open, len(cell.board.injected)

    (said, chain), door, after, happened = play(scene)
    assert (b"|Pn:E" in said, chain, after) == (True, True, False)
    assert b"<Door" in door
    assert happened == 2


OUTPUT = [("watchdog_relay = false", "watchdog_relay = true\nlaser_enable = true")]


async def beam_on(cell):
    """The relay is closed and the laser-enable output on."""
    cell.bench.safety.write(0, [1, 5000, RELAY_RESET_KEY, 0])
    cell.bench.safety.write(SIO_MAP.wire_address("LASER_ENABLE"), [1])
    assert word(cell, "STATUS") & SafetyStatusBits.LASER_ENABLED


def test_the_laser_enable_contact_drops_by_itself_and_can_be_closed_again(play):
    async def scene(cell):
        await beam_on(cell)
        cell.inject("laser_enable_drops")
        dropped = word(cell, "STATUS")
        cell.bench.safety.write(SIO_MAP.wire_address("LASER_ENABLE"), [0])
        cell.bench.safety.write(SIO_MAP.wire_address("LASER_ENABLE"), [1])
        return dropped, word(cell, "STATUS")

    dropped, again = play(scene, *OUTPUT)
    assert not dropped & SafetyStatusBits.LASER_ENABLED
    assert again & SafetyStatusBits.LASER_ENABLED


@pytest.mark.parametrize("contact", ["closed", "as it is"])
def test_a_stuck_laser_enable_contact_stays_closed_and_says_so_until_it_is_over(play, contact):
    async def scene(cell):
        await beam_on(cell)
        number = cell.inject("laser_enable_stuck", contact=contact)
        cell.bench.safety.write(SIO_MAP.wire_address("LASER_ENABLE"), [0])
        stuck = word(cell, "STATUS")
        cell.board.clear(number)
        return stuck, word(cell, "STATUS")

    stuck, free = play(scene, *OUTPUT)
    assert stuck & SafetyStatusBits.LASER_ENABLED
    assert not free & SafetyStatusBits.LASER_ENABLED
