"""`lmctl machine home|jog|offset|unlock`: acts on a machine, asked about first and journaled."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from lmctl.cli.cell import CellChoice, cell_options, choose_cell
from lmctl.cli.console import ask_confirmation, print_data, print_message
from lmctl.cli.number_types import FiniteRange
from lmctl.config.machine import MachineProfile
from lmctl.errors import LmctlError, MachineError, UsageError

if TYPE_CHECKING:
    from lmctl.machine.manual.inspect_motion import MotionReading
    from lmctl.machine.motion.driver import MotionDriver
    from lmctl.run.cell.doctor import CellInspection
    from lmctl.run.journal.last_known_position import LastKnownPosition

T = TypeVar("T")

_WORD = re.compile(r"([XYZxyz])([+-]?[0-9]{1,5}(?:\.[0-9]{1,4})?)")


@click.command()
@cell_options
@click.option("--yes", is_flag=True, help="Do not ask.")
def home(
    machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path, yes: bool
) -> None:
    """Home the axes, which clears an alarm. Says what will move, and asks first."""
    from lmctl.machine.manual.homing import home_axes

    cell = choose_cell(machine, sim, bench)
    for line in cell.run_on_cell(lambda profile: _what_moves(profile, runs_dir)):
        print_message(line)
    _ask("Is the way free? Home the machine?", yes)
    at = _move(cell, runs_dir, {"do": "home"}, home_axes)
    print_data(f"homed; the machine is at {_place(at)}")


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("words", nargs=-1, required=True, metavar="X10 Y-5 Z2")
@cell_options
@click.option("--feed", "feed_mm_min", type=FiniteRange(1, 100_000), default=600.0,
              show_default=True, help="Speed along the way [mm/min].")
@click.option("--relative", is_flag=True, help="By so much from where the machine is.")
def jog(
    words: tuple[str, ...], machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path,
    feed_mm_min: float, relative: bool,
) -> None:
    """Move the named axes to a place [mm], in a straight line, without beam. Ctrl-C stops it.

    Axes that are not named stay where they are.
    """
    from lmctl.machine.manual.jog import JogRequest, jog_axes

    cell = choose_cell(machine, sim, bench)
    wanted = JogRequest(_axes(words), relative, feed_mm_min)
    at = _move(
        cell, runs_dir,
        {"do": "jog", "to_mm": wanted.to_mm, "relative": relative, "feed_mm_min": feed_mm_min},
        lambda motion: jog_axes(wanted, motion, cell.profile.motion),
    )
    print_data(f"the machine is at {_place(at)}")


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("words", nargs=-1, metavar="[X-300 Y-300 Z-200]")
@cell_options
@click.option("--here", is_flag=True, help="The values are the present position.")
@click.option("--clear", is_flag=True,
              help="First go back to G54, and clear G92 (G92.1) and the tool length (G49).")
def offset(
    words: tuple[str, ...], machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path,
    here: bool, clear: bool,
) -> None:
    """Set the work offset (G54): the machine coordinates [mm] of program zero.

    With --here: the program coordinates of the present position. Axes that are not
    named keep theirs. The controller remembers it. Without axes, the offsets in force are shown.
    """
    from lmctl.machine.manual.homing import clear_work_offsets, set_work_offset

    cell = choose_cell(machine, sim, bench)
    axes = _axes(words)
    if here and not axes:
        raise UsageError("--here needs the coordinates of this place", hint="--here X0 Y0 Z0")
    if not axes and not clear:
        _put_offsets(_look(cell, runs_dir).motion)
        return

    async def act(motion: MotionDriver) -> tuple[float, ...]:
        at = await clear_work_offsets(motion) if clear else ()
        return await set_work_offset(motion, axes, here=here) if axes else at

    at = _move(cell, runs_dir, {"do": "offset", "axes": axes, "here": here, "clear": clear}, act)
    print_data(f"program zero lies at {_place(at)} of the machine")


def _put_offsets(look: MotionReading | LmctlError) -> None:
    """The work offset in force, and what it is made of. Raises MachineError where it is unknown."""
    from lmctl.run.cell.work_offset import work_offset_conditions

    if isinstance(look, LmctlError):
        raise look
    at = look.offset_mm
    if at is None:
        raise MachineError(f"the controller does not report its offsets in state "
                           f"{look.report.state}", hint="`lmctl machine doctor` says more")
    print_data(f"program zero lies at {_place(at)} of the machine")
    for line in look.offsets:
        print_data(f"  {line.strip('[]').replace(':', '  ')}")
    for condition in work_offset_conditions(look.parser_state, look.offsets):
        print_data(f"✗ {condition.text}")
        print_data(f"    what to do: {condition.hint}")


@click.command()
@cell_options
@click.option("--yes", is_flag=True, help="Do not ask.")
def unlock(
    machine: Path | None, sim: bool, bench: Path | None, runs_dir: Path, yes: bool
) -> None:
    """End the latched alarms of the motion controller and the feeders, as a deliberate act.

    With homing enabled the position stays distrusted: home the machine afterwards. Without it, to
    unlock is to say that the position is right; one that was lost has to be stated instead, with
    `lmctl machine offset --here`.
    """
    cell = choose_cell(machine, sim, bench)
    locked = _locked(_look(cell, runs_dir), cell.profile)
    if not locked:
        print_data("nothing is locked")
        return
    for device, reason in locked.items():
        print_message(f"{device}: {reason}")
    _ask("Are the causes gone? Unlock?", yes)
    cell.run_on_cell(lambda profile: _unlocked(profile, runs_dir, locked))
    print_data("unlocked: " + ", ".join(locked))
    if "motion" in locked:
        print_data("hint: `lmctl machine doctor` says whether its position is known")


async def _what_moves(profile: MachineProfile, runs_dir: Path) -> list[str]:
    from lmctl.machine.manual.controller import open_motion_controller
    from lmctl.machine.manual.homing import describe_homing
    from lmctl.run.cell.ownership import lock_machine

    with lock_machine(profile, "lmctl machine home", runs_dir):
        async with open_motion_controller(profile) as motion:
            return describe_homing(motion.settings)


def _locked(look: CellInspection, profile: MachineProfile) -> dict[str, str]:
    """Devices with a latched alarm, each with the reason. Raises where one cannot be reached."""
    from firmware_protocol.pmx import FeederStatusBits

    found = {}
    if isinstance(look.motion, LmctlError):
        raise look.motion
    if look.motion.report.state == "Alarm":
        found["motion"] = "the controller is locked by an alarm"
    for feeder in profile.feeder:
        reading = look.feeders[feeder.name]
        if isinstance(reading, LmctlError):
            raise reading
        if reading.status.alarm is not None:
            found[feeder.name] = reading.status.alarm.text
        elif FeederStatusBits.WATCHDOG_TRIPPED in reading.status.flags:
            found[feeder.name] = "its watchdog has tripped"
    return found


async def _unlocked(profile: MachineProfile, runs_dir: Path, locked: dict[str, str]) -> None:
    from lmctl.machine.feeder.driver import FeederDriver
    from lmctl.machine.manual.homing import unlock_controller
    from lmctl.run.cell.doctor import hoppers_of_feeder

    async def unlocked(whereabouts: LastKnownPosition) -> None:
        if "motion" in locked:
            await run_with_motion(profile, whereabouts, unlock_controller)
        for feeder in profile.feeder:
            if feeder.name in locked:
                driver = await FeederDriver.open(feeder, hoppers_of_feeder(profile, feeder.name))
                try:
                    await driver.reset_alarms()
                finally:
                    await driver.close()

    await run_journaled(profile, runs_dir, {"do": "unlock", "locked": locked}, unlocked)


async def run_with_motion(
    profile: MachineProfile, whereabouts: LastKnownPosition,
    act: Callable[[MotionDriver], Awaitable[T]]
) -> T:
    """What the act returns."""
    from lmctl.machine.manual.controller import open_motion_controller

    async with open_motion_controller(profile) as motion:
        try:
            whereabouts.judge_position(motion)
            return await act(motion)
        finally:
            whereabouts.record_position(motion)


def _move(
    cell: CellChoice, runs_dir: Path, what: dict[str, Any],
    act: Callable[[MotionDriver], Awaitable[tuple[float, ...]]],
) -> tuple[float, ...]:
    """Act on the axes, journaled; returns what the act does, a place."""

    async def moved(profile: MachineProfile) -> tuple[float, ...]:
        return await run_journaled(
            profile, runs_dir, what, lambda whereabouts: run_with_motion(profile, whereabouts, act)
        )

    return cell.run_on_cell(moved)


async def run_journaled(
    profile: MachineProfile, runs_dir: Path, what: dict[str, Any],
    act: Callable[[LastKnownPosition], Awaitable[T]],
) -> T:
    """Lock the machine; journal the act before it begins and when it has ended."""
    from lmctl.run.cell.ownership import lock_machine
    from lmctl.run.journal.last_known_position import LastKnownPosition

    with lock_machine(profile, f"lmctl machine {what['do']}", runs_dir):
        whereabouts = LastKnownPosition(runs_dir, profile)
        journal = whereabouts.journal
        journal.append("act", **what)
        why = "a bug"
        try:
            result = await act(whereabouts)
            why = ""
        except asyncio.CancelledError:
            why = "stopped by the operator"
            raise
        except LmctlError as error:
            why = error.what
            raise
        finally:
            journal.append("ended", do=what["do"], **({"why": why} if why else {}),
                           **whereabouts.left)
        return result


def _look(cell: CellChoice, runs_dir: Path) -> CellInspection:
    from lmctl.cli.machine_inspection import inspect

    return cell.run_on_cell(lambda profile: inspect(profile, "lmctl machine", runs_dir))


def _place(at: tuple[float, ...]) -> str:
    return "  ".join(f"{axis} {value:.3f}" for axis, value in zip("XYZ", at, strict=False)) + " mm"


def _axes(words: tuple[str, ...]) -> dict[str, float]:
    """Axis words as places. Raises UsageError."""
    found: dict[str, float] = {}
    for word in words:
        matched = _WORD.fullmatch(word)
        if matched is None:
            raise UsageError(f"{word!r} is no axis with a place", hint="write X10 Y-5 Z2.5")
        axis = matched[1].upper()
        if axis in found:
            raise UsageError(f"{axis} is named twice", hint="give each axis once")
        found[axis] = float(matched[2])
    return found


def _ask(question: str, yes: bool) -> None:
    if not ask_confirmation(question, yes):
        raise click.Abort
