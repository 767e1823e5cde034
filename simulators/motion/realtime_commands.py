"""Real-time bytes that act on the machine alone."""

from __future__ import annotations

from firmware_protocol.realtime import RealtimeCommand
from simulators.motion.machine import MotionMachine

Percent = tuple[int, int, int]

_FEED_STEPS = {
    RealtimeCommand.FEED_PLUS_10: 10,
    RealtimeCommand.FEED_MINUS_10: -10,
    RealtimeCommand.FEED_PLUS_1: 1,
    RealtimeCommand.FEED_MINUS_1: -1,
}
_RAPIDS = {RealtimeCommand.RAPID_100: 100, RealtimeCommand.RAPID_50: 50,
           RealtimeCommand.RAPID_25: 25}
_SPINDLE_STEPS = {
    RealtimeCommand.SPINDLE_PLUS_10: 10,
    RealtimeCommand.SPINDLE_MINUS_10: -10,
    RealtimeCommand.SPINDLE_PLUS_1: 1,
    RealtimeCommand.SPINDLE_MINUS_1: -1,
}

_OVERRIDES = frozenset(
    (*_FEED_STEPS, *_RAPIDS, *_SPINDLE_STEPS, RealtimeCommand.FEED_100, RealtimeCommand.SPINDLE_100)
)


def apply_realtime_command(machine: MotionMachine, byte: int) -> None:
    """Perform the byte's command if the machine's state allows it. Unknown bytes do nothing."""
    if byte in (RealtimeCommand.HOLD, RealtimeCommand.HOLD_TOP):
        machine.enter_hold()
    elif byte in (RealtimeCommand.START, RealtimeCommand.START_TOP):
        machine.resume()
    elif byte == RealtimeCommand.DOOR:
        machine.enter_door_stop()
    elif byte == RealtimeCommand.JOG_CANCEL:
        machine.cancel_jog()
    elif byte in _OVERRIDES:
        machine.set_overrides(*_overridden(byte, machine.overrides))
    elif byte == RealtimeCommand.SPINDLE_STOP:
        machine.toggle_spindle_stop()
    elif byte == RealtimeCommand.FLOOD:
        machine.toggle_coolant(mist=False)
    elif byte == RealtimeCommand.MIST and machine.hal:
        machine.toggle_coolant(mist=True)


def _overridden(byte: int, percent: Percent) -> Percent:
    """The overrides after one byte of _OVERRIDES; not yet clipped to 10..200."""
    feed, rapid, spindle = percent
    if byte == RealtimeCommand.FEED_100:
        feed = 100
    elif byte == RealtimeCommand.SPINDLE_100:
        spindle = 100
    else:
        known = RealtimeCommand(byte)
        feed += _FEED_STEPS.get(known, 0)
        spindle += _SPINDLE_STEPS.get(known, 0)
        rapid = _RAPIDS.get(known, rapid)
    return feed, rapid, spindle
