"""The PMX device by its registers alone, as a host sees it, with a clock moved by hand."""

import numpy as np
import pytest

from firmware_protocol.pmx import (
    MIRROR,
    PMX,
    SYSTEM_BLOCK,
    WATCHDOG_RESET_KEY,
    Command,
    HopperFlags,
    Mode,
    Refusal,
    State,
    Status,
    WatchdogAction,
    hopper_names,
    hopper_row,
    recipe_names,
    register_map,
)
from firmware_protocol.registers import Kind
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.feeder.device import PmxDevice
from simulators.feeder.readings import read_holding, read_input
from simulators.modbus_refusal import BUSY, ILLEGAL_ADDRESS, ILLEGAL_VALUE, REFUSED, RefusedError

REMOTE = Command.ENABLE_REMOTE
GAS = REMOTE | Command.GAS_ON
FEED = GAS | Command.FEED_ON


def hopper(channel: int = 1, **changes) -> HopperConfig:
    settings = {
        "channel": channel, "material": "316L", "density_g_mm3": 0.008, "catch_efficiency": 0.7,
        "dead_time_s": 3.0, "lag_s": 1.0, "feed_factor_g_rev": 2.0, "n_min_rpm": 0.3,
        "n_max_rpm": 20.0, "fill_g": 1000.0,
    }
    return HopperConfig(**{**settings, **changes})


class Cell:
    """A device, its clock, and the host's habits."""

    def __init__(self, *hoppers: HopperConfig, **settings) -> None:
        self.t = 100.0
        config = FeederConfig("F1", hoppers or (hopper(),), **settings)
        self.device = PmxDevice(config, lambda: self.t)
        self.n = len(config.hoppers)
        self.beats = 0

    def wait(self, seconds: float, *, beating: bool = True) -> None:
        """Let time pass; a beating host writes its heartbeat four times a second."""
        end = self.t + seconds
        while beating and self.t + 0.25 < end:
            self.t += 0.25
            self.beat()
        self.t = end

    def beat(self) -> None:
        self.beats += 1
        self.write("HEARTBEAT", self.beats)

    def write(self, name: str, value) -> None:
        self.device.write(PMX.wire_address(name), PMX.encode(name, value))

    def refused(self, name: str, value) -> int:
        with pytest.raises(RefusedError) as caught:
            self.write(name, value)
        return caught.value.code

    def recipe(self, *flows_g_min: float, seq: int, ramp_s: float = 0.0, **more) -> None:
        """One write from HEARTBEAT to the last shadow register."""
        self.beats += 1
        table = register_map(self.n)
        values = dict.fromkeys(recipe_names(self.n), 0)
        values |= {"HEARTBEAT": self.beats, "WD_TIMEOUT": 1000, "WD_ACTION": 1, "SEQ": seq,
                   "RAMP": ramp_s, "STABILISE": 8.0, "POSTFLOW": 10.0, "SETPOINT_MODE": 1,
                   "AT_SPEED_TOL": 2.0}
        for channel, flow in enumerate(flows_g_min, 1):
            values[hopper_row(channel, "FLOW_SP")] = flow
            values[hopper_row(channel, "CARRIER_SP")] = 4.0
        block = table.block(recipe_names(self.n))
        self.device.write(block.address, block.encode(values | more))

    def read(self, name: str):
        row = PMX[name]
        read = read_input if row.kind is Kind.INPUT else read_holding
        return PMX.decode(name, read(self.device, PMX.wire_address(name), row.words))

    @property
    def state(self) -> State:
        return State(self.read("STATE"))

    @property
    def status(self) -> Status:
        return Status(self.read("STATUS"))

    def feed(self, *flows_g_min: float) -> None:
        """Take command and run powder until it is stable."""
        self.write("COMMAND", REMOTE)
        self.recipe(*flows_g_min, seq=1)
        self.write("COMMAND", FEED)
        self.wait(11.5)
        assert self.state is State.FEEDING

    def disc_rpm(self, channel: int = 1) -> float:
        return self.read(hopper_row(channel, "DISC_ACT"))


def test_it_says_what_it_is():
    cell = Cell(hopper(1), hopper(2))
    assert cell.read("DEVICE_ID") == 0x504D
    assert cell.read("MAP_VERSION") == 0x0101
    assert cell.read("N_HOPPERS") == 2
    assert cell.read("MODE") == Mode.REMOTE
    assert cell.read("UPTIME") == 0
    cell.wait(65.7, beating=False)
    assert cell.read("UPTIME") == 65
    assert cell.read("TICK") == 165_700 % 65_536


