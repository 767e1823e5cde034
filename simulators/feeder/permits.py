"""Which writes a PMX device refuses in the state it is in, and why (exception 04)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from firmware_protocol.pmx import ALARM_RESET_KEY, PMX, WATCHDOG_RESET_KEY, Command, Refusal
from simulators.feeder.alarms import AlarmBook
from simulators.feeder.holding import CONFIGURATION
from simulators.modbus_refusal import ILLEGAL_VALUE, RefusedError

COMMAND = PMX.wire_address("COMMAND")
WD_TIMEOUT = PMX.wire_address("WD_TIMEOUT")
WD_RESET = PMX.wire_address("WD_RESET")
ALARM_RESET = PMX.wire_address("ALARM_RESET")

_KNOWN_COMMANDS = sum(Command)
_SHORTEST_WATCHDOG_MS = 100


class Feeder(Protocol):
    """What decides: the LOCAL switch, turning discs, latched trip and alarms, and their causes."""

    local: bool
    discs_on: bool
    watchdog_tripped: bool
    alarms: AlarmBook
    estop_open: bool

    def cause_stands(self) -> bool: ...


def objection(feeder: Feeder, new: Mapping[int, int]) -> Refusal:
    """Why a write of {address: word} is refused; Refusal.NONE where it is not.

    Raises RefusedError(ILLEGAL_VALUE) for words without meaning.
    """
    if feeder.local:
        return Refusal.NOT_REMOTE
    timeout_ms = new.get(WD_TIMEOUT, _SHORTEST_WATCHDOG_MS)
    if timeout_ms == 0:
        return Refusal.WATCHDOG_NEEDED
    if (
        timeout_ms < _SHORTEST_WATCHDOG_MS
        or new.get(COMMAND, 0) & ~_KNOWN_COMMANDS
        or new.get(WD_RESET, 0) not in (0, WATCHDOG_RESET_KEY)
    ):
        raise RefusedError(ILLEGAL_VALUE)
    if feeder.discs_on and max(new) >= CONFIGURATION:
        return Refusal.POWDER_RUNNING
    trip_remains = feeder.watchdog_tripped and new.get(WD_RESET) != WATCHDOG_RESET_KEY
    resets = new.get(ALARM_RESET) == ALARM_RESET_KEY
    if resets and (trip_remains or feeder.estop_open or feeder.cause_stands()):
        return Refusal.CAUSE_REMAINS
    if COMMAND not in new:
        return Refusal.NONE
    faulted = trip_remains or (bool(feeder.alarms) and not resets)
    return _command_objection(Command(new[COMMAND]), feeder.estop_open, faulted)


def _command_objection(wanted: Command, estop_open: bool, faulted: bool) -> Refusal:
    moves = wanted & (Command.GAS_ON | Command.FEED_ON | Command.PURGE)
    if moves and Command.ENABLE_REMOTE not in wanted:
        return Refusal.NOT_REMOTE
    if faulted and Command.FEED_ON in wanted:
        return Refusal.FAULTED
    if estop_open and Command.GAS_ON in wanted:
        return Refusal.FAULTED
    if Command.FEED_ON in wanted and Command.GAS_ON not in wanted:
        return Refusal.NO_GAS
    return Refusal.NONE
