"""`$` commands. Sources: Grbl 1.1 `system.c`, `doc/markdown/commands.md`; the transcripts."""

from __future__ import annotations

import re
from collections.abc import Callable

from firmware_protocol.dialect import GRBLHAL, Dialect
from firmware_protocol.gcode import GcodeError
from firmware_protocol.messages import FeedbackMessage, Message, UnknownMessage
from simulators.motion import reports
from simulators.motion.action_execution import is_out_of_travel
from simulators.motion.homing import home_machine
from simulators.motion.interpreter import GcodeInterpreter
from simulators.motion.machine import MotionMachine
from simulators.motion.settings import SettingError
from simulators.motion.states import ControllerState
from simulators.motion.waits import Steps, WaitReason

BAD_NUMBER, UNKNOWN, HOMING_OFF, NOT_IDLE, STORED_TOO_LONG = 2, 3, 5, 8, 14
DOOR_OPEN, JOG_OUTSIDE = 13, 15

_HELP = "$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x"
_ASSIGNMENT = re.compile(r"\$([0-9.]+)=(.*)")
_STORED = re.compile(r"\$N([0-9])=(.*)")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")


class SystemCommands:
    """Executes `$` lines for one controller.

    startup : the stored lines, by number
    leave_check_mode : called when `$C` ends check mode, after the reply
    """

    def __init__(
        self,
        dialect: Dialect,
        interpreter: GcodeInterpreter,
        machine: MotionMachine,
        identity: list[Message],
        gcode: Callable[[bytes], Steps],
        leave_check_mode: Callable[[], None],
    ) -> None:
        self.startup = {0: "", 1: ""}
        self._dialect = dialect
        self._hal = dialect is GRBLHAL
        self._settings = machine.settings
        self._interpreter = interpreter
        self._machine = machine
        self._identity = identity
        self._gcode = gcode
        self._leave_check_mode = leave_check_mode
        self._anytime: dict[str, Callable[[], int]] = {
            "$": self._help,
            "$$": self._list_settings,
            "$G": self._parser_state,
            "$C": self._check_mode,
            "$X": self._unlock,
        }
        self._at_rest: dict[str, Callable[[], int]] = {
            "$#": self._parameters,
            "$I": lambda: self._say(*self._identity),
            "$N": lambda: self._say(*reports.startup_listing(self.startup)),
            "$SLP": self._sleep,
            "$RST=$": self._restore_settings,
            "$RST=#": self._restore_offsets,
            "$RST=*": lambda: self._restore_settings() or self._restore_offsets(),
        }

    def execute(self, text: str) -> Steps:
        """text : upper case, without spaces and comments, beginning with `$`"""
        now = self._anytime.get(text)
        if now is not None:
            return now()
        machine = self._machine
        if text.startswith("$J="):
            return (yield from self._jog(text))
        if machine.state not in (ControllerState.IDLE, ControllerState.ALARM):
            return NOT_IDLE
        if text == "$H":
            return (yield from self._home())
        later = self._at_rest.get(text)
        if later is not None:
            return later()
        if stored := _STORED.fullmatch(text):
            return (yield from self._store_line(int(stored[1]), stored[2]))
        if text.startswith("$I="):
            return 0
        return self._assign(text)

    def run_startup_blocks(self) -> Steps:
        """Run the stored lines after a reset or homing."""
        for number in sorted(self.startup):
            block = self.startup[number]
            if block:
                code = yield from self._gcode(block.encode("latin-1"))
                answer = f"error:{code}" if code else "ok"
                self._machine.say(UnknownMessage(f">{block}:{answer}"))
        return 0

    def _say(self, *messages: Message) -> int:
        for message in messages:
            self._machine.say(message)
        return 0

    def _help(self) -> int:
        return self._say(FeedbackMessage("HLP", _HELP))

    def _list_settings(self) -> int:
        if self._machine.state in (ControllerState.RUN, ControllerState.HOLD):
            return NOT_IDLE
        return self._say(*reports.settings_listing(self._settings))

    def _parser_state(self) -> int:
        return self._say(reports.parser_state_line(self._dialect, self._interpreter))

    def _parameters(self) -> int:
        return self._say(
            *reports.parameter_lines(self._dialect, self._interpreter, self._machine.probed_mm)
        )

    def _check_mode(self) -> int:
        machine = self._machine
        if machine.state is ControllerState.CHECK:
            self._say(FeedbackMessage("MSG", "Disabled"))
            self._leave_check_mode()
            return 0
        if machine.state is not ControllerState.IDLE:
            return NOT_IDLE
        machine.state = ControllerState.CHECK
        return self._say(FeedbackMessage("MSG", "Enabled"))

    def _unlock(self) -> int:
        machine = self._machine
        if machine.state is ControllerState.ALARM:
            if machine.door_open:
                return DOOR_OPEN
            self._say(FeedbackMessage("MSG", "Caution: Unlocked"))
            machine.state = ControllerState.IDLE
            machine.alarm = 0
        return 0

    def _sleep(self) -> int:
        if self._hal:
            return UNKNOWN  # not built into the firmware that was transcribed
        machine = self._machine
        machine.accessories.switch_all_off(machine.now_s)
        machine.state = ControllerState.SLEEP
        return 0

    def _assign(self, text: str) -> int:
        assignment = _ASSIGNMENT.fullmatch(text)
        if assignment is None:
            return UNKNOWN if self._hal else BAD_NUMBER
        number, value = assignment.groups()
        if not number.isdigit() or not _NUMBER.fullmatch(value):
            return BAD_NUMBER
        try:
            self._settings.store(int(number), float(value))
        except SettingError as refused:
            return refused.code
        self._refresh()
        return 0

    def _restore_settings(self) -> int:
        self._settings.restore_defaults()
        self._refresh()
        return self._say(FeedbackMessage("MSG", "Restoring defaults"))

    def _restore_offsets(self) -> int:
        self._interpreter.offsets.restore()
        self._interpreter.on_settings_changed()
        return self._say(FeedbackMessage("MSG", "Restoring defaults"))

    def _refresh(self) -> None:
        self._interpreter.on_settings_changed()
        self._machine.planner.kinematics = self._settings.kinematics()

    def _store_line(self, number: int, block: str) -> Steps:
        if number not in self.startup:
            return UNKNOWN
        if len(block) >= self._dialect.max_line_chars:
            return STORED_TOO_LONG
        if block:  # the firmware executes the line before it stores it
            code = yield from self._gcode(block.encode("latin-1"))
            if code:
                return code
        self.startup[number] = block
        return 0

    def _jog(self, text: str) -> Steps:
        machine = self._machine
        if machine.state not in (ControllerState.IDLE, ControllerState.JOG):
            return NOT_IDLE
        try:
            motion = self._interpreter.interpret_jog(text[3:].encode("latin-1"))
        except GcodeError as refused:
            return refused.code
        if is_out_of_travel(machine, motion.target_mm):
            return JOG_OUTSIDE
        self._interpreter.position_mm = motion.target_mm
        yield WaitReason.PLANNER_ROOM
        if machine.planner.add(motion) is not None and machine.state is ControllerState.IDLE:
            machine.state = ControllerState.JOG
            machine.stepper.start(machine.now_s)
        return 0

    def _home(self) -> Steps:
        machine = self._machine
        if not self._settings.is_homing_enabled:
            return HOMING_OFF
        if machine.door_open:
            return DOOR_OPEN
        yield from home_machine(machine)
        self._interpreter.position_mm = machine.planner.position_mm
        return (yield from self.run_startup_blocks())
