"""The effect of real-time bytes on the overrides (Grbl 1.1 `doc/markdown/commands.md`)."""

from __future__ import annotations

from firmware_protocol.realtime import RealtimeCommand

NO_OVERRIDE = (100, 100, 100)
"""Feed, rapid and spindle as programmed [%]."""

_LEAST, _MOST = 10, 200
_FEED, _RAPID, _SPINDLE = range(3)

_SETS = {
    RealtimeCommand.FEED_100: (_FEED, 100), RealtimeCommand.SPINDLE_100: (_SPINDLE, 100),
    RealtimeCommand.RAPID_100: (_RAPID, 100), RealtimeCommand.RAPID_50: (_RAPID, 50),
    RealtimeCommand.RAPID_25: (_RAPID, 25),
}
_ADDS = {
    RealtimeCommand.FEED_PLUS_10: (_FEED, 10), RealtimeCommand.FEED_MINUS_10: (_FEED, -10),
    RealtimeCommand.FEED_PLUS_1: (_FEED, 1), RealtimeCommand.FEED_MINUS_1: (_FEED, -1),
    RealtimeCommand.SPINDLE_PLUS_10: (_SPINDLE, 10),
    RealtimeCommand.SPINDLE_MINUS_10: (_SPINDLE, -10),
    RealtimeCommand.SPINDLE_PLUS_1: (_SPINDLE, 1), RealtimeCommand.SPINDLE_MINUS_1: (_SPINDLE, -1),
}


def overrides_after_byte(byte: RealtimeCommand, overrides: tuple[int, int, int]) -> tuple[int, int,
                                                                                          int]:
    """The overrides [%] after a real-time byte; unchanged by one that is no override."""
    values = list(overrides)
    if byte in _SETS:
        which, percent = _SETS[byte]
        values[which] = percent
    elif byte in _ADDS:
        which, step = _ADDS[byte]
        values[which] = min(max(values[which] + step, _LEAST), _MOST)
    else:
        return overrides
    return values[0], values[1], values[2]
