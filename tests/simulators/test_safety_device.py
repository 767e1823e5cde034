"""The simulated safety-input device, each hand on it, by a hand-driven clock."""

import math

import pytest

from firmware_protocol.registers import RegisterError
from firmware_protocol.safety_io import (
    ALL_INPUTS_OK,
    CYCLIC_BLOCK,
    DEVICE_ID,
    FULL_BLOCK,
    MIRROR_ADDRESS,
    RELAY_FIRST_OUT_CODE,
    RELAY_RESET_KEY,
    SafetyInputBits,
    SafetyStatusBits,
    first_out_code_of_input,
)
from simulators.modbus_errors import ExceptionReplyError, RequestIgnoredError
from simulators.safety.config import SafetyConfig
from simulators.safety.device import SimulatedSafetyDevice


class Rig:
    """A device, its clock, and how often it told of a change."""

    def __init__(self, **config) -> None:
        self.now_s = 0.0
        self.device = SimulatedSafetyDevice(SafetyConfig(**config), lambda: self.now_s)
        self.changes = 0
        self.device.on_change = self._changed
        self.beats = 0

    def _changed(self) -> None:
        self.changes += 1

    def read(self) -> dict:
        words = self.device.read_input(0, FULL_BLOCK.count)
        mirrored = self.device.read_holding(MIRROR_ADDRESS + CYCLIC_BLOCK.address,
                                            CYCLIC_BLOCK.count)
        assert words[CYCLIC_BLOCK.address :] == mirrored
        return FULL_BLOCK.decode(words)

    def beat(self) -> None:
        self.beats += 1
        self.device.write(0, [self.beats])

    def inputs(self) -> SafetyInputBits:
        return SafetyInputBits(self.read()["INPUTS"])

    def status(self) -> SafetyStatusBits:
        return SafetyStatusBits(self.read()["STATUS"])


def test_at_power_up_all_is_good_and_the_relay_is_open():
    rig = Rig(watchdog_relay=True)
    reported = rig.read()
    assert reported["DEVICE_ID"] == DEVICE_ID
    assert reported["MAP_VERSION"] == 0x0101
    assert SafetyInputBits(reported["INPUTS"]) == ALL_INPUTS_OK
    assert SafetyStatusBits(
        reported["STATUS"]) == SafetyStatusBits.SELF_TEST_OK | SafetyStatusBits.RELAY_FITTED
    assert reported["HEARTBEAT_AGE"] == 0xFFFF
    assert (reported["FIRST_OUT"], reported["TRIP_COUNT"], reported["UPTIME"]) == (0, 0, 0)
    assert rig.device.is_relay_open
    assert not Rig().device.is_relay_open  # there is none


@pytest.mark.parametrize("one", list(SafetyInputBits))
def test_every_input_opens_and_closes_and_is_first_out(one):
    rig = Rig()
    rig.device.set_input(one, False)
    assert rig.inputs() == ALL_INPUTS_OK & ~one
    reported = rig.read()
    assert (reported["FIRST_OUT"], reported["TRIP_COUNT"]) == (first_out_code_of_input(one), 1)
    rig.device.set_input(one, True)
    assert rig.inputs() == ALL_INPUTS_OK
    assert rig.read()["FIRST_OUT"] == first_out_code_of_input(one)  # until it is reset
    rig.device.write(2, [RELAY_RESET_KEY])
    assert rig.read()["FIRST_OUT"] == 0
    assert rig.changes >= 2


def test_the_first_stays_the_first_and_every_opening_counts():
    rig = Rig()
    rig.device.set_door_open()
    rig.device.set_estop_open()
    rig.device.set_door_open(False)
    rig.device.set_door_open()
    reported = rig.read()
    assert (reported["FIRST_OUT"], reported["TRIP_COUNT"]) == (102, 3)
    rig.device.write(2, [RELAY_RESET_KEY])
    assert rig.read()["FIRST_OUT"] == 101  # still open, the first of them
    assert rig.device.is_door_open
    assert rig.device.is_estop_open


@pytest.mark.parametrize(
    ("act", "one"),
    [
        (lambda d: d.set_shield_gas(4.9), SafetyInputBits.SHIELD_GAS_OK),
        (lambda d: d.set_shield_gas(None), SafetyInputBits.SHIELD_GAS_OK),
        (lambda d: d.set_chiller(36.0, 10.0), SafetyInputBits.CHILLER_OK),
        (lambda d: d.set_chiller(22.0, 3.0), SafetyInputBits.CHILLER_OK),
        (lambda d: d.set_extraction(100), SafetyInputBits.EXTRACTION_OK),
        (lambda d: d.set_extraction(2500), SafetyInputBits.EXTRACTION_OK),
        (lambda d: d.set_analyser_invalid(), SafetyInputBits.OXYGEN_VALID),
    ],
)
def test_switches_follow_their_values(act, one):
    rig = Rig()
    act(rig.device)
    assert rig.inputs() == ALL_INPUTS_OK & ~one


