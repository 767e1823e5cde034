"""A simulated controller on the running loop's clock, with at most one client."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.realtime import RealtimeCommand
from simulators.motion.actions import Vector
from simulators.motion.config import MotionConfig
from simulators.motion.controller import SimulatedController
from simulators.motion.trace import MotionTrace


class MotionSimulator:
    """One controller, powered up. Create it inside the event loop whose clock it uses.

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
        """N words of the moves completed by now, in order; 0 for a move without one."""
        blocks = self.trace.blocks()
        done = blocks.is_complete & (blocks.end_s <= self._loop.time())
        lines: list[int] = blocks.line[done].tolist()
        return lines

    @property
    def now_s(self) -> float:
        """Time on the loop's clock."""
        return self._loop.time()

    @property
    def position_mm(self) -> Vector:
        """Current position of the axes, machine coordinates."""
        self._advance()
        return self._controller.machine.position_mm()

    @property
    def rx_overrun_bytes(self) -> int:
        """Bytes lost so far because the receive buffer was full."""
        return self._controller.device.overruns

    def set_door(self, is_open: bool) -> None:
        """Set the door input, as a wired interlock or watchdog relay does."""
        self._send(self._controller.set_door(is_open, self._loop.time()))

    def set_estop(self, is_open: bool) -> None:
        """Set the e-stop input."""
        self._send(self._controller.set_estop(is_open, self._loop.time()))

    def press_button(self, button: RealtimeCommand) -> None:
        """Press feed hold, cycle start or reset at the operator panel."""
        self._send(self._controller.receive(bytes((button,)), self._loop.time()))

    def set_overrides(self, feed: int, rapid: int, beam: int) -> None:
        """Set the overrides [percent] at the operator panel."""
        self._send(self._controller.set_overrides(feed, rapid, beam, self._loop.time()))

    def trip_limit_switch(self) -> None:
        """An axis runs into its limit switch: motion ends, position is lost."""
        self._send(self._controller.trip_limit_switch(self._loop.time()))

    def exceed_soft_limit(self) -> None:
        """Act as if a target exceeded the travel with soft limits on."""
        self._send(self._controller.exceed_soft_limit(self._loop.time()))

    def lose_power(self) -> bytes:
        """Switch power off and on: all motion ends at once. Returns the power-up output."""
        banner = self._controller.lose_power(self._loop.time())
        self._send(b"")
        return banner

    def set_laser_circuit_open(self, is_cut: bool, delay_s: float) -> None:
        """Open or close the laser's own safety circuit; the beam is off after delay_s."""
        laser, now_s = self._controller.machine.trace.laser, self._loop.time()
        if is_cut:
            laser.open_at(now_s + delay_s)
        else:
            laser.close_at(now_s)

    def advance_motion(self) -> None:
        """Let the controller commit the motion that can no longer change."""
        self._advance()

    def attach_client(self, write: Callable[[bytes], None]) -> None:
        """A client has connected: controller output goes to `write` from now on."""
        self._write = write

    def detach_client(self) -> None:
        """The client has disconnected; the controller does not detect it."""
        self._write = None

    def receive(self, data: bytes) -> None:
        """Receive bytes from the client."""
        self._send(self._controller.receive(data, self._loop.time()))

    def close(self) -> None:
        """Switch off. Current motion stays unfinished."""
        self._write = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _advance(self) -> None:
        self._controller.machine.advance_to(self._loop.time())

    def _on_timer(self) -> None:
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
            self._timer = self._loop.call_at(due_s, self._on_timer)
