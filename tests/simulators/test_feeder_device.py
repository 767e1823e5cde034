"""The simulated feeder: from rest to feeding and back, recipes, and its registers."""

from __future__ import annotations

import pytest

from firmware_protocol.pmx import (
    MIRROR_ADDRESS,
    SYSTEM_BLOCK,
    FeederCommandBits,
    FeederMode,
    FeederStateCode,
    FeederStatusBits,
    HopperStatusBits,
    WriteRefusalCode,
    hopper_input_names,
)
from simulators.feeder.readings import read_holding, read_input
from simulators.modbus_errors import ILLEGAL_ADDRESS, ILLEGAL_VALUE, REFUSED, ExceptionReplyError
from tests.simulators.feeder_cell import FEED, GAS, REMOTE, Cell, hopper


def test_it_says_what_it_is():
    cell = Cell(hopper(1), hopper(2))
    assert cell.read("DEVICE_ID") == 0x504D
    assert cell.read("MAP_VERSION") == 0x0101
    assert cell.read("N_HOPPERS") == 2
    assert cell.read("MODE") == FeederMode.REMOTE
    assert cell.read("UPTIME") == 0
    cell.wait(65.7, beating=False)
    assert cell.read("UPTIME") == 65
    assert cell.read("TICK") == 165_700 % 65_536


def test_the_way_from_rest_to_feeding_and_back():
    cell = Cell()
    assert cell.state is FeederStateCode.NOT_READY
    cell.write("COMMAND", REMOTE)
    assert cell.state is FeederStateCode.READY
    cell.recipe(6.0, seq=1)
    cell.write("COMMAND", GAS)
    assert cell.state is FeederStateCode.GAS_PREFLOW
    assert FeederStatusBits.GAS_OK not in cell.status
    assert cell.read("TOTAL_GAS") == 4.0
    cell.wait(3.0)
    assert FeederStatusBits.GAS_OK in cell.status
    assert cell.disc_rpm() == 0.0
    cell.write("COMMAND", FEED)
    assert cell.state is FeederStateCode.STABILISING
    assert cell.disc_rpm() == 3.0
    assert cell.read("TOTAL_FLOW") == 6.0
    cell.wait(7.9)
    assert FeederStatusBits.STABLE not in cell.status
    cell.wait(0.2)
    assert cell.state is FeederStateCode.FEEDING
    for bit in (FeederStatusBits.STABLE, FeederStatusBits.AT_SETPOINT, FeederStatusBits.FEEDING):
        assert bit in cell.status
    cell.write("COMMAND", REMOTE)
    assert cell.state is FeederStateCode.STOPPING
    assert cell.disc_rpm() == 0.0
    assert cell.read("TOTAL_GAS") == 4.0  # post-flow
    cell.wait(10.1)
    assert cell.state is FeederStateCode.READY
    assert cell.read("TOTAL_GAS") == 0.0
    cell.write("COMMAND", 0)
    assert cell.state is FeederStateCode.NOT_READY


def test_powder_waits_for_the_gas():
    cell = Cell()
    cell.write("COMMAND", REMOTE)
    cell.recipe(6.0, seq=1)
    cell.write("COMMAND", FEED)
    cell.wait(2.9)
    assert (cell.state, cell.disc_rpm()) == (FeederStateCode.GAS_PREFLOW, 0.0)
    cell.wait(0.2)
    assert (cell.state, cell.disc_rpm()) == (FeederStateCode.STABILISING, 3.0)
    # the discs started at 3 s exactly, though they were not read then
    span = cell.device.spans[-1]
    assert (span.start_s, span.stable_s) == (103.0, 111.0)


def test_a_shorter_post_flow_counts_at_once():
    cell = Cell()
    cell.feed(6.0)
    cell.write("COMMAND", REMOTE)
    cell.wait(1.0)
    assert cell.state is FeederStateCode.STOPPING
    cell.write("POSTFLOW", 0.0)
    assert cell.state is FeederStateCode.READY
    assert cell.read("TOTAL_GAS") == 0.0