def test_the_way_from_rest_to_feeding_and_back():
    cell = Cell()
    assert cell.state is State.NOT_READY
    cell.write("COMMAND", REMOTE)
    assert cell.state is State.READY
    cell.recipe(6.0, seq=1)
    cell.write("COMMAND", GAS)
    assert cell.state is State.GAS_PREFLOW
    assert Status.GAS_OK not in cell.status
    assert cell.read("TOTAL_GAS") == 4.0
    cell.wait(3.0)
    assert Status.GAS_OK in cell.status
    assert cell.disc_rpm() == 0.0
    cell.write("COMMAND", FEED)
    assert cell.state is State.STABILISING
    assert cell.disc_rpm() == 3.0
    assert cell.read("TOTAL_FLOW") == 6.0
    cell.wait(7.9)
    assert Status.STABLE not in cell.status
    cell.wait(0.2)
    assert cell.state is State.FEEDING
    assert Status.STABLE | Status.AT_SETPOINT | Status.FEEDING in cell.status
    cell.write("COMMAND", REMOTE)
    assert cell.state is State.STOPPING
    assert cell.disc_rpm() == 0.0
    assert cell.read("TOTAL_GAS") == 4.0  # post-flow
    cell.wait(10.1)
    assert cell.state is State.READY
    assert cell.read("TOTAL_GAS") == 0.0
    cell.write("COMMAND", 0)
    assert cell.state is State.NOT_READY


def test_powder_waits_for_the_gas():
    cell = Cell()
    cell.write("COMMAND", REMOTE)
    cell.recipe(6.0, seq=1)
    cell.write("COMMAND", FEED)
    cell.wait(2.9)
    assert (cell.state, cell.disc_rpm()) == (State.GAS_PREFLOW, 0.0)
    cell.wait(0.2)
    assert (cell.state, cell.disc_rpm()) == (State.STABILISING, 3.0)
    # the discs started at 3 s exactly, though nobody looked then
    span = cell.device.spans[-1]
    assert (span.start_s, span.stable_s) == (103.0, 111.0)


def test_a_shorter_post_flow_counts_at_once():
    cell = Cell()
    cell.feed(6.0)
    cell.write("COMMAND", REMOTE)
    cell.wait(1.0)
    assert cell.state is State.STOPPING
    cell.write("POSTFLOW", 0.0)
    assert cell.state is State.READY
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
    assert Status.RAMPING in cell.status
    assert Status.AT_SETPOINT not in cell.status
    cell.wait(1.0)
    assert cell.read("H1.DISC_RAMPED") == 4.0
    cell.wait(1.0)
    assert cell.disc_rpm() == 5.0
    assert Status.AT_SETPOINT in cell.status


def test_rpm_mode():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(0.0, seq=2, SETPOINT_MODE=0, **{"H1.DISC_SP": 7.5})
    assert cell.disc_rpm() == 7.5


def test_a_set_point_beyond_the_disc_is_clipped_and_told():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(50.0, seq=2)
    assert cell.disc_rpm() == 20.0
    assert HopperFlags.LIMITED in HopperFlags(cell.read("H1.STATUS"))
    assert cell.read("WARNING") == 1 << 4


def test_a_set_point_below_the_least_speed_stands_still_and_is_told():
    cell = Cell()
    cell.feed(6.0)
    cell.recipe(0.5, seq=2)
    assert cell.disc_rpm() == 0.0
    flags = HopperFlags(cell.read("H1.STATUS"))
    assert HopperFlags.BELOW_N_MIN in flags
    assert HopperFlags.AT_SETPOINT not in flags


@pytest.mark.parametrize(
    ("action", "state", "rpm", "gas"),
    [
        (WatchdogAction.HOLD, State.FEEDING, 3.0, 4.0),
        (WatchdogAction.DISCS_STOP, State.STOPPING, 0.0, 4.0),
        (WatchdogAction.ALL_STOP, State.FAULT, 0.0, 0.0),
    ],
)
def test_a_silent_host_trips_the_watchdog(action, state, rpm, gas):
    cell = Cell()
    cell.feed(6.0)
    cell.write("WD_ACTION", action)
    cell.beat()
    cell.wait(0.999, beating=False)
    assert Status.WATCHDOG_TRIPPED not in cell.status
    cell.wait(0.5, beating=False)
    assert Status.WATCHDOG_TRIPPED | Status.ALARM in cell.status
    assert cell.read("FIRST_ALARM_CODE") == 104
    assert (cell.disc_rpm(), cell.read("TOTAL_GAS")) == (rpm, gas)
    if action is WatchdogAction.DISCS_STOP:
        assert cell.state is State.FAULT
    else:
        assert cell.state is state


