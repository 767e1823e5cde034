"""`error:N` and `ALARM:N` of both firmwares in plain words, each with what to do about it.

Sources: Grbl 1.1 `doc/csv/error_codes_en_US.csv`, `alarm_codes_en_US.csv`; grblHAL core
`errors.h`, `errors.c`, `alarms.h`, `alarms.c` and grblHAL plugin SD card `sdcard.c`, as of 2025.
Codes 1-38 and alarms 1-9 mean the same in both. grblHAL numbers that these sources do not name
are reported by their group: a controller lists its own texts in answer to `$EE` and `$EA`.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.dialect import GRBLHAL, Dialect


@dataclass(frozen=True)
class CodeMeaning:
    """The meaning of a code, and its remedy (never empty)."""

    description: str
    remedy: str

    @property
    def implies_damaged_line(self) -> bool:
        """Whether a line that was sound when it was sent can only have been damaged on its way."""
        return self.remedy == _LINE


_PROGRAM = "the program is not for this controller: plan the job again for this machine"
_LINE = "the line was damaged on its way or the program is wrong: check the cable, plan again"
_SETTING = "correct the setting, then try again"
_UNLOCK = "find the reason, then home the machine ($H) or unlock it ($X)"
_HOME = "home the machine ($H)"
_CRITICAL = "reset the controller, move clear, then home the machine ($H)"
_FILE = "the controller's own files are not used here: look at its storage"
_LISTED = "send $EE to the controller: it lists the texts of its own errors"


def _table(*rows: tuple[int, str, str]) -> dict[int, CodeMeaning]:
    return {code: CodeMeaning(words, remedy) for code, words, remedy in rows}


LOCKED_BY_ALARM = 9
"""`error:9`: an alarm came before, whether or not its message arrived."""

_ERRORS = _table(
    (1, "a word does not begin with a letter", _LINE),
    (2, "a number is missing or malformed", _LINE),
    (3, "this $ command is not known", "this firmware lacks the command: check its version"),
    (4, "a value is negative that must not be", _SETTING),
    (5, "homing is switched off", "switch homing on ($22=1) where the machine has switches"),
    (6, "the step pulse is shorter than 3 µs", "set $0 to 3 or more"),
    (7, "the settings memory could not be read; defaults were restored",
     "compare all settings with the machine's record before moving"),
    (8, "the command needs the controller idle", "wait until it is idle, then try again"),
    (9, "the controller is locked by an alarm or jogging", _UNLOCK),
    (10, "soft limits need homing switched on", "set $22=1 first, then $20=1"),
    (11, "the line is too long", _LINE),
    (12, "the step rate would be too high", "lower the greatest speed ($110-$112)"),
    (13, "the safety door is open", "close the door, then resume"),
    (14, "the stored line is too long", "shorten the start-up line ($N)"),
    (15, "the jog goes outside the travel", "jog less far"),
    (16, "the jog command is malformed", _LINE),
    (17, "laser mode needs a PWM output", "use a firmware built with variable spindle output"),
    (20, "the command is not supported", _PROGRAM),
    (21, "two commands of one group in one block", _PROGRAM),
    (22, "no feed rate has been given", _PROGRAM),
    (23, "a value must be a whole number", _LINE),
    (24, "two commands in one block use the axes", _PROGRAM),
    (25, "a word comes twice in one block", _LINE),
    (26, "the command needs axis words", _LINE),
    (27, "the line number is out of range", _LINE),
    (28, "a word the command needs is missing", _LINE),
    (29, "this work offset is not supported", _PROGRAM),
    (30, "G53 without G0 or G1", _PROGRAM),
    (31, "axis words where none are used", _LINE),
    (32, "an arc has no axis words in its plane", _LINE),
    (33, "the target of the motion is not valid", _LINE),
    (34, "the radius of the arc is not possible", _PROGRAM),
    (35, "an arc has no centre in its plane", _LINE),
    (36, "words are left over that nothing uses", _LINE),
    (37, "the tool length offset is given for a wrong axis", _PROGRAM),
    (38, "the tool number is too large", _PROGRAM),
)

_GRBLHAL_ERRORS = _table(
    (18, "reset is asserted", "release the reset input"),
    (19, "a value must be positive", _SETTING),
    (39, "a value is out of range", _PROGRAM),
    (40, "a tool change is pending", "finish the tool change on the controller"),
    (41, "the spindle is not running in a mode that needs its speed", _PROGRAM),
    (42, "threading needs the plane ZX (G18)", _PROGRAM),
    (43, "the feed rate is above the greatest allowed", _PROGRAM),
    (44, "the spindle speed is out of range", "compare the S words with $30 and $31"),
    (45, "a limit switch is engaged", "move clear of the switch, then home ($H)"),
    (46, "the machine must be homed first", _HOME),
    (47, "the tool in the spindle is not known", "set it with M61"),
    (48, "two words contradict each other", _PROGRAM),
    (49, "the self test failed", "switch the controller off and on; do not use it if this stays"),
    (50, "the emergency stop is active", "release the emergency stop, then reset"),
    (51, "a motor reports a fault", "look at the motor drive, then reset"),
    (52, "the setting's value is out of range", _SETTING),
    (53, "the setting is not available in this build", _SETTING),
    (54, "the retract position is below the drill depth", _PROGRAM),
    (55, "two axes of one pair cannot be homed so", "correct the homing settings ($43-$47)"),
    (56, "the coordinate system is locked", "unlock it or use another"),
    (57, "the file has no end mark or too many", _FILE),
    (58, "the auxiliary port is not available", _PROGRAM),
    (60, "the memory card could not be mounted", _FILE),
    (61, "a file could not be read or deleted", _FILE),
    (62, "the directory could not be listed", _FILE),
    (63, "the directory was not found", _FILE),
    (64, "no memory card is mounted", _FILE),
    (65, "no file system is mounted", _FILE),
    (66, "the file system is read-only", _FILE),
    (70, "Bluetooth could not be started", "look at the controller's Bluetooth settings"),
    (71, "an expression uses an unknown operation", _LINE),
    (72, "an expression divides by zero", _LINE),
    (73, "the argument of an expression is out of range", _LINE),
    (74, "an expression is not valid", _LINE),
    (75, "an expression is malformed", _LINE),
    (76, "an expression has no finite result", _LINE),
    (77, "the controller asks for authentication", "log in at the controller"),
    (78, "access is denied", "log in with more rights at the controller"),
    (79, "not allowed while a critical event is active", "clear the event, then reset"),
    (80, "flow control outside a stored macro", _PROGRAM),
    (81, "the flow control word is not known", _PROGRAM),
    (82, "flow control is nested too deep", _PROGRAM),
    (83, "flow control ran out of memory", _PROGRAM),
    (84, "a file could not be opened", _FILE),
    (85, "the file system could not be formatted", _FILE),
    (86, "an error of a port or file of the controller", _LISTED),
    (87, "an error of the tool table or a file of the controller", _LISTED),
    (88, "an error of the tool table or a file of the controller", _LISTED),
    (89, "an error of the tool table or a file of the controller", _LISTED),
    (90, "cutter compensation is already on", _PROGRAM),
    (91, "cutter compensation is not possible here", _PROGRAM),
    (92, "the path is too tight for cutter compensation", _PROGRAM),
    (253, "an error of the controller's own extension", "look in the extension's manual"),
)

_ALARMS = _table(
    (0, "an alarm whose number did not arrive; the position may be lost", _UNLOCK),
    (1, "a hard limit was hit; the position is lost", _CRITICAL),
    (2, "the target is outside the travel (soft limit); the position is kept",
     "reset and unlock ($X), then compare work offset and job with the travel"),
    (3, "reset while moving; the position is lost", _HOME),
    (4, "the probe was already closed", _UNLOCK),
    (5, "the probe did not close", _UNLOCK),
    (6, "homing was interrupted by a reset", _HOME),
    (7, "homing was interrupted by the door", "close the door, then home the machine ($H)"),
    (8, "the limit switch did not open when pulled off", "raise $27 or look at the switch"),
    (9, "no limit switch was found while homing", "raise the travel ($130-$132) or look at the "
     "switch"),
    (10, "the second switch of a doubled axis was not found", "look at both switches"),
)

_GRBLHAL_ALARMS = _table(
    (10, "the emergency stop is active", "release the emergency stop, reset, then home ($H)"),
    (11, "the machine must be homed first", _HOME),
    (12, "a limit switch is engaged", "move clear of the switch, then reset"),
    (13, "the probe is protecting itself", "take the probe out of contact, then reset"),
    (14, "the spindle did not reach its speed", "look at the spindle or laser source"),
    (15, "the second switch of a doubled axis was not found", "look at both switches"),
    (16, "the self test failed", "switch the controller off and on"),
    (17, "a motor reports a fault", "look at the motor drive, then reset"),
    (18, "homing failed", _HOME),
    (19, "a Modbus device of the controller failed", "look at the controller's own bus"),
    (20, "the input/output expander failed", "look at the expander, then reset"),
    (21, "the settings memory failed", "compare all settings with the machine's record"),
    (22, "the receive buffer overflowed; lines were lost",
     "reset; the link's receive buffer is smaller than the controller stated"),
)

_ERRORS_OF_GRBLHAL = {**_ERRORS, **_GRBLHAL_ERRORS}
_ALARMS_OF_GRBLHAL = {**_ALARMS, **_GRBLHAL_ALARMS}


def error_meaning(code: int, dialect: Dialect) -> CodeMeaning:
    """The meaning of `error:code`; of an unlisted code, that it is not listed."""
    table = _ERRORS_OF_GRBLHAL if dialect is GRBLHAL else _ERRORS
    return table.get(code) or CodeMeaning(
        f"error {code}, which is not listed for {dialect.name}", "look in the firmware's manual"
    )


def alarm_meaning(code: int, dialect: Dialect) -> CodeMeaning:
    """The meaning of `ALARM:code`; of an unlisted code, that it is not listed.

    code : 0 where it is not known
    """
    table = _ALARMS_OF_GRBLHAL if dialect is GRBLHAL else _ALARMS
    return table.get(code) or CodeMeaning(
        f"alarm {code}, which is not listed for {dialect.name}", _UNLOCK
    )


def alarm_loses_position(alarm: int, dialect: Dialect) -> bool:
    """Whether the reported position can no longer be trusted after this alarm.

    Kept after a soft limit, probe failures and a demand for homing; lost after every other.
    """
    kept = {2, 4, 5, 13, 14, 19} if dialect is GRBLHAL else {2, 4, 5}
    return alarm not in kept