def test_a_recipe_is_applied_whole_when_its_number_changes():
    cell = Cell(hopper(1), hopper(2))
    cell.feed(6.0, 2.0)
    cell.write("H1.FLOW_SP", 10.0)
    cell.write("H2.FLOW_SP", 1.0)
    assert (cell.disc_rpm(1), cell.disc_rpm(2)) == (3.0, 1.0)
    assert cell.read("SEQ_APPLIED") == 1
    cell.beat()
    cell.write("SEQ", 2)
    assert (cell.disc_rpm(1), cell.disc_rpm(2)) == (5.0, 0.5)
    assert cell.read("SEQ_APPLIED") == 2
    cell.recipe(4.0, 4.0, seq=2)  # the same number: nothing is committed
    assert (cell.disc_rpm(1), cell.disc_rpm(2)) == (5.0, 0.5)


def test_one_write_holds_heartbeat_recipe_and_number():
    cell = Cell(hopper(1), hopper(2))
    cell.feed(6.0, 2.0)
    cell.t += 0.7
    cell.recipe(3.0, 3.0, seq=77)
    assert cell.read("SEQ_APPLIED") == 77
    assert cell.read("HEARTBEAT_AGE") == 0
    assert cell.read("HEARTBEAT_ECHO") == cell.beats
    assert (cell.disc_rpm(1), cell.disc_rpm(2)) == (1.5, 1.5)


def test_a_ramp_goes_evenly_to_the_recipe():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(10.0, seq=2, ramp_s=2.0)
    assert FeederStatusBits.RAMPING in cell.status
    assert FeederStatusBits.AT_SETPOINT not in cell.status
    cell.wait(1.0)
    assert cell.read("H1.DISC_RAMPED") == 4.0
    cell.wait(1.0)
    assert cell.disc_rpm() == 5.0
    assert FeederStatusBits.AT_SETPOINT in cell.status


def test_rpm_mode():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(0.0, seq=2, SETPOINT_MODE=0, **{"H1.DISC_SP": 7.5})
    assert cell.disc_rpm() == 7.5


def test_a_set_point_beyond_the_disc_is_clipped_and_reported():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(50.0, seq=2)
    assert cell.disc_rpm() == 20.0
    assert HopperStatusBits.LIMITED in HopperStatusBits(cell.read("H1.STATUS"))
    assert cell.read("WARNING") == 1 << 4


def test_a_set_point_below_the_least_speed_stands_still_and_is_reported():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(0.5, seq=2)
    assert cell.disc_rpm() == 0.0
    flags = HopperStatusBits(cell.read("H1.STATUS"))
    assert HopperStatusBits.BELOW_N_MIN in flags
    assert HopperStatusBits.AT_SETPOINT not in flags


def test_the_stored_feed_factor_is_what_the_device_believes_not_what_is_true():
    cell = Cell(hopper(feed_factor_g_rev=2.0, calibrated_g_rev=2.5))
    cell.feed(5.0)
    assert cell.disc_rpm() == 2.0
    assert cell.read("H1.FLOW_EST") == 5.0
    assert cell.read("H1.FLOW_LIW") == 4.0
    assert cell.refused("H1.FEED_FACTOR", 2.0) == REFUSED
    assert cell.read("LAST_REFUSAL") == WriteRefusalCode.POWDER_RUNNING


@pytest.mark.parametrize(
    ("name", "value", "code", "reason"),
    [
        ("COMMAND", FeederCommandBits.GAS_ON, REFUSED, WriteRefusalCode.NOT_REMOTE),
        ("COMMAND", REMOTE | FeederCommandBits.FEED_ON, REFUSED, WriteRefusalCode.NO_GAS),
        ("COMMAND", 1 << 7, ILLEGAL_VALUE, None),
        ("WD_TIMEOUT", 0, REFUSED, WriteRefusalCode.WATCHDOG_NEEDED),
        ("WD_TIMEOUT", 99, ILLEGAL_VALUE, None),
    ],
)
def test_refused_writes(name, value, code, reason):
    cell = Cell()
    assert cell.refused(name, value) == code
    if reason is not None:
        assert cell.read("LAST_REFUSAL") == reason
    assert cell.read("COMMAND") == 0
    assert cell.read("WD_TIMEOUT") == 1000


