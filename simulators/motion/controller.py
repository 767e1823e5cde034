"""One complete simulated controller: it takes bytes with their arrival time and returns bytes.

Real-time bytes act at once, before the lines in the receive buffer. The main loop executes lines.
Nothing here owns a port or a clock: `simulator` does.
"""

from __future__ import annotations

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import DIALECTS
from firmware_protocol.messages import AlarmMessage, FeedbackMessage, Message, WelcomeBanner
from firmware_protocol.realtime import RealtimeCommand
from simulators.motion import reports
from simulators.motion.actions import Vector
from simulators.motion.config import MotionConfig
from simulators.motion.interpreter import GcodeInterpreter
from simulators.motion.machine import ESTOP_ALARM, HARD_LIMIT_ALARM, MotionMachine
from simulators.motion.main_loop import OK_REPLY, MainLoop
from simulators.motion.realtime_commands import apply_realtime_command
from simulators.motion.report_fields import report_fields
from simulators.motion.settings import FirmwareSettings
from simulators.motion.states import ControllerState

_FLAGS = frozenset((RealtimeCommand.STATUS, RealtimeCommand.HOLD, RealtimeCommand.START))
"""Bytes that set a flag in the firmware: several at once are one."""


class SimulatedController:
    """One simulated controller without a link: bytes and their arrival time in, bytes out."""

    def __init__(self, config: MotionConfig) -> None:
        """raises: ValueError for an unknown dialect, SettingError for a refused setting"""
        if config.dialect not in DIALECTS:
            raise ValueError(f"unknown dialect {config.dialect!r}; known: {', '.join(DIALECTS)}")
        self.dialect = dialect = DIALECTS[config.dialect]
        self.settings = FirmwareSettings(dialect, config.settings)
        self.device = GrblDevice(dialect, config.rx_bytes)
        self.interpreter = GcodeInterpreter(dialect, self.settings)
        planner_blocks = config.planner_blocks or dialect.planner_blocks
        self.machine = MotionMachine(dialect, self.settings, planner_blocks, self.send,
                                     self._displaced)
        self._out: list[bytes] = []
        self._loop = MainLoop(
            self.device,
            self.interpreter,
            self.machine,
            reports.identity_lines(dialect, config.info, planner_blocks, self.device.rx_bytes),
            self.send,
            self._out,
        )
        self._lock_unless_homed()
        self._banner()
        self._out.clear()  # no client was connected to read it

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Process received bytes. Returns what the controller sends at once."""
        if now_s > self.machine.now_s:
            self.machine.advance_to(now_s)
        realtime = self.device.receive_data(data)
        for index, byte in enumerate(realtime):
            if byte not in _FLAGS or byte not in realtime[:index]:
                self._realtime(byte)
        return self._sent()

    def advance(self, now_s: float) -> bytes:
        """Let time pass to now_s. Returns what the controller sends. Call it at `next_wake_s`."""
        self.machine.advance_to(now_s)
        return self._sent()

    def set_door(self, is_open: bool, now_s: float) -> bytes:
        """Set the door input, as a wired interlock or watchdog relay does."""
        machine = self.machine
        machine.advance_to(now_s)
        if is_open and not machine.door_open:
            machine.door_open = True
            machine.enter_door_stop()
        machine.door_open = is_open
        return self._sent()

    def set_estop(self, is_open: bool, now_s: float) -> bytes:
        """Set the e-stop input. Grbl has none; there it is the reset input."""
        machine = self.machine
        machine.advance_to(now_s)
        opens = is_open and not machine.estop_open
        machine.estop_open = is_open
        if opens and machine.hal:
            self._drop_lines()
            machine.stop_immediately(ESTOP_ALARM)
        elif opens:
            self._reset()
        return self._sent()

    def trip_limit_switch(self, now_s: float) -> bytes:
        """An axis runs into its limit switch."""
        self.machine.advance_to(now_s)
        self._drop_lines()
        self.machine.stop_immediately(HARD_LIMIT_ALARM)
        return self._sent()

    def exceed_soft_limit(self, now_s: float) -> bytes:
        """Act as if a target exceeded the travel."""
        self.machine.advance_to(now_s)
        self.machine.stop_for_soft_limit()
        return self._sent()

    def set_overrides(self, feed: int, rapid: int, beam: int, now_s: float) -> bytes:
        """Set the overrides [percent] at the operator panel."""
        self.machine.advance_to(now_s)
        self.machine.set_overrides(feed, rapid, beam)
        return self._sent()

    def lose_power(self, now_s: float) -> bytes:
        """Switch power off and on. Returns what the controller sends after power-up."""
        self.machine.advance_to(now_s)
        self._drop_lines()
        self.machine.lose_power()
        self.interpreter.reset()
        self._lock_unless_homed()
        self._out.clear()
        self._banner()
        return self._sent()

    def next_wake_s(self) -> float | None:
        """When to call `advance` next, unless bytes arrive earlier."""
        machine = self.machine
        if machine.restore_s is not None:
            return machine.restore_s
        if machine.stopping is not None:
            return machine.next_event_s()
        return self._loop.next_wake_s()

    def send(self, message: Message) -> None:
        self._out.append(self.device.encode_message(message))

    def _sent(self) -> bytes:
        """Run the main loop. Returns all pending output."""
        self._loop.process_lines()
        while self._loop.reset_wanted:
            self._reset()
            self._loop.process_lines()
        out = self._out
        if not out:
            return b""
        data = b"".join(out)
        out.clear()
        return data

    def _lock_unless_homed(self) -> None:
        """Enter Alarm after power-up if the settings require homing."""
        if self.settings.is_homing_enabled and (not self.machine.hal or int(self.settings[22]) & 4):
            self.machine.state = ControllerState.ALARM

    def _drop_lines(self) -> None:
        self.device.clear_rx_buffer()
        self._loop.restart()

    def _realtime(self, byte: int) -> None:
        machine = self.machine
        if byte == RealtimeCommand.RESET:
            self._reset()
        elif machine.critical and not machine.hal:
            pass  # Grbl ignores all other bytes until it is reset
        elif byte in (RealtimeCommand.STATUS, RealtimeCommand.STATUS_TOP):
            self._report()
        elif byte == RealtimeCommand.STATUS_FULL:
            self._report(everything=True)
        elif machine.critical:
            pass
        elif byte == RealtimeCommand.PARSER_STATE:
            self.send(reports.parser_state_line(self.dialect, self.interpreter))
        elif byte == RealtimeCommand.STOP:
            self.device.clear_rx_buffer()
            self._loop.discard_line()
            machine.stop_keeping_state()
            self.interpreter.reset()
        else:
            if byte == RealtimeCommand.JOG_CANCEL and machine.hal:
                self.device.clear_rx_buffer()
            if machine.state is ControllerState.TOOL and byte in (RealtimeCommand.START,
                                                                  RealtimeCommand.START_TOP):
                self.interpreter.confirm_tool_change()
            apply_realtime_command(machine, byte)
            modal, on = self.interpreter.modal, machine.accessories
            if byte in (RealtimeCommand.FLOOD, RealtimeCommand.MIST):
                modal.flood, modal.mist = on.flood, on.mist

    def _reset(self) -> None:
        machine = self.machine
        owed = self._loop.restart()
        alarm = machine.reset()
        if alarm:
            self.send(AlarmMessage(alarm))
        if owed:
            self._out.append(OK_REPLY)  # the interrupted line ends and still gets its reply
        self.interpreter.reset()
        self._banner()

    def _banner(self) -> None:
        machine = self.machine
        self.send(WelcomeBanner(self.dialect.banner))
        if machine.state is ControllerState.ALARM:
            self.send(FeedbackMessage("MSG", "'$H'|'$X' to unlock"))
            return
        if machine.door_open:
            machine.enter_door_stop()
        self._loop.run_startup_blocks()

    def _report(self, everything: bool = False) -> None:
        machine, interpreter = self.machine, self.interpreter
        offset_mm, tool = interpreter.work_offset_mm, interpreter.modal.tool
        now = report_fields(machine, offset_mm, tool, self.device.free_rx_bytes)
        self.send(machine.reporter.next_report(now, int(self.settings[10]), everything))

    def _displaced(self, position_mm: Vector) -> None:
        """Take position_mm as the position: the axes are not at the last line's target."""
        self.interpreter.position_mm = position_mm
