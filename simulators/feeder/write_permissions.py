"""Which writes a PMX device refuses in the state it is in, and why (exception 04)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from firmware_protocol.pmx import (
    ALARM_RESET_KEY,
    FIRST_CONFIGURATION_REGISTER,
    PMX_MAP,
    WATCHDOG_RESET_KEY,
    FeederCommandBits,
    WriteRefusalCode,
)
from simulators.feeder.alarms import AlarmLatch
from simulators.modbus_errors import ILLEGAL_VALUE, ExceptionReplyError

COMMAND_ADDRESS = PMX_MAP.wire_address("COMMAND")
WATCHDOG_TIMEOUT_ADDRESS = PMX_MAP.wire_address("WD_TIMEOUT")
WATCHDOG_RESET_ADDRESS = PMX_MAP.wire_address("WD_RESET")
ALARM_RESET_ADDRESS = PMX_MAP.wire_address("ALARM_RESET")

_KNOWN_COMMANDS = sum(FeederCommandBits)
_MIN_WATCHDOG_MS = 100


class FeederCondition(Protocol):
    """State checked: LOCAL switch, turning discs, latched trip and alarms, and their causes."""

    local: bool
    discs_on: bool
    watchdog_tripped: bool
    alarms: AlarmLatch
    estop_open: bool

    def alarm_cause_persists(self) -> bool: ...


def reason_refused(feeder: FeederCondition, new: Mapping[int, int]) -> WriteRefusalCode:
    """Why a write of {address: word} is refused; WriteRefusalCode.NONE if allowed.

    Raises ExceptionReplyError(ILLEGAL_VALUE) for words without meaning.
    """
    if feeder.local:
        return WriteRefusalCode.NOT_REMOTE
    timeout_ms = new.get(WATCHDOG_TIMEOUT_ADDRESS, _MIN_WATCHDOG_MS)
    if timeout_ms == 0:
        return WriteRefusalCode.WATCHDOG_NEEDED
    if (
        timeout_ms < _MIN_WATCHDOG_MS
        or new.get(COMMAND_ADDRESS, 0) & ~_KNOWN_COMMANDS
        or new.get(WATCHDOG_RESET_ADDRESS, 0) not in (0, WATCHDOG_RESET_KEY)
    ):
        raise ExceptionReplyError(ILLEGAL_VALUE)
    if feeder.discs_on and max(new) >= FIRST_CONFIGURATION_REGISTER:
        return WriteRefusalCode.POWDER_RUNNING
    trip_remains = feeder.watchdog_tripped and new.get(WATCHDOG_RESET_ADDRESS) != WATCHDOG_RESET_KEY
    resets = new.get(ALARM_RESET_ADDRESS) == ALARM_RESET_KEY
    if resets and (trip_remains or feeder.estop_open or feeder.alarm_cause_persists()):
        return WriteRefusalCode.CAUSE_REMAINS
    if COMMAND_ADDRESS not in new:
        return WriteRefusalCode.NONE
    faulted = trip_remains or (bool(feeder.alarms) and not resets)
    return _command_objection(FeederCommandBits(new[COMMAND_ADDRESS]), feeder.estop_open, faulted)


def _command_objection(wanted: FeederCommandBits, estop_open: bool,
                       faulted: bool) -> WriteRefusalCode:
    moves = wanted & (
        FeederCommandBits.GAS_ON | FeederCommandBits.FEED_ON | FeederCommandBits.PURGE)
    if moves and FeederCommandBits.ENABLE_REMOTE not in wanted:
        return WriteRefusalCode.NOT_REMOTE
    if faulted and FeederCommandBits.FEED_ON in wanted:
        return WriteRefusalCode.FAULTED
    if estop_open and FeederCommandBits.GAS_ON in wanted:
        return WriteRefusalCode.FAULTED
    if FeederCommandBits.FEED_ON in wanted and FeederCommandBits.GAS_ON not in wanted:
        return WriteRefusalCode.NO_GAS
    return WriteRefusalCode.NONE
