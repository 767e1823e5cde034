"""The controller's main loop: lines in, answers out, real-time bytes in between.

A line that has to wait (for room in the planner, for the axes to come to rest, for a dwell) is a
generator that yields what it waits for; meanwhile no other line leaves the receive buffer, as in
the firmware. The ordinary move for which there is room never becomes a generator.
"""

from __future__ import annotations

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import DIALECTS, ErrorPolicy
from firmware_protocol.gcode import GcodeError, significant
from firmware_protocol.messages import Alarm, Banner, ErrorReply, Feedback, Message
from firmware_protocol.realtime import Realtime
from simulators.motion import reports
from simulators.motion.actions import BEAM_CONSTANT, Motion, Vector
from simulators.motion.config import MotionConfig
from simulators.motion.machine import Machine
from simulators.motion.modal import Interpreter
from simulators.motion.perform import perform
from simulators.motion.realtime_commands import OVERRIDES, overridden
from simulators.motion.settings import Settings
from simulators.motion.states import SUSPENDED, State
from simulators.motion.system_commands import SystemCommands
from simulators.motion.waits import Steps, Wait, Waiting

LOCKED, TOO_LONG = 9, 11

_OK = b"ok\r\n"
_FLAGS = frozenset((Realtime.STATUS, Realtime.HOLD, Realtime.START))
"""Bytes that set a flag in the firmware: several at once are one."""
_EXECUTING = frozenset((State.IDLE, State.RUN))
_SLACK_S = 1e-9  # a timer may come early by the clock's resolution