@pytest.mark.parametrize(
    ("address", "words", "code"),
    [
        (3, [3], ILLEGAL_VALUE), (7, [6001], ILLEGAL_VALUE), (12, [1], ILLEGAL_VALUE),
        (24, [0], ILLEGAL_ADDRESS), (22, [0, 0, 0], ILLEGAL_ADDRESS), (500, [1], ILLEGAL_ADDRESS),
        (9999, [1], ILLEGAL_ADDRESS), (1, [5, 1000, 7], ILLEGAL_VALUE),
    ],
)
def test_a_bad_word_in_a_write_leaves_all_as_it_was(address, words, code):
    cell = Cell()
    before = read_holding(cell.device, 0, 24)
    with pytest.raises(ExceptionReplyError) as caught:
        cell.device.write(address, words)
    assert caught.value.code == code
    assert read_holding(cell.device, 0, 24) == before


@pytest.mark.parametrize(("address", "count"), [(24, 1), (23, 2), (99, 2), (119, 2), (200, 1),
                                                (0, 25), (60_000, 1)])
def test_input_registers_that_are_not_there(address, count):
    with pytest.raises(ExceptionReplyError) as caught:
        read_input(Cell().device, address, count)
    assert caught.value.code == ILLEGAL_ADDRESS


def test_every_input_register_of_the_table_is_there_and_reads_as_it_should():
    cell = Cell(hopper(1), hopper(2))
    cell.feed(6.0, 2.0)
    for name in (*(row.name for row in SYSTEM_BLOCK.rows), *hopper_input_names(1),
                 *hopper_input_names(2)):
        cell.read(name)
    assert cell.read("H2.FLOW_EST") == 2.0
    assert cell.read("H1.LEVEL") == pytest.approx(100.0, abs=0.2)
    assert cell.read("H1.TORQUE") is None


def test_the_mirror_shows_input_registers_where_the_map_has_it():
    cell = Cell()
    assert read_holding(cell.device, MIRROR_ADDRESS, 24) == read_input(cell.device, 0, 24)
    whole = read_input(cell.device, 0, 24) + read_input(cell.device, 100, 20)
    assert read_holding(cell.device, MIRROR_ADDRESS, 44) == whole
    assert read_holding(cell.device, MIRROR_ADDRESS + 24, 20) == whole[24:]
    for address, count in ((MIRROR_ADDRESS, 45), (MIRROR_ADDRESS + 44, 1),
                           (MIRROR_ADDRESS + 100, 1)):
        with pytest.raises(ExceptionReplyError):
            read_holding(cell.device, address, count)
    old = Cell(map_minor=0)
    assert old.read("MAP_VERSION") == 0x0100
    with pytest.raises(ExceptionReplyError):
        read_holding(old.device, MIRROR_ADDRESS, 24)


def test_the_mirror_of_a_hopper_that_is_not_there_is_zeros():
    cell = Cell(hopper(1), hopper(3))
    said = read_holding(cell.device, MIRROR_ADDRESS, 84)
    assert said[24:44] == read_input(cell.device, 100, 20)
    assert said[44:64] == [0] * 20
    assert said[64:] == read_input(cell.device, 300, 20)


def test_toggle_and_tick_move():
    cell = Cell()
    before = cell.status & FeederStatusBits.TOGGLE, cell.read("TICK")
    cell.t += 0.15
    assert (cell.status & FeederStatusBits.TOGGLE) != before[0]
    assert cell.read("TICK") == (before[1] + 150) % 65_536