def test_values_are_reported_as_set():
    rig = Rig()
    device = rig.device
    device.set_shield_gas(12.34)
    device.set_chiller(24.5, 8.0)
    device.set_oxygen(209_000.0)
    device.set_extraction(350)
    reported = rig.read()
    assert (reported["SHIELD_GAS"], reported["CHILLER_TEMP"]) == (12.34, 24.5)
    assert reported["CHILLER_FLOW"] == 8.0
    assert (reported["OXYGEN"], reported["EXTRACTION_DP"]) == (209_000.0, 350)
    device.set_oxygen(None)
    assert rig.read()["OXYGEN"] is None
    with pytest.raises(RegisterError, match="SHIELD_GAS must be between"):
        device.set_shield_gas(-1.0)
    assert rig.read()["SHIELD_GAS"] == 12.34


def test_the_relay_closes_by_its_key_and_opens_when_heartbeats_stop():
    rig = Rig(watchdog_relay=True)
    with pytest.raises(ExceptionReplyError) as refused:
        rig.device.write(2, [RELAY_RESET_KEY])
    assert refused.value.code == 4  # no heartbeat so far
    rig.device.write(0, [1, 200, RELAY_RESET_KEY])
    assert not rig.device.is_relay_open
    assert SafetyStatusBits.RELAY_CLOSED in rig.status()
    assert rig.device.read_holding(0, 3) == [1, 200, 0]
    rig.now_s = 0.15
    rig.device.write(0, [2])
    rig.now_s = 0.3
    rig.device.write(0, [2])  # the same number is no heartbeat
    assert rig.device.next_due_s() == pytest.approx(0.35)
    rig.now_s = 0.5
    assert rig.device.advance_to_now() == 0.5
    assert rig.device.is_relay_open
    assert rig.device.relay_opened_s == [pytest.approx(0.35)]
    reported = rig.read()
    assert (reported["FIRST_OUT"], reported["TRIP_COUNT"]) == (RELAY_FIRST_OUT_CODE, 1)
    assert reported["HEARTBEAT_AGE"] == 350
    rig.device.write(0, [3])
    assert rig.device.is_relay_open  # latched, until
    rig.device.write(2, [RELAY_RESET_KEY])
    assert not rig.device.is_relay_open


def test_the_laser_enable_output_comes_on_by_an_edge_while_the_relay_is_closed():
    rig = Rig(watchdog_relay=True, laser_enable=True)
    assert SafetyStatusBits.LASER_ENABLE_FITTED in rig.status()
    assert rig.device.is_laser_enable_off
    rig.device.write(0, [1, 200, 0, 1])
    assert rig.device.is_laser_enable_off  # the relay is open
    rig.device.write(0, [2, 200, RELAY_RESET_KEY, 1])
    assert rig.device.is_laser_enable_off  # that was no edge
    rig.device.write(3, [0])
    changes = rig.changes
    rig.device.write(0, [3, 200, 0, 1])
    assert not rig.device.is_laser_enable_off
    assert SafetyStatusBits.LASER_ENABLED in rig.status()
    assert rig.changes == changes + 1
    rig.device.write(0, [4, 200])  # who does not write it leaves it
    assert not rig.device.is_laser_enable_off
    assert rig.device.read_holding(0, 4) == [4, 200, 0, 1]
    rig.device.write(0, [5, 200, 0, 0])
    assert rig.device.is_laser_enable_off
    assert SafetyStatusBits.LASER_ENABLED not in rig.status()
    assert rig.changes == changes + 2


def test_the_laser_enable_output_drops_with_the_relay_and_no_heartbeat_brings_it_back():
    rig = Rig(watchdog_relay=True, laser_enable=True)
    rig.device.write(0, [1, 200, RELAY_RESET_KEY, 0])
    rig.device.write(3, [1])
    rig.now_s = 0.2
    rig.device.advance_to_now()
    assert rig.device.is_laser_enable_off
    rig.device.write(0, [2, 200, 0, 1])
    rig.device.write(0, [3, 200, RELAY_RESET_KEY, 1])
    assert not rig.device.is_relay_open
    assert rig.device.is_laser_enable_off
    rig.device.write(3, [0])
    rig.device.write(3, [1])
    assert not rig.device.is_laser_enable_off
    rig.device.restart()
    assert rig.device.is_laser_enable_off
    assert rig.device.read_holding(3, 1) == [0]


def test_a_stuck_output_is_read_back_as_it_is_and_follows_again():
    rig = Rig(watchdog_relay=True, laser_enable=True)
    rig.device.write(0, [1, 200, RELAY_RESET_KEY, 0])
    rig.device.set_output_stuck()
    rig.device.write(3, [1])
    assert SafetyStatusBits.LASER_ENABLED not in rig.status()
    rig.device.set_output_stuck(False)
    assert SafetyStatusBits.LASER_ENABLED in rig.status()
    rig.device.set_output_stuck()
    rig.device.restart()
    assert not rig.device.is_laser_enable_off
    assert SafetyStatusBits.LASER_ENABLED in rig.status()
    rig.device.set_output_stuck(False)
    assert rig.device.is_laser_enable_off


