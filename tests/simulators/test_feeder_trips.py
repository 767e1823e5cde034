"""The simulated feeder's watchdog, alarms and restarts: what stops powder, what brings it back."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_protocol.pmx import (
    WATCHDOG_RESET_KEY,
    FeederMode,
    FeederStateCode,
    FeederStatusBits,
    HopperStatusBits,
    WatchdogAction,
    WriteRefusalCode,
)
from simulators.modbus_errors import BUSY, ILLEGAL_VALUE, REFUSED
from tests.simulators.feeder_cell import FEED, GAS, REMOTE, Cell, hopper


@pytest.mark.parametrize(
    ("action", "state", "rpm", "gas"),
    [
        (WatchdogAction.HOLD, FeederStateCode.FEEDING, 3.0, 4.0),
        (WatchdogAction.DISCS_STOP, FeederStateCode.STOPPING, 0.0, 4.0),
        (WatchdogAction.ALL_STOP, FeederStateCode.FAULT, 0.0, 0.0),
    ],
)
def test_a_silent_host_trips_the_watchdog(action, state, rpm, gas):
    cell = Cell()
    cell.feed(6.0)
    cell.write("WD_ACTION", action)
    cell.beat()
    cell.wait(0.999, beating=False)
    assert FeederStatusBits.WATCHDOG_TRIPPED not in cell.status
    cell.wait(0.5, beating=False)
    assert FeederStatusBits.WATCHDOG_TRIPPED | FeederStatusBits.ALARM in cell.status
    assert cell.read("FIRST_ALARM_CODE") == 104
    assert (cell.disc_rpm(), cell.read("TOTAL_GAS")) == (rpm, gas)
    if action is WatchdogAction.DISCS_STOP:
        assert cell.state is FeederStateCode.FAULT
    else:
        assert cell.state is state


def test_powder_stops_when_the_watchdog_says_though_no_one_asks_until_later():
    cell = Cell()
    cell.feed(6.0)
    cell.beat()
    last_beat_s = cell.t
    cell.wait(1000.0, beating=False)
    assert cell.disc_rpm() == 0.0
    assert cell.device.spans[-1].end_s == pytest.approx(last_beat_s + 1.0)
    flow = cell.device.hoppers[1].process.nozzle_flow_g_s
    assert flow(np.array([last_beat_s + 3.99, last_beat_s + 20.0])) == pytest.approx(
        [0.1, 0.0], abs=1e-4
    )


def test_a_heartbeat_that_does_not_change_is_none():
    cell = Cell()
    cell.feed(6.0)
    for _ in range(5):
        cell.t += 0.3
        cell.write("HEARTBEAT", cell.beats)
    assert FeederStatusBits.WATCHDOG_TRIPPED in cell.status


def test_nothing_starts_by_itself_after_a_trip():
    cell = Cell()
    cell.feed(6.0)
    cell.wait(2.0, beating=False)
    assert cell.read("COMMAND") == GAS  # the device took FEED_ON back
    cell.beat()
    assert cell.refused("COMMAND", FEED) == REFUSED
    assert cell.read("LAST_REFUSAL") == WriteRefusalCode.FAULTED
    assert cell.refused("ALARM_RESET", 1) == REFUSED
    assert cell.read("LAST_REFUSAL") == WriteRefusalCode.CAUSE_REMAINS
    assert cell.refused("WD_RESET", 1) == ILLEGAL_VALUE
    cell.write("WD_RESET", WATCHDOG_RESET_KEY)
    assert cell.refused("COMMAND", FEED) == REFUSED
    cell.write("ALARM_RESET", 1)
    assert cell.read("FIRST_ALARM_CODE") == 0
    assert cell.read("ALARM_COUNT") == 1
    assert cell.disc_rpm() == 0.0
    cell.write("COMMAND", FEED)
    assert cell.state is FeederStateCode.STABILISING


def test_the_watchdog_watches_only_a_host_in_command():
    cell = Cell()
    cell.wait(100.0, beating=False)
    assert FeederStatusBits.WATCHDOG_TRIPPED not in cell.status
    cell.write("COMMAND", REMOTE)
    cell.wait(0.9, beating=False)
    assert FeederStatusBits.WATCHDOG_TRIPPED not in cell.status
    cell.write("COMMAND", 0)
    cell.wait(100.0, beating=False)
    assert FeederStatusBits.WATCHDOG_TRIPPED not in cell.status


def test_an_empty_hopper_is_an_alarm_and_stops_powder():
    cell = Cell(hopper(fill_g=5.0))
    cell.feed(20.0)
    cell.wait(8.0)
    assert cell.state is FeederStateCode.FAULT
    assert cell.read("FIRST_ALARM_CODE") == 207
    assert cell.read("ALARM") == 1 << 8
    assert cell.read("H1.ALARM") == 1 << 6
    assert (cell.read("H1.WEIGHT"), cell.read("H1.LEVEL")) == (0.0, 0.0)
    assert HopperStatusBits.LEVEL_EMPTY | HopperStatusBits.FAULT in HopperStatusBits(
        cell.read("H1.STATUS"))
    assert cell.refused("ALARM_RESET", 1) == REFUSED


def test_a_low_level_is_a_warning_only():
    cell = Cell(hopper(fill_g=5.0))
    cell.feed(20.0)
    cell.wait(5.3)
    assert cell.read("WARNING") == 1
    assert cell.state is FeederStateCode.FEEDING


def test_the_first_alarm_is_kept_apart():
    cell = Cell()
    cell.feed(6.0)
    cell.wait(2.0, beating=False)
    cell.device.set_estop_open(True)
    assert cell.read("FIRST_ALARM_CODE") == 104
    assert cell.read("ALARM") == 1 << 0 | 1 << 3
    assert cell.read("ALARM_COUNT") == 2


def test_an_open_estop_chain_stops_everything_and_must_be_reset():
    cell = Cell()
    cell.feed(6.0)
    cell.device.set_estop_open(True)
    assert (cell.state, cell.disc_rpm(), cell.read("TOTAL_GAS")) == (FeederStateCode.ESTOP, 0.0,
                                                                     0.0)
    assert FeederStatusBits.ESTOP_CHAIN_OK not in cell.status
    assert cell.refused("COMMAND", GAS) == REFUSED
    assert cell.refused("ALARM_RESET", 1) == REFUSED
    cell.device.set_estop_open(False)
    assert cell.state is FeederStateCode.ESTOP
    cell.write("ALARM_RESET", 1)
    assert cell.state is FeederStateCode.READY


def test_local_takes_the_host_out_of_command():
    cell = Cell()
    cell.feed(6.0)
    cell.device.set_local_mode(True)
    assert cell.disc_rpm() == 0.0
    assert cell.read("MODE") == FeederMode.LOCAL
    assert FeederStatusBits.REMOTE not in cell.status
    assert cell.refused("HEARTBEAT", 5) == REFUSED
    assert cell.read("LAST_REFUSAL") == WriteRefusalCode.NOT_REMOTE
    cell.device.set_local_mode(False)
    cell.write("COMMAND", REMOTE)
    assert FeederStatusBits.REMOTE in cell.status


def test_a_restart_forgets_all_but_the_stored_configuration():
    cell = Cell(boot_s=2.0)
    cell.t += 3.0
    cell.write("H1.FEED_FACTOR", 4.0)
    cell.feed(6.0)
    cell.device.restart()
    assert cell.state is FeederStateCode.BOOT
    assert cell.refused("HEARTBEAT", 9) == BUSY
    cell.wait(2.0, beating=False)
    assert cell.state is FeederStateCode.NOT_READY
    assert (cell.read("UPTIME"), cell.read("SEQ_APPLIED"), cell.read("COMMAND")) == (2, 0, 0)
    assert cell.read("H1.FEED_FACTOR") == 4.0
    assert cell.disc_rpm() == 0.0
