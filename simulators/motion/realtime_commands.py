"""Real-time bytes that act on the machine alone."""

from __future__ import annotations

from firmware_protocol.realtime import Realtime
from simulators.motion.machine import Machine

Percent = tuple[int, int, int]

_FEED_STEPS = {
    Realtime.FEED_PLUS_10: 10,
    Realtime.FEED_MINUS_10: -10,
    Realtime.FEED_PLUS_1: 1,
    Realtime.FEED_MINUS_1: -1,
}
_RAPIDS = {Realtime.RAPID_100: 100, Realtime.RAPID_50: 50, Realtime.RAPID_25: 25}
_SPINDLE_STEPS = {
    Realtime.SPINDLE_PLUS_10: 10,
    Realtime.SPINDLE_MINUS_10: -10,
    Realtime.SPINDLE_PLUS_1: 1,
    Realtime.SPINDLE_MINUS_1: -1,
}

_OVERRIDES = frozenset(
    (*_FEED_STEPS, *_RAPIDS, *_SPINDLE_STEPS, Realtime.FEED_100, Realtime.SPINDLE_100)
)


def act(machine: Machine, byte: int) -> None:
    """What the byte does, as far as the machine's state lets it; unknown ones do nothing."""
    if byte in (Realtime.HOLD, Realtime.HOLD_TOP):
        machine.hold()
    elif byte in (Realtime.START, Realtime.START_TOP):
        machine.resume()
    elif byte == Realtime.DOOR:
        machine.door()
    elif byte == Realtime.JOG_CANCEL:
        machine.cancel_jog()
    elif byte in _OVERRIDES:
        machine.set_overrides(*_overridden(byte, machine.overrides))
    elif byte == Realtime.SPINDLE_STOP:
        machine.toggle_spindle_stop()
    elif byte == Realtime.FLOOD:
        machine.toggle_coolant(mist=False)
    elif byte == Realtime.MIST and machine.hal:
        machine.toggle_coolant(mist=True)


def _overridden(byte: int, percent: Percent) -> Percent:
    """The overrides after one of _OVERRIDES; not yet clipped to 10..200."""
    feed, rapid, spindle = percent
    if byte == Realtime.FEED_100:
        feed = 100
    elif byte == Realtime.SPINDLE_100:
        spindle = 100
    else:
        known = Realtime(byte)
        feed += _FEED_STEPS.get(known, 0)
        spindle += _SPINDLE_STEPS.get(known, 0)
        rapid = _RAPIDS.get(known, rapid)
    return feed, rapid, spindle
