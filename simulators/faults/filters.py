"""Faults that apply to bytes on a link: each is a filter of `faults.link_tap`."""

from __future__ import annotations

import asyncio
import random
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from simulators.faults.link_tap import PassOn

OnFinished = Callable[[], None]

_OK = b"ok\r\n"
_REPORT = re.compile(rb"<[^<>\r\n]*>")
_STATE = re.compile(rb"<[^|>]*")
_GARBLE = bytes(byte ^ 0x15 for byte in range(256))


@dataclass
class AlterBytes:
    """Replace one in `every` bytes by `changed(byte)`, `count` times; then call `on_finished`."""

    changed: Callable[[int], bytes]
    count: int
    every: int
    on_finished: OnFinished
    _passed: int = 0

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        out = bytearray()
        for byte in data:
            self._passed += 1
            if self.count and self._passed % self.every == 0:
                self.count -= 1
                out += self.changed(byte)
            else:
                out.append(byte)
        if not self.count:
            self.on_finished()
        if out:
            deliver(bytes(out))


class DelayBytes:
    """Delay every chunk, and keep the order."""

    def __init__(self, late_s: float) -> None:
        self._late_s = late_s
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[tuple[bytes, PassOn]] = deque()

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        self._waiting.append((data, deliver))
        self._loop.call_later(self._late_s, self._one)

    def release_waiting(self) -> None:
        """Deliver all waiting chunks."""
        while self._waiting:
            self._one()

    def _one(self) -> None:
        if self._waiting:
            data, deliver = self._waiting.popleft()
            deliver(data)


@dataclass
class RepeatOkReplies:
    """The next `count` answers `ok` are lost (times 0) or doubled (times 2)."""

    times: int
    count: int
    on_finished: OnFinished

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        out = b""
        for line in data.splitlines(keepends=True):
            if line == _OK and self.count:
                self.count -= 1
                line *= self.times
            out += line
        if not self.count:
            self.on_finished()
        if out:
            deliver(out)


class GarbleWord:
    """Scale the next non-zero number after a letter to `percent` of its value, once.

    G-code on a serial line has no checksum: the controller obeys any valid number. The number keeps
    its length, as damaged digits do, so it is as close to `percent` as that many digits allow.
    """

    def __init__(self, letter: str, percent: float, on_finished: OnFinished) -> None:
        self._number = re.compile(rb"(?<=%b)-?[0-9.]*[1-9][0-9.]*" % letter.encode())
        self._percent = percent
        self._on_finished = on_finished

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        garbled, altered_count = self._number.subn(self._other, data, count=1)
        if altered_count:
            self._on_finished()
        deliver(garbled)

    def _other(self, number: re.Match[bytes]) -> bytes:
        was = number[0].decode()
        decimals = len(was.partition(".")[2])
        becomes = f"{float(was) * self._percent / 100.0:0{len(was)}.{decimals}f}"
        return (becomes if len(becomes) == len(was) else re.sub("[0-9]", "9", was)).encode()


@dataclass
class RepeatModbusReplies:
    """The next `count` chunks, each a reply, are lost (times 0) or doubled (times 2)."""

    times: int
    count: int
    on_finished: OnFinished

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        self.count -= 1
        if not self.count:
            self.on_finished()
        if self.times:
            deliver(data * self.times)


@dataclass
class FreezeStatusReports:
    """Repeat the first status report in place of every later one, with the given state."""

    state: str
    _frozen: bytes = b""

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        deliver(_REPORT.sub(self._altered, data))

    def _altered(self, report: re.Match[bytes]) -> bytes:
        if not self._frozen:
            self._frozen = _STATE.sub(b"<" + self.state.encode(), report[0], count=1)
        return self._frozen


@dataclass
class GarbledEcho:
    """The device receives what the host sends, and the host receives a garbled echo."""

    say: PassOn

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        deliver(data)
        self.say(data.translate(_GARBLE))


@dataclass
class ExactEcho:
    """The host receives an exact echo of what it sends, before any reply.

    This is an RS-485 adapter that does not switch its receiver off.
    """

    say: PassOn

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        self.say(data)
        deliver(data)


class StrayBytes:
    """Insert stray bytes before each chunk, different ones each time.

    Every other time they start with the first two bytes of the reply.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._random = random.Random(1)
        self._chunks = 0

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        self._chunks += 1
        stray = self._random.randbytes(self._count)
        deliver((data[:2] + stray)[: self._count] if self._chunks % 2 else stray)
        deliver(data)


@dataclass
class ModbusExceptions:
    """Answer the next `count` requests with an exception; they do not reach the device."""

    code: int
    count: float
    is_rtu: bool
    say: PassOn
    on_finished: OnFinished

    def __call__(self, data: bytes, deliver: PassOn) -> None:
        for request in [data] if self.is_rtu else _tcp_frames(data):
            if not self.count:
                deliver(request)
                continue
            self.count -= 1
            self.say(self._refusal(request))
        if not self.count:
            self.on_finished()

    def _refusal(self, request: bytes) -> bytes:
        if self.is_rtu:
            answer = bytes((request[0], request[1] | 0x80, self.code))
            return answer + _crc(answer)
        return request[:4] + bytes((0, 3, request[6], request[7] | 0x80, self.code))


def _tcp_frames(data: bytes) -> list[bytes]:
    """Split a chunk into Modbus TCP requests; an incomplete one is kept as it is."""
    frames = []
    while len(data) >= 8:
        length = 6 + int.from_bytes(data[4:6], "big")
        frames.append(data[:length])
        data = data[length:]
    return frames + ([data] if data else [])


def _crc(data: bytes) -> bytes:
    """CRC16 of Modbus RTU (polynomial 0xA001), low byte first."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc.to_bytes(2, "little")
