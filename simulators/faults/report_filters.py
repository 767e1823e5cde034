"""Faults that apply to status reports to the host: each is a filter of `faults.link_tap`.

A status report has no checksum: one with a changed digit is still a valid report. A separate random
generator selects the reports to change, so that a run with a given seed is repeatable.
"""

from __future__ import annotations

import asyncio
import random
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

from firmware_protocol.realtime import RealtimeCommand
from simulators.faults.link_tap import PassOn

OnFinished = Callable[[], None]

_REPORT = re.compile(rb"<[^<>\r\n]*>\r\n")
_PRINTABLE = bytes(range(0x20, 0x7F))


@dataclass
class AlterStatusReports:
    """Change each report with `probability`.

    Calls `on_finished` after `count` changes (0: no limit).
    """

    changed: Callable[[bytes, random.Random], bytes]
    probability: float
    count: int
    seed: int
    on_finished: OnFinished
    _altered_count: int = 0
    _random: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._random = random.Random(self.seed)

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        out = _REPORT.sub(self._one, data) if b"<" in data else data
        if self.count and self._altered_count >= self.count:
            self.on_finished()
        if out:
            deliver(out)

    def _one(self, found: re.Match[bytes]) -> bytes:
        report = found[0]
        is_over = self.count and self._altered_count >= self.count
        if is_over or self._random.random() >= self.probability:
            return report
        self._altered_count += 1
        return self.changed(report, self._random)


def dropped_report(report: bytes, draw: random.Random) -> bytes:
    """Drop the whole report."""
    return b""


def report_with_changed_digit(report: bytes, draw: random.Random) -> bytes:
    """Change one digit; the result is still a valid report."""
    digits = [at for at, byte in enumerate(report) if 0x30 <= byte <= 0x39]
    if not digits:
        return report
    at = draw.choice(digits)
    other = draw.choice([digit for digit in b"0123456789" if digit != report[at]])
    return report[:at] + bytes((other,)) + report[at + 1 :]


def report_with_changed_byte(report: bytes, draw: random.Random) -> bytes:
    """Replace one byte by a random printable one."""
    at = draw.randrange(len(report) - 2)
    return report[:at] + bytes((draw.choice(_PRINTABLE),)) + report[at + 1 :]


def truncated_report(report: bytes, draw: random.Random) -> bytes:
    """Remove some bytes from the report."""
    first = draw.randrange(len(report) - 2)
    return report[:first] + report[draw.randrange(first + 1, len(report) - 1) :]


def garbled_report(report: bytes, draw: random.Random) -> bytes:
    """Apply one of the changes above; half of them change a digit."""
    how = draw.choice((report_with_changed_digit, report_with_changed_digit,
                       report_with_changed_byte, truncated_report))
    return how(report, draw)


def report_with_unknown_fields(report: bytes, draw: random.Random) -> bytes:
    """Add fields that no known firmware sends, with and without a value."""
    added = draw.sample([b"|AR", b"|$C:1", b"|Zq:1,2,3", b"|9", b"|x-y_z:"], 2)
    head, bar, rest = report[:-3].partition(b"|")
    return b"".join((head, added[0], bar, rest, added[1], b">\r\n"))


GARBLINGS = {
    "any": garbled_report, "digit": report_with_changed_digit, "byte": report_with_changed_byte,
    "cut": truncated_report,
}


class DelayStatusReports:
    """The controller polls its status flag every look_s; a reset in between clears it.

    `to_host` delays what the device sends, in order. `to_device` looks for a reset, which discards
    the reports not yet sent.
    """

    def __init__(self, look_s: float) -> None:
        self._look_s = look_s
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[bytes, PassOn]] = deque()

    def to_host(self, data: bytes, deliver: PassOn) -> None:
        self._waiting.append((data, deliver))
        self._loop.call_later(self._look_s, self._one)

    def to_device(self, data: bytes, deliver: PassOn) -> None:
        before, reset, after = data.partition(RealtimeCommand.RESET.encoded)
        if before:
            deliver(before)
        if reset:
            self._waiting = deque(
                (_REPORT.sub(b"", sent), to_host) for sent, to_host in self._waiting
            )
            deliver(reset + after)

    def flush(self) -> None:
        """Deliver all waiting chunks."""
        while self._waiting:
            self._one()

    def _one(self) -> None:
        if self._waiting:
            data, deliver = self._waiting.popleft()
            if data:
                deliver(data)