class Controller:
    """One simulated controller, without a wire: bytes and the time they come in, bytes out."""

    def __init__(self, config: MotionConfig) -> None:
        """raises: ValueError for an unknown dialect, SettingError for a refused setting"""
        if config.dialect not in DIALECTS:
            raise ValueError(f"unknown dialect {config.dialect!r}; known: {', '.join(DIALECTS)}")
        self.dialect = dialect = DIALECTS[config.dialect]
        self.settings = Settings(dialect, config.settings)
        self.device = GrblDevice(dialect, config.rx_bytes)
        self.interpreter = Interpreter(dialect, self.settings)
        planner_blocks = config.planner_blocks or dialect.planner_blocks
        self.machine = Machine(dialect, self.settings, planner_blocks, self.say, self._displaced)
        self._commands = SystemCommands(
            dialect,
            self.settings,
            self.interpreter,
            self.machine,
            reports.identity(dialect, config.info, planner_blocks, self.device.rx_bytes),
            self._gcode,
            self._leave_check_mode,
        )
        self._latches = dialect.error_policy is ErrorPolicy.LATCH
        self._latched = 0
        self._out: list[bytes] = []
        self._line: Steps | None = None
        self._held: Motion | None = None  # an ordinary move that waits for room
        self._answered = False  # the line under way earns an answer
        self._waiting: Waiting = Wait.NEVER
        self._leaving_check = False
        if self.settings.homing and (not self.machine.hal or int(self.settings[22]) & 4):
            self.machine.state = State.ALARM  # until homed
        self._banner()
        self._out.clear()  # nobody was there to read it

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Bytes have arrived; what the controller sends at once."""
        if now_s > self.machine.now_s:
            self.machine.settle(now_s)
        realtime = self.device.receive_data(data)
        for index, byte in enumerate(realtime):
            if byte not in _FLAGS or byte not in realtime[:index]:
                self._realtime(byte)
        return self._go_on()

    def wake(self, now_s: float) -> bytes:
        """Time has passed; what the controller sends now. Needed at `next_wake_s`."""
        self.machine.settle(now_s)
        return self._go_on()

    def set_door(self, is_open: bool, now_s: float) -> bytes:
        """The door input changes, as a wired interlock or watchdog relay makes it."""
        machine = self.machine
        machine.settle(now_s)
        if is_open and not machine.door_open:
            machine.door_open = True
            machine.door()
        machine.door_open = is_open
        return self._go_on()

    def next_wake_s(self) -> float | None:
        """When to call `wake`, if nothing is received before."""
        machine = self.machine
        if machine.restore_s is not None:
            return machine.restore_s
        if machine.stopping is not None:
            return machine.next_event_s()
        if machine.state in SUSPENDED:
            return None
        if self._held is not None:
            return machine.next_event_s()
        if self._line is None or self._waiting is Wait.NEVER:
            return None
        if isinstance(self._waiting, Wait):
            return machine.next_event_s()
        return self._waiting

    def say(self, message: Message) -> None:
        self._out.append(self.device.send(message))

    # --- lines

    def _go_on(self) -> bytes:
        """Do all that can be done at this instant."""
        machine, out = self.machine, self._out
        while machine.state not in SUSPENDED and not machine.critical:
            if machine.stopping is not None:
                break
            if self._held is not None and not self._plan_held():
                break
            if self._line is not None and not self._resume_line():
                break
            if not self._read_lines():
                machine.start()
                break
        if not out:
            return b""
        sent = b"".join(out)
        out.clear()
        return sent

    def _read_lines(self) -> bool:
        """Take lines until one has to wait (True) or none is left or may be taken (False)."""
        take, out, machine = self.device.take_line, self._out, self.machine
        interpret, planner = self.interpreter.interpret, machine.planner
        add, capacity = planner.add, planner.capacity
        while True:
            state = machine.state
            if state in SUSPENDED or machine.critical or machine.stopping is not None:
                return False
            usual = state in _EXECUTING and not self._latched
            plain = usual and not self.settings[20]  # without soft limits no target needs a look
            while True:
                line = take()
                if line is None:
                    return False
                text, too_long = line
                if not usual or too_long or b"$" in text or not text:
                    waits = self._unusual(text, too_long)
                    break
                try:
                    actions = interpret(text)
                except GcodeError as refused:
                    self._answer(refused.code)
                    waits = False
                    break
                if plain and len(actions) == 1:
                    motion = actions[0]
                    if type(motion) is Motion:
                        if planner.count >= capacity:
                            self._held = motion
                            return True
                        if add(motion) is not None or motion.beam != BEAM_CONSTANT:
                            out.append(_OK)
                            continue
                waits = self._begin(perform(machine, actions))
                break
            if waits:
                return True

    def _plan_held(self) -> bool:
        """Try the move that found the planner full again; True when it is planned."""
        machine, motion = self.machine, self._held
        assert motion is not None
        planner = machine.planner
        if planner.count >= planner.capacity and machine.state is State.IDLE:
            machine.start()
            machine.settle(machine.now_s)
        if planner.count >= planner.capacity:
            return False
        self._held = None
        if planner.add(motion) is not None or motion.beam != BEAM_CONSTANT:
            self._out.append(_OK)
        else:
            self._begin(perform(machine, (motion,)))
        return True

    def _unusual(self, text: bytes, too_long: bool) -> bool:
        """Any other line; True where it has to wait."""
        block = significant(text)
        if too_long:
            self._answer(TOO_LONG)
        elif not block:
            self._answer(0)
        elif block[:1] == b"$":
            return self._begin(self._commands.execute(block.decode("latin-1")))
        elif self.machine.state in (State.ALARM, State.JOG):
            self._answer(LOCKED)
        elif self._latched:
            self._answer(self._latched)
        else:
            return self._begin(self._gcode(block))
        return False

    def _gcode(self, block: bytes) -> Steps:
        try:
            actions = self.interpreter.interpret(block)
        except GcodeError as refused:
            return refused.code
        return (yield from perform(self.machine, actions))

    def _begin(self, steps: Steps, answered: bool = True) -> bool:
        """Execute as far as possible; True where it has to wait."""
        self._line = steps
        self._answered = answered
        return not self._advance_line()

    def _resume_line(self) -> bool:
        """Try the waiting line again; True when it is done."""
        return self._ready() and self._advance_line()

    def _advance_line(self) -> bool:
        steps = self._line
        assert steps is not None
        try:
            while True:
                self._waiting = next(steps)
                if not self._ready():
                    return False
        except StopIteration as done:
            self._line = None
            if self._answered:
                self._answer(done.value)
        return True

    def _ready(self) -> bool:
        machine, waiting = self.machine, self._waiting
        if waiting is Wait.NEVER or machine.state in SUSPENDED or machine.stopping is not None:
            return False
        if not isinstance(waiting, Wait):
            return machine.now_s >= waiting - _SLACK_S
        if waiting is Wait.ROOM:
            planner = machine.planner
            if planner.count >= planner.capacity:
                machine.start()
                machine.settle(machine.now_s)
            return planner.count < planner.capacity
        machine.start()
        machine.settle(machine.now_s)
        return machine.at_rest()

    def _answer(self, code: int) -> None:
        if code:
            self.say(ErrorReply(code))
        else:
            self._out.append(_OK)
        if self._latches:
            self._latched = code
        if self._leaving_check:
            self._leaving_check = False
            self._reset()
        if self.machine.state is State.SLEEP:
            self.say(Feedback("MSG", "Sleeping"))

    def _leave_check_mode(self) -> None:
        self._leaving_check = True

    # --- real-time bytes

    def _realtime(self, byte: int) -> None:
        machine = self.machine
        if byte == Realtime.RESET:
            self._reset()
        elif machine.critical and not machine.hal:
            pass  # Grbl is deaf until it is reset
        elif byte in (Realtime.STATUS, Realtime.STATUS_TOP):
            self._report()
        elif byte == Realtime.STATUS_FULL:
            self._report(everything=True)
        elif machine.critical:
            pass
        elif byte in (Realtime.HOLD, Realtime.HOLD_TOP):
            machine.hold()
        elif byte in (Realtime.START, Realtime.START_TOP):
            if machine.state is State.TOOL:
                self.interpreter.mount_tool()
            machine.resume()
        elif byte == Realtime.DOOR:
            machine.door()
        elif byte == Realtime.JOG_CANCEL:
            if machine.hal:
                self.device.discard_rx()
            machine.cancel_jog()
        elif byte in OVERRIDES:
            machine.set_overrides(*overridden(byte, machine.overrides))
        elif byte == Realtime.SPINDLE_STOP:
            machine.toggle_spindle_stop()
        elif byte in (Realtime.FLOOD, Realtime.MIST):
            if machine.hal or byte == Realtime.FLOOD:
                machine.toggle_coolant(mist=byte == Realtime.MIST)
                modal = self.interpreter.modal
                modal.flood, modal.mist = machine.flood, machine.mist
        elif byte == Realtime.PARSER_STATE:
            self.say(reports.parser_state(self.dialect, self.interpreter))
        elif byte == Realtime.STOP:
            self.device.discard_rx()
            self._drop_line()
            machine.stop_keeping_state()
            self.interpreter.reset()

    def _reset(self) -> None:
        machine = self.machine
        waited = self._held is not None or (self._line is not None and self._answered)
        self._drop_line()
        alarm = machine.reset()
        if alarm:
            self.say(Alarm(alarm))
        if waited:
            self._out.append(_OK)  # the line it was in the middle of ends, and is answered
        self._latched = 0
        self.interpreter.reset()
        self._banner()

    def _banner(self) -> None:
        machine = self.machine
        self.say(Banner(self.dialect.banner))
        if machine.state is State.ALARM:
            self.say(Feedback("MSG", "'$H'|'$X' to unlock"))
            return
        if machine.door_open:
            machine.door()
        self._begin(self._commands.run_startup(), answered=False)

    def _report(self, everything: bool = False) -> None:
        machine = self.machine
        feed_mm_min, speed = machine.feed_and_speed()
        planner = machine.planner
        snapshot = reports.Snapshot(
            state=machine.state,
            substate=machine.substate(),
            position_mm=machine.position_mm(),
            offset_mm=self.interpreter.work_offset_mm,
            blocks_free=planner.capacity - planner.count,
            rx_free=self.device.rx_free,
            line=machine.stepper.last_line,
            feed_mm_min=feed_mm_min,
            speed=speed,
            overrides=machine.overrides,
            accessories=machine.accessories(),
            pins="D" if machine.door_open else "",
            homed=machine.homed,
            tool=self.interpreter.modal.tool,
            input_result=machine.input_result,
        )
        self.say(machine.reporter.report(snapshot, int(self.settings[10]), everything))

    def _displaced(self, position_mm: Vector) -> None:
        """The axes stand elsewhere than where the last line was to bring them."""
        self.interpreter.position_mm = position_mm

    def _drop_line(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None
        self._held = None
        self._waiting = Wait.NEVER