def test_powder_stops_when_the_watchdog_says_though_nobody_asks_until_later():
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
    assert Status.WATCHDOG_TRIPPED in cell.status


def test_nothing_starts_by_itself_after_a_trip():
    cell = Cell()
    cell.feed(6.0)
    cell.wait(2.0, beating=False)
    assert cell.read("COMMAND") == GAS  # the device took FEED_ON back
    cell.beat()
    assert cell.refused("COMMAND", FEED) == REFUSED
    assert cell.read("LAST_REFUSAL") == Refusal.FAULTED
    assert cell.refused("ALARM_RESET", 1) == REFUSED
    assert cell.read("LAST_REFUSAL") == Refusal.CAUSE_REMAINS
    assert cell.refused("WD_RESET", 1) == ILLEGAL_VALUE
    cell.write("WD_RESET", WATCHDOG_RESET_KEY)
    assert cell.refused("COMMAND", FEED) == REFUSED
    cell.write("ALARM_RESET", 1)
    assert cell.read("FIRST_ALARM_CODE") == 0
    assert cell.read("ALARM_COUNT") == 1
    assert cell.disc_rpm() == 0.0
    cell.write("COMMAND", FEED)
    assert cell.state is State.STABILISING


def test_the_watchdog_watches_only_a_host_in_command():
    cell = Cell()
    cell.wait(100.0, beating=False)
    assert Status.WATCHDOG_TRIPPED not in cell.status
    cell.write("COMMAND", REMOTE)
    cell.wait(0.9, beating=False)
    assert Status.WATCHDOG_TRIPPED not in cell.status
    cell.write("COMMAND", 0)
    cell.wait(100.0, beating=False)
    assert Status.WATCHDOG_TRIPPED not in cell.status


def test_an_empty_hopper_is_an_alarm_and_stops_powder():
    cell = Cell(hopper(fill_g=5.0))
    cell.feed(20.0)
    cell.wait(8.0)
    assert cell.state is State.FAULT
    assert cell.read("FIRST_ALARM_CODE") == 207
    assert cell.read("ALARM") == 1 << 8
    assert cell.read("H1.ALARM") == 1 << 6
    assert (cell.read("H1.WEIGHT"), cell.read("H1.LEVEL")) == (0.0, 0.0)
    assert HopperFlags.LEVEL_EMPTY | HopperFlags.FAULT in HopperFlags(cell.read("H1.STATUS"))
    assert cell.refused("ALARM_RESET", 1) == REFUSED


def test_a_low_level_is_a_warning_only():
    cell = Cell(hopper(fill_g=5.0))
    cell.feed(20.0)
    cell.wait(5.3)
    assert cell.read("WARNING") == 1
    assert cell.state is State.FEEDING


def test_the_first_alarm_is_kept_apart():
    cell = Cell()
    cell.feed(6.0)
    cell.wait(2.0, beating=False)
    cell.device.open_estop_chain(True)
    assert cell.read("FIRST_ALARM_CODE") == 104
    assert cell.read("ALARM") == 1 << 0 | 1 << 3
    assert cell.read("ALARM_COUNT") == 2


def test_an_open_estop_chain_stops_everything_and_must_be_reset():
    cell = Cell()
    cell.feed(6.0)
    cell.device.open_estop_chain(True)
    assert (cell.state, cell.disc_rpm(), cell.read("TOTAL_GAS")) == (State.ESTOP, 0.0, 0.0)
    assert Status.ESTOP_CHAIN_OK not in cell.status
    assert cell.refused("COMMAND", GAS) == REFUSED
    assert cell.refused("ALARM_RESET", 1) == REFUSED
    cell.device.open_estop_chain(False)
    assert cell.state is State.ESTOP
    cell.write("ALARM_RESET", 1)
    assert cell.state is State.READY


def test_local_takes_the_host_out_of_command():
    cell = Cell()
    cell.feed(6.0)
    cell.device.turn_local(True)
    assert cell.disc_rpm() == 0.0
    assert cell.read("MODE") == Mode.LOCAL
    assert Status.REMOTE not in cell.status
    assert cell.refused("HEARTBEAT", 5) == REFUSED
    assert cell.read("LAST_REFUSAL") == Refusal.NOT_REMOTE
    cell.device.turn_local(False)
    cell.write("COMMAND", REMOTE)
    assert Status.REMOTE in cell.status


