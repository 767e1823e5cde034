"""The controller's main loop: takes lines from the receive buffer and sends the replies.

A line that has to wait (for room in the planner, for the axes to come to rest, for a dwell) is a
generator that yields its wait reason. Meanwhile no other line leaves the receive buffer, as in
the firmware. An ordinary move that finds room in the planner never becomes a generator.
"""

from __future__ import annotations

from collections.abc import Callable

from firmware_protocol.device import GrblDevice
from firmware_protocol.dialect import ErrorPolicy
from firmware_protocol.gcode import GcodeError, strip_comments_and_spaces
from firmware_protocol.messages import ErrorReply, FeedbackMessage, Message
from simulators.motion.action_execution import perform_actions
from simulators.motion.actions import BEAM_CONSTANT, StraightMove
from simulators.motion.interpreter import GcodeInterpreter
from simulators.motion.machine import MotionMachine
from simulators.motion.states import SUSPENDED_STATES, ControllerState
from simulators.motion.system_commands import SystemCommands
from simulators.motion.waits import Steps, Waiting, WaitReason

LOCKED, TOO_LONG = 9, 11
OK_REPLY = b"ok\r\n"

_EXECUTING = frozenset((ControllerState.IDLE, ControllerState.RUN))
_SLACK_S = 1e-9  # a timer may come early by the clock's resolution


class MainLoop:
    """Executes lines on the machine.

    say : called with each message to send
    out : bytes to send; "ok" goes there directly, without a message
    reset_wanted : a line requires a reset (leaving check mode); no line is read until then
    """

    def __init__(
        self,
        device: GrblDevice,
        interpreter: GcodeInterpreter,
        machine: MotionMachine,
        identity: list[Message],
        say: Callable[[Message], None],
        out: list[bytes],
    ) -> None:
        self.reset_wanted = False
        self._device = device
        self._interpreter = interpreter
        self._machine = machine
        self._say = say
        self._send = out.append
        self._commands = SystemCommands(
            device.dialect, interpreter, machine, identity, self._gcode, self._want_reset
        )
        self._latches = device.dialect.error_policy is ErrorPolicy.LATCH
        self._latched = 0
        self._line: Steps | None = None
        self._held: StraightMove | None = None  # an ordinary move that waits for planner room
        self._answered = False  # the current line gets a reply
        self._waiting: Waiting = WaitReason.NEVER

    def next_wake_s(self) -> float | None:
        """When a waiting line may continue, if nothing else happens."""
        machine = self._machine
        if machine.state in SUSPENDED_STATES:
            return None
        if self._held is None:
            if self._line is None or self._waiting is WaitReason.NEVER:
                return None
            if not isinstance(self._waiting, WaitReason):
                return self._waiting
        return machine.next_event_s()

    def restart(self) -> bool:
        """Reset: drop the current line. True if its reply is still outstanding."""
        owed = self._held is not None or (self._line is not None and self._answered)
        self.discard_line()
        self._latched = 0
        self.reset_wanted = False
        return owed

    def run_startup_blocks(self) -> None:
        """Execute the stored lines."""
        self._begin(self._commands.run_startup_blocks(), answered=False)

    def process_lines(self) -> None:
        """Execute all lines that can run at this instant."""
        machine = self._machine
        while not self._is_blocked():
            if self._held is not None and not self._plan_held():
                return
            if self._line is not None and not self._resume_line():
                return
            if not self._read_lines():
                machine.start_planned_motion()
                return

    def _is_blocked(self) -> bool:
        """No line may start or continue."""
        machine = self._machine
        return (
            machine.state in SUSPENDED_STATES
            or machine.critical
            or machine.stopping is not None
            or self.reset_wanted
        )

    def _read_lines(self) -> bool:
        """Take lines until one must wait (True), or none is left or allowed (False)."""
        take, send, machine = self._device.pop_line, self._send, self._machine
        interpret, planner = self._interpreter.interpret, machine.planner
        add, capacity = planner.add, planner.capacity
        most_chars = self._device.dialect.max_line_chars
        while True:
            if self._is_blocked():
                return False
            usual = machine.state in _EXECUTING and not self._latched
            plain = usual and not machine.settings[20]  # without soft limits no target check
            while True:
                text = take()
                if text is None:
                    return False
                if not usual or len(text) > most_chars or b"$" in text or not text:
                    waits = self._unusual(text)
                    break
                try:
                    actions = interpret(text)
                except GcodeError as refused:
                    self._answer(refused.code)
                    waits = False
                    break
                if plain and len(actions) == 1:
                    motion = actions[0]
                    if type(motion) is StraightMove:
                        if planner.count >= capacity:
                            self._held = motion
                            return True
                        if add(motion) is not None or motion.beam != BEAM_CONSTANT:
                            send(OK_REPLY)
                            continue
                waits = self._begin(perform_actions(machine, actions))
                break
            if waits:
                return True

    def _plan_held(self) -> bool:
        """Retry the move that found the planner full. True when it is planned."""
        machine, motion = self._machine, self._held
        assert motion is not None
        planner = machine.planner
        if planner.count >= planner.capacity and machine.state is ControllerState.IDLE:
            machine.start_planned_motion()
            machine.advance_to(machine.now_s)
        if planner.count >= planner.capacity:
            return False
        self._held = None
        if planner.add(motion) is not None or motion.beam != BEAM_CONSTANT:
            self._send(OK_REPLY)
        else:
            self._begin(perform_actions(machine, (motion,)))
        return True

    def _unusual(self, text: bytes) -> bool:
        """Execute any other line. True where it has to wait."""
        block = strip_comments_and_spaces(text)
        if self._device.is_line_too_long(text):
            self._answer(TOO_LONG)
        elif not block:
            self._answer(0)
        elif block[:1] == b"$":
            return self._begin(self._commands.execute(block.decode("latin-1")))
        elif self._machine.state in (ControllerState.ALARM, ControllerState.JOG):
            self._answer(LOCKED)
        elif self._latched:
            self._answer(self._latched)
        else:
            return self._begin(self._gcode(block))
        return False

    def _gcode(self, block: bytes) -> Steps:
        try:
            actions = self._interpreter.interpret(block)
        except GcodeError as refused:
            return refused.code
        return (yield from perform_actions(self._machine, actions))

    def _begin(self, steps: Steps, answered: bool = True) -> bool:
        """Execute as far as possible. True where the line has to wait."""
        self._line = steps
        self._answered = answered
        return not self._advance_line()

    def _resume_line(self) -> bool:
        """Retry the waiting line. True when it is done."""
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
        machine, waiting = self._machine, self._waiting
        if waiting is WaitReason.NEVER or self._is_blocked():
            return False
        if not isinstance(waiting, WaitReason):
            return machine.now_s >= waiting - _SLACK_S
        if waiting is WaitReason.PLANNER_ROOM:
            planner = machine.planner
            if planner.count >= planner.capacity:
                machine.start_planned_motion()
                machine.advance_to(machine.now_s)
            return planner.count < planner.capacity
        machine.start_planned_motion()
        machine.advance_to(machine.now_s)
        return machine.is_at_rest()

    def _answer(self, code: int) -> None:
        if code:
            self._say(ErrorReply(code))
        else:
            self._send(OK_REPLY)
        if self._latches:
            self._latched = code
        if self._machine.state is ControllerState.SLEEP:
            self._say(FeedbackMessage("MSG", "Sleeping"))

    def _want_reset(self) -> None:
        self.reset_wanted = True

    def discard_line(self) -> None:
        """Drop the current line."""
        if self._line is not None:
            self._line.close()
            self._line = None
        self._held = None
        self._waiting = WaitReason.NEVER