def test_a_welded_output_closes_the_circuit_whatever_is_commanded_until_it_is_free():
    rig = Rig(watchdog_relay=True, laser_enable=True)
    assert rig.device.is_laser_enable_off
    rig.device.weld_output()
    assert not rig.device.is_laser_enable_off
    assert SafetyStatusBits.LASER_ENABLED in rig.status()
    rig.device.write(0, [1, 200, RELAY_RESET_KEY, 0])
    rig.device.drop_output()
    assert not rig.device.is_laser_enable_off
    rig.device.set_output_stuck(False)
    assert rig.device.is_laser_enable_off


@pytest.mark.parametrize(
    ("config", "words", "code"), [({"laser_enable": True}, [2], 3), ({}, [1], 2)]
)
def test_the_laser_enable_output_takes_0_and_1_where_it_is_fitted(config, words, code):
    rig = Rig(watchdog_relay=True, **config)
    with pytest.raises(ExceptionReplyError) as refused:
        rig.device.write(3, words)
    assert refused.value.code == code
    assert not Rig().device.is_laser_enable_off  # there is none


def test_a_shorter_time_is_reported_to_whoever_waits_for_the_relay():
    rig = Rig(watchdog_relay=True)
    rig.device.write(0, [1, 5000, RELAY_RESET_KEY])
    changes = rig.changes
    rig.device.write(1, [100])
    assert rig.changes == changes + 1
    assert rig.device.next_due_s() == pytest.approx(0.1)


def test_other_words_do_not_reset_the_relay():
    rig = Rig(watchdog_relay=True)
    rig.beat()
    for word in (0, 1, 0xBECF, 0xFFFF):
        rig.device.write(2, [word])
        assert rig.device.is_relay_open


def test_frozen_its_inputs_and_tick_stand_still_while_heartbeats_are_echoed():
    rig = Rig()
    rig.beat()
    rig.now_s = 1.0
    rig.device.set_frozen()
    rig.device.set_door_open()
    rig.now_s = 2.0
    rig.beat()
    reported = rig.read()
    assert SafetyInputBits(reported["INPUTS"]) == ALL_INPUTS_OK
    assert (reported["TICK"], reported["UPTIME"]) == (1000, 1)
    assert (reported["HEARTBEAT_ECHO"], reported["HEARTBEAT_AGE"]) == (2, 0)
    rig.device.set_frozen(False)
    assert rig.read()["TICK"] == 2000
    assert SafetyInputBits.DOOR_CLOSED not in rig.inputs()


def test_silent_it_does_not_receive_either():
    rig = Rig(watchdog_relay=True)
    rig.device.write(0, [1, 100, RELAY_RESET_KEY])
    rig.device.set_silent()
    for request in (lambda: rig.read(), lambda: rig.device.read_holding(0, 1), rig.beat):
        with pytest.raises(RequestIgnoredError):
            request()
    rig.now_s = 0.1
    rig.device.advance_to_now()
    assert rig.device.is_relay_open
    rig.device.set_silent(False)
    assert SafetyInputBits(rig.read()["INPUTS"]) == ALL_INPUTS_OK


def test_exceptions_carry_nothing_out():
    rig = Rig()
    rig.device.reply_with_exception(6)
    with pytest.raises(ExceptionReplyError) as refused:
        rig.beat()
    assert refused.value.code == 6
    rig.device.reply_with_exception(None)
    assert rig.read()["HEARTBEAT_ECHO"] == 0


def test_a_restart_opens_the_relay_and_forgets():
    rig = Rig(watchdog_relay=True, boot_s=1.0)
    rig.now_s = 5.0
    rig.device.write(0, [7, 300, RELAY_RESET_KEY])
    rig.device.set_door_open()
    rig.device.restart()
    assert rig.device.is_relay_open
    reported = rig.read()
    assert (reported["UPTIME"], reported["HEARTBEAT_ECHO"], reported["TRIP_COUNT"]) == (0, 0, 0)
    assert reported["FIRST_OUT"] == 102  # it is still open
    assert rig.device.next_due_s() == math.inf
    with pytest.raises(ExceptionReplyError) as refused:
        rig.device.write(0, [8])
    assert refused.value.code == 6
    rig.now_s = 6.0
    rig.device.write(0, [8])


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        (lambda d: d.read_input(20, 2), 2), (lambda d: d.read_input(21, 1), 2),
        (lambda d: d.read_holding(3, 1), 2), (lambda d: d.read_holding(0, 4), 2),
        (lambda d: d.read_holding(MIRROR_ADDRESS + 21, 1), 2), (lambda d: d.write(3, [1]), 2),
        (lambda d: d.write(MIRROR_ADDRESS, [1]), 2), (lambda d: d.write(0, [1, 49]), 3),
        (lambda d: d.write(1, [60_001]), 3), (lambda d: d.write(0, [1, 100, 0, 0]), 2),
    ],
)
def test_what_is_not_there_or_out_of_limits(request_, code):
    rig = Rig()
    with pytest.raises(ExceptionReplyError) as refused:
        request_(rig.device)
    assert refused.value.code == code
    assert rig.device.read_holding(0, 3) == [0, 500, 0]