def test_a_restart_forgets_all_but_the_stored_configuration():
    cell = Cell(boot_s=2.0)
    cell.t += 3.0
    cell.write("H1.FEED_FACTOR", 4.0)
    cell.feed(6.0)
    cell.device.restart()
    assert cell.state is State.BOOT
    assert cell.refused("HEARTBEAT", 9) == BUSY
    cell.wait(2.0, beating=False)
    assert cell.state is State.NOT_READY
    assert (cell.read("UPTIME"), cell.read("SEQ_APPLIED"), cell.read("COMMAND")) == (2, 0, 0)
    assert cell.read("H1.FEED_FACTOR") == 4.0
    assert cell.disc_rpm() == 0.0


def test_the_stored_feed_factor_is_what_the_device_believes_not_what_is_true():
    cell = Cell(hopper(feed_factor_g_rev=2.0, calibrated_g_rev=2.5))
    cell.feed(5.0)
    assert cell.disc_rpm() == 2.0
    assert cell.read("H1.FLOW_EST") == 5.0
    assert cell.read("H1.FLOW_LIW") == 4.0
    assert cell.refused("H1.FEED_FACTOR", 2.0) == REFUSED
    assert cell.read("LAST_REFUSAL") == Refusal.POWDER_RUNNING


@pytest.mark.parametrize(
    ("name", "value", "code", "reason"),
    [
        ("COMMAND", Command.GAS_ON, REFUSED, Refusal.NOT_REMOTE),
        ("COMMAND", REMOTE | Command.FEED_ON, REFUSED, Refusal.NO_GAS),
        ("COMMAND", 1 << 7, ILLEGAL_VALUE, None),
        ("WD_TIMEOUT", 0, REFUSED, Refusal.WATCHDOG_NEEDED),
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
    with pytest.raises(RefusedError) as caught:
        cell.device.write(address, words)
    assert caught.value.code == code
    assert read_holding(cell.device, 0, 24) == before


@pytest.mark.parametrize(("address", "count"), [(24, 1), (23, 2), (99, 2), (119, 2), (200, 1),
                                                (0, 25), (60_000, 1)])
def test_input_registers_that_are_not_there(address, count):
    with pytest.raises(RefusedError) as caught:
        read_input(Cell().device, address, count)
    assert caught.value.code == ILLEGAL_ADDRESS


def test_every_input_register_of_the_table_is_there_and_reads_as_it_should():
    cell = Cell(hopper(1), hopper(2))
    cell.feed(6.0, 2.0)
    for name in (*(row.name for row in SYSTEM_BLOCK.rows), *hopper_names(1), *hopper_names(2)):
        cell.read(name)
    assert cell.read("H2.FLOW_EST") == 2.0
    assert cell.read("H1.LEVEL") == pytest.approx(100.0, abs=0.2)
    assert cell.read("H1.TORQUE") is None


def test_the_mirror_shows_input_registers_where_the_map_has_it():
    cell = Cell()
    assert read_holding(cell.device, MIRROR, 24) == read_input(cell.device, 0, 24)
    whole = read_input(cell.device, 0, 24) + read_input(cell.device, 100, 20)
    assert read_holding(cell.device, MIRROR, 44) == whole
    assert read_holding(cell.device, MIRROR + 24, 20) == whole[24:]
    for address, count in ((MIRROR, 45), (MIRROR + 44, 1), (MIRROR + 100, 1)):
        with pytest.raises(RefusedError):
            read_holding(cell.device, address, count)
    old = Cell(map_minor=0)
    assert old.read("MAP_VERSION") == 0x0100
    with pytest.raises(RefusedError):
        read_holding(old.device, MIRROR, 24)


def test_the_mirror_of_a_hopper_that_is_not_there_is_zeros():
    cell = Cell(hopper(1), hopper(3))
    said = read_holding(cell.device, MIRROR, 84)
    assert said[24:44] == read_input(cell.device, 100, 20)
    assert said[44:64] == [0] * 20
    assert said[64:] == read_input(cell.device, 300, 20)


def test_toggle_and_tick_move():
    cell = Cell()
    before = cell.status & Status.TOGGLE, cell.read("TICK")
    cell.t += 0.15
    assert (cell.status & Status.TOGGLE) != before[0]
    assert cell.read("TICK") == (before[1] + 150) % 65_536
