"""Latched alarms of a PMX device; the first alarm is kept apart from those that follow."""

from __future__ import annotations

from firmware_protocol.pmx import MAX_HOPPERS
from firmware_protocol.pmx_alarms import SYSTEM_CODES, hopper_alarm_code

#: Alarms x01..x10 of a hopper have bits 0..9 in its ALARM_H.
_HOPPER_NUMBERS = range(1, 11)


class AlarmLatch:
    """first : code of the first latched alarm, 0 for none; count : alarms ever raised"""

    def __init__(self) -> None:
        self.first = 0
        self.count = 0
        self._latched: set[int] = set()

    def __bool__(self) -> bool:
        return bool(self._latched)

    def __contains__(self, code: int) -> bool:
        return code in self._latched

    def latch(self, code: int) -> None:
        if code in self._latched:
            return
        self._latched.add(code)
        self.count += 1
        self.first = self.first or code

    def clear(self) -> None:
        self._latched.clear()
        self.first = 0

    def system_bits(self) -> int:
        """ALARM: bits 0..5 are the system alarms, 8..11 are set if a hopper has one."""
        if not self._latched:
            return 0
        bits = sum(1 << i for i, code in enumerate(SYSTEM_CODES) if code in self._latched)
        return bits | sum(
            1 << 7 + channel
            for channel in range(1, MAX_HOPPERS + 1) if self.hopper_bits(channel)
        )

    def hopper_bits(self, channel: int) -> int:
        """ALARM_H of one hopper."""
        return sum(
            1 << number - 1
            for number in _HOPPER_NUMBERS if hopper_alarm_code(channel, number) in self._latched
        )
