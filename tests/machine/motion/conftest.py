"""A scripted controller at the far end of a real socket or pty, in virtual time.

Not the simulator: every motion line takes the same time, and the script can misbehave.
"""

from __future__ import annotations

import asyncio
import os
import tty
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import GRBL, GRBLHAL, Dialect, ErrorPolicy
from firmware_protocol.messages import (
    AlarmMessage,
    ErrorReply,
    FeedbackMessage,
    Message,
    OkReply,
    SettingMessage,
    StatusMessage,
    WelcomeBanner,
)
from firmware_protocol.realtime import RealtimeCommand
from firmware_protocol.status import StatusReport
from simulators import virtual_time


class ScriptedController:
    """One controller: G1 lines take `block_s`, G99 is error:20, the rest is done at once."""

    def __init__(
        self, dialect: Dialect, *, rx_bytes: int | None = None, blocks: int | None = None,
        block_s: float = 0.02, settings: dict[int, str] | None = None, info: str = "lmctl-bench",
    ) -> None:
        self.dialect = dialect
        self.device = GrblDevice(dialect, rx_bytes)
        self.blocks = blocks or dialect.planner_blocks
        self.block_s = block_s
        self.info = info
        hal = dialect is GRBLHAL
        self.settings = {10: "511" if hal else "3", 22: "0", 30: "1000", 32: "1"} | (settings or {})
        self.received: list[bytes] = []  # every line taken, in order
        self.done = 0  # lines of `received` finished, G-code only
        self.state, self.sub = "Idle", None
        self.asked_at_s: list[float] = []
        self.realtime_seen = bytearray()
        self.lose_answers: set[int] = set()  # which acknowledgements never go out
        self.mute = False
        self.deceleration_s = 0.1
        self.write: Callable[[bytes], None] = lambda data: None
        self._answers = 0
        self._latched = 0
        self._planner: deque[tuple[int, int]] = deque()  # (place among the G-code lines, N)
        self._gcode_lines = 0
        self._blocked: bytes | None = None
        self._timer: asyncio.TimerHandle | None = None

    # what the wire brings -------------------------------------------------------------------

    def feed(self, data: bytes) -> None:
        for byte in self.device.receive_data(data):
            self.realtime_seen.append(byte)
            self._realtime(byte)
        self._work()

    def _realtime(self, byte: int) -> None:
        loop = asyncio.get_running_loop()
        if byte == RealtimeCommand.STATUS:
            self.asked_at_s.append(loop.time())
            self.say(StatusMessage(self.report()))
        elif byte == RealtimeCommand.HOLD and self.state in ("Idle", "Run"):
            moving = self.state == "Run"
            self.state, self.sub = "Hold", 1 if moving else 0
            self._stop_timer()
            if moving:
                self._timer = loop.call_later(self.deceleration_s, self._come_to_rest)
        elif byte == RealtimeCommand.START and self.state == "Hold" and self.sub == 0:
            self._run_on()
            self._work()
        elif byte == RealtimeCommand.RESET:
            self.restart()

    def _come_to_rest(self) -> None:
        self.sub = 0

    def restart(self) -> None:
        """A reset, or power coming back: the banner, and nothing remembered."""
        lost = self.state == "Run" or (self.state == "Hold" and self.sub == 1)
        self._stop_timer()
        self._planner.clear()
        self._blocked = None
        self._latched = 0
        self.device.clear_rx_buffer()
        self.state, self.sub = "Idle", None
        if lost and self.dialect is GRBL:
            self.say(AlarmMessage(3))
            self.state = "Alarm"
        self.say(WelcomeBanner(self.dialect.banner))

    def alarm(self, code: int) -> None:
        """Stop where it is, locked."""
        self._stop_timer()
        self.state, self.sub = "Alarm", None
        self.say(AlarmMessage(code))

    # what it says ---------------------------------------------------------------------------

    def say(self, message: Message) -> None:
        if not self.mute:
            self.write(self.device.encode_message(message))

    def report(self) -> StatusReport:
        mask = int(self.settings[10])
        number = None
        if self.dialect is GRBLHAL and mask & 4 and self._planner:
            number = self._planner[0][1] or None
        return StatusReport(
            self.state, self.sub, machine_mm=(float(self.done), 0.0, 0.0),
            planner_blocks_free=self.blocks - len(self._planner) if mask & 2 else None,
            rx_bytes_free=self.device.free_rx_bytes if mask & 2 else None,
            line_number=number, feed_mm_min=0.0, spindle_speed=0.0,
        )

    def _answer(self, message: Message) -> None:
        self._answers += 1
        if self._answers not in self.lose_answers:
            self.say(message)

    # what it does ---------------------------------------------------------------------------

    def _work(self) -> None:
        while self.state not in ("Hold", "Sleep"):
            if self._blocked is None:
                line = self.device.pop_line()
                if line is None:
                    break
                self.received.append(line)
                self._blocked = line
            if not self._take(self._blocked):
                break
            self._blocked = None
        if self.state == "Idle" and self._planner:
            self._run_on()

    def _take(self, line: bytes) -> bool:
        """Act on a line; False while the planner has no room for it."""
        if line.startswith(b"$"):
            self._latched = 0
            self._system(line)
            return True
        if self.state == "Alarm" or self._latched or b"G99" in line:
            code = 9 if self.state == "Alarm" else 20
            self._answer(ErrorReply(code))
            if self.dialect.error_policy is ErrorPolicy.LATCH:
                self._latched = code
            return True
        if b"X" in line:
            if len(self._planner) >= self.blocks:
                return False
            word = line[1:].split(b" ")[0] if line[:1] == b"N" else b"0"
            if not word.isdigit():  # bytes were lost
                self._answer(ErrorReply(2))
                return True
            number = int(word)
            self._gcode_lines += 1
            self._planner.append((self._gcode_lines, number))
        else:
            self._gcode_lines += 1
            if not self._planner:
                self.done = self._gcode_lines
        self._answer(OkReply())
        return True

    def _system(self, line: bytes) -> None:
        if line == b"$I":
            self.say(FeedbackMessage("VER", f"{self.dialect.version}:{self.info}"))
            axes = ",3,0" if self.dialect is GRBLHAL else ""
            rx = self.device.rx_bytes
            self.say(FeedbackMessage("OPT", f"{self.dialect.options},{self.blocks},{rx}{axes}"))
            if self.dialect is GRBLHAL:
                self.say(FeedbackMessage("FIRMWARE", "grblHAL"))
        elif line == b"$$":
            for number, value in self.settings.items():
                self.say(SettingMessage(number, value))
        elif line == b"$G":
            self.say(FeedbackMessage("GC", "G0 G55 G17 G21 G90 G94 M5 M9 T0 F0 S0"))
        elif line == b"$#":
            self.say(FeedbackMessage("G54", "9.000,9.000,9.000"))
            self.say(FeedbackMessage("G55", "1.000,2.000,3.000"))
            self.say(FeedbackMessage("G92", "0.000,0.000,0.500"))
            self.say(FeedbackMessage("TLO", "0.250"))
            self.say(FeedbackMessage("PRB", "0.000,0.000,0.000:0"))
        elif line in (b"$H", b"$X"):
            self.state = "Idle"
        else:
            self._answer(ErrorReply(3))
            return
        self._answer(OkReply())

    def _run_on(self) -> None:
        self.state, self.sub = ("Run", None) if self._planner else ("Idle", None)
        self._stop_timer()
        if self._planner:
            loop = asyncio.get_running_loop()
            self._timer = loop.call_later(self.block_s, self._block_done)

    def _block_done(self) -> None:
        place, _ = self._planner.popleft()
        following = self._planner[0][0] - 1 if self._planner else self._gcode_lines
        self.done = max(place, following)  # what makes no block is done with the motion before it
        self._run_on()
        self._work()

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    # wires ----------------------------------------------------------------------------------

    @asynccontextmanager
    async def on_tcp(self):
        """Serve one client at a time; yields the endpoint. `self.hang_up()` closes its link."""

        connections: list[asyncio.Transport] = []
        controller = self

        class Far(asyncio.Protocol):
            def connection_made(self, transport) -> None:
                connections.append(transport)
                controller.write, controller.hang_up = transport.write, transport.close

            def data_received(self, data: bytes) -> None:
                controller.feed(data)

        server = await asyncio.get_running_loop().create_server(Far, "127.0.0.1", 0)
        try:
            yield f"tcp://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        finally:
            self._stop_timer()
            server.close()
            for connection in connections:
                connection.abort()
            await asyncio.sleep(0)

    @asynccontextmanager
    async def on_pty(self, scheme: str = "pty"):
        """Serve the far end of a pty; yields the endpoint."""
        loop = asyncio.get_running_loop()
        near, far = os.openpty()
        tty.setraw(far)
        os.set_blocking(near, False)
        self.write = lambda data: os.write(near, data)
        loop.add_reader(near, lambda: self.feed(os.read(near, 4096)))
        try:
            yield f"{scheme}://{os.ttyname(far)}"
        finally:
            self._stop_timer()
            loop.remove_reader(near)
            os.close(near)
            os.close(far)


@pytest.fixture
def controller() -> type[ScriptedController]:
    """Makes a scripted controller."""
    return ScriptedController


@pytest.fixture
def in_virtual_time() -> Callable[[Coroutine[Any, Any, Any]], Any]:
    """Runs a coroutine to its end on a clock that jumps."""
    return virtual_time.run_in_virtual_time


@pytest.fixture(params=[GRBL, GRBLHAL], ids=lambda dialect: dialect.name)
def dialect(request: pytest.FixtureRequest) -> Dialect:
    """Either firmware."""
    return request.param
