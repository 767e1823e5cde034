"""Real-time bytes: picked out of the stream anywhere, never ended by a newline, never answered.

Sources: Grbl 1.1 `doc/markdown/commands.md`; grblHAL core `grbl/config.h` (top-bit aliases).
"""

from __future__ import annotations

from enum import IntEnum


class RealtimeCommand(IntEnum):
    """One byte the controller acts on as soon as it arrives, before all lines in its buffer."""

    RESET = 0x18
    STOP = 0x19  # grblHAL: stop without losing position or offsets
    HOLD = 0x21  # !
    STATUS = 0x3F  # ?
    START = 0x7E  # ~
    STATUS_TOP = 0x80  # grblHAL aliases with the top bit set, usable inside comments
    START_TOP = 0x81
    HOLD_TOP = 0x82
    PARSER_STATE = 0x83
    DOOR = 0x84
    JOG_CANCEL = 0x85
    STATUS_FULL = 0x87
    OPTIONAL_STOP = 0x88
    SINGLE_BLOCK = 0x89
    FAN = 0x8A
    MPG_MODE = 0x8B
    AUTO_REPORT = 0x8C
    FEED_100 = 0x90
    FEED_PLUS_10 = 0x91
    FEED_MINUS_10 = 0x92
    FEED_PLUS_1 = 0x93
    FEED_MINUS_1 = 0x94
    RAPID_100 = 0x95
    RAPID_50 = 0x96
    RAPID_25 = 0x97
    SPINDLE_100 = 0x99
    SPINDLE_PLUS_10 = 0x9A
    SPINDLE_MINUS_10 = 0x9B
    SPINDLE_PLUS_1 = 0x9C
    SPINDLE_MINUS_1 = 0x9D
    SPINDLE_STOP = 0x9E  # only in Hold
    FLOOD = 0xA0
    MIST = 0xA1
    PID_REPORT = 0xA2
    TOOL_ACK = 0xA3
    PROBE_TOGGLE = 0xA4

    @property
    def encoded(self) -> bytes:
        """The byte as it is written to the link."""
        return bytes((self,))


GRBL_REALTIME: frozenset[RealtimeCommand] = frozenset(
    byte
    for byte in RealtimeCommand
    if byte in (RealtimeCommand.RESET, RealtimeCommand.HOLD, RealtimeCommand.STATUS,
                RealtimeCommand.START)
    or byte in (RealtimeCommand.DOOR, RealtimeCommand.JOG_CANCEL)
    or RealtimeCommand.FEED_100 <= byte <= RealtimeCommand.MIST
)
"""What Grbl 1.1 acts on. Other bytes above 0x7F it throws away."""

GRBLHAL_REALTIME: frozenset[RealtimeCommand] = frozenset(RealtimeCommand)
