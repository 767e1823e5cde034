"""Override bytes and what each does to (feed, rapid, spindle) percent."""

from __future__ import annotations

from firmware_protocol.realtime import Realtime

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

OVERRIDES = frozenset(
    (*_FEED_STEPS, *_RAPIDS, *_SPINDLE_STEPS, Realtime.FEED_100, Realtime.SPINDLE_100)
)


def overridden(byte: int, percent: Percent) -> Percent:
    """The overrides after one of OVERRIDES; not yet clipped to 10..200."""
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
