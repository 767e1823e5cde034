"""Writing firmware settings: each by itself, then all of them read back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lmctl.errors import MachineError
from lmctl.machine.manual.settings_file import is_same_value
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import HOMING, parse_settings

#: Directions, homing and steps per mm: what a position means is another one afterwards.
_OF_POSITION = frozenset((3, HOMING, 23, 27, 100, 101, 102, 103, 104, 105))


@dataclass(frozen=True)
class WrittenSettings:
    """The result of writing settings.

    written : those that the controller reports as wanted, and did not before
    refused : why the others were not: the controller's own words, or what it reports instead
    also_changed : settings that changed without being written, with their old and new values
    messages : what the controller reported beside its answers
    position_lost : the machine has to be homed, or its place set, before it is moved
    """

    written: dict[int, str]
    refused: dict[int, str]
    also_changed: dict[int, tuple[str, str]]
    messages: list[str]
    position_lost: bool


async def apply_settings(motion: MotionDriver, wanted: Mapping[int, str]) -> WrittenSettings:
    """Write the settings that differ, and read all back.

    A setting may be refused for the value of another (soft limits without homing): those refused
    are tried once more after the rest.
    Raises MachineError where the controller is not at rest, or is lost on the way.
    """
    report = motion.status
    if report is None or report.state not in ("Idle", "Alarm"):
        state = "unknown" if report is None else report.state
        raise MachineError(f"settings cannot be written in state {state}",
                           hint="wait until the machine has stopped")
    before = parse_settings(await motion.send_command("$$"))
    left = {number: value for number, value in wanted.items()
            if number not in before or not is_same_value(value, before[number])}
    asked = dict(left)
    refused: dict[int, str] = {}
    messages: list[str] = []
    for _ in range(2):
        refused = await _write(motion, left, messages)
        left = {number: left[number] for number in refused}
        if not left:
            break
    after = parse_settings(await motion.send_command("$$"))
    for number, value in asked.items():
        if number not in after:
            refused[number] = "this controller has no such setting"
        elif number not in refused and not is_same_value(value, after[number]):
            refused[number] = f"it was taken, and reads back as {after[number]}"
    changed = {number: (before[number], after.get(number, "missing")) for number in before
               if before[number] != after.get(number, "missing")}
    lost = bool(_OF_POSITION & changed.keys())
    if lost:
        motion.position_trusted = False
    return WrittenSettings(
        {number: after[number] for number in asked if number not in refused}, refused,
        {number: values for number, values in changed.items() if number not in asked},
        messages, lost,
    )


async def _write(
    motion: MotionDriver, settings: Mapping[int, str], messages: list[str]
) -> dict[int, str]:
    """Send each; returns why those that were refused were. Raises MachineError for a lost link."""
    refused = {}
    for number, value in settings.items():
        try:
            said = await motion.send_command(f"${number}={value}")
        except MachineError as error:
            if not motion.is_all_answered:  # there was no answer at all
                raise
            refused[number] = error.what
        else:
            messages += said
    return refused
