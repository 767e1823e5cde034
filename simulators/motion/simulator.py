"""A simulated controller on the running loop's clock, with at most one client on its wire."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.realtime import RealtimeCommand
from simulators.motion.actions import Vector
from simulators.motion.config import MotionConfig
from simulators.motion.controller import SimulatedController
from simulators.motion.trace import MotionTrace


class MotionSimulator:
    """One controller, powered up. To be made inside the loop on whose clock it lives.

    raises : ValueError for an unknown dialect, SettingError for a setting the firmware refuses
    """

    def __init__(self, config: MotionConfig) -> None:
        self.config = config
        self._loop = asyncio.get_running_loop()
        self._controller = SimulatedController(config)
        self._write: Callable[[bytes], None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_s = 0.0

    @property
    def trace(self) -> MotionTrace:
        """The record of all motion, up to 0.1 s beyond now (see Stepper)."""
        self._advance()
        self._controller.machine.stepper.commit()
        return self._controller.machine.trace

    @property
    def executed_line_numbers(self) -> list[int]:
        """N words of the moves executed to their end by now, in order; 0 for a move without."""
        blocks = self.trace.blocks()
        done = blocks.is_complete & (blocks.end_s <= self._loop.time())
        lines: list[int] = blocks.line[done].tolist()
        return lines

    @property
    def now_s(self) -> float:
        """The clock it lives on."""
        return self._loop.time()

    @property
    def position_mm(self) -> Vector:
        """Where the axes are now, machine coordinates."""
        self._advance()
        return self._controller.machine.position_mm()

    @property
    def rx_overrun_bytes(self) -> int:
        """Bytes lost so far because the receive buffer was full."""
        return self._controller.device.overruns

    def set_door(self, is_open: bool) -> None:
        """Drive the door input, as an interlock or a watchdog relay wired to it does."""
        self._send(self._controller.set_door(is_open, self._loop.time()))

    def set_estop(self, is_open: bool) -> None:
        """Drive the e-stop input."""
        self._send(self._controller.set_estop(is_open, self._loop.time()))

    def press_button(self, button: RealtimeCommand) -> None:
        """Feed hold, cycle start or reset, at the panel."""
        self._send(self._controller.receive(bytes((button,)), self._loop.time()))

    def set_overrides(self, feed: int, rapid: int, beam: int) -> None:
        """Percent, turned at the panel."""
        self._send(self._controller.set_overrides(feed, rapid, beam, self._loop.time()))

    def trip_limit_switch(self) -> None:
        """An axis runs into its limit switch: motion ends, position is lost."""
        self._send(self._controller.trip_limit_switch(self._loop.time()))

    def exceed_soft_limit(self) -> None:
        """A target turns out to be outside the travel, as with soft limits on."""
        self._send(self._controller.exceed_soft_limit(self._loop.time()))

    def lose_power(self) -> bytes:
        """Off and on again: all ends at once; what it says when it is up, for who waits for it."""
        banner = self._controller.lose_power(self._loop.time())
        self._send(b"")
        return banner

    def set_laser_circuit_open(self, is_cut: bool, delay_s: float) -> None:
        """The laser's own safety circuit opens or closes; the source is dark after delay_s."""
        laser, now_s = self._controller.machine.trace.laser, self._loop.time()
        if is_cut:
            laser.open_at(now_s + delay_s)
        else:
            laser.close_at(now_s)

    def advance_motion(self) -> None:
        """Let the controller work out what is certain of the motion to come."""
        self._advance()

    def attach_client(self, write: Callable[[bytes], None]) -> None:
        """A client has come: what the controller sends goes to `write` from now on."""
        self._write = write

    def detach_client(self) -> None:
        """The client has gone; the controller notices nothing."""
        self._write = None

    def receive(self, data: bytes) -> None:
        """Bytes from the client."""
        self._send(self._controller.receive(data, self._loop.time()))

    def close(self) -> None:
        """Switch off. What is under way stays unfinished."""
        self._write = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _advance(self) -> None:
        self._controller.machine.advance_to(self._loop.time())

    def _woken(self) -> None:
        self._timer = None
        self._send(self._controller.advance(self._loop.time()))

    def _send(self, data: bytes) -> None:
        if data and self._write is not None:
            self._write(data)
        due_s = self._controller.next_wake_s()
        timer = self._timer
        if timer is not None:
            if due_s == self._timer_s:
                return
            timer.cancel()
            self._timer = None
        if due_s is not None:
            self._timer_s = due_s
            self._timer = self._loop.call_at(due_s, self._woken)
