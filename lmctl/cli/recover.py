"""`lmctl recover`: go on with a part whose run was stopped, tripped, or died."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.cell import cell_options, choose_cell
from lmctl.cli.console import ask_confirmation, print_data, print_json, print_message
from lmctl.cli.operator import operator_name, operator_option
from lmctl.cli.run import outcome_text, result_as_json
from lmctl.cli.run_screen import run_screen
from lmctl.config.machine import MachineProfile
from lmctl.errors import JournalError, MachineError, UsageError
from lmctl.run.program.reentry import OVERLAP_MM

if TYPE_CHECKING:
    from lmctl.job.reader import JobReader
    from lmctl.machine.motion.driver import MotionDriver
    from lmctl.run.executor import EarlierRun, RunResult
    from lmctl.run.journal.recovery import MachineSeen, RecoveryPlace
    from lmctl.run.journal.replay import RunReplay
    from lmctl.run.program.place import PlaceReached

    #: (job, the stretch in doubt, its length [mm], its beads in words) → how much is on the part
    DepositedMm = Callable[[JobReader, PlaceReached, float, list[str]], float]

#: A serial server that serves one client notices some time later that it has gone [s].
_LET_GO_S = 0.2

#: What `--deposited` takes instead of a length.
_ALL = "all"


@click.command()
@click.argument("run")
@cell_options
@click.option("--yes", is_flag=True, help="Do not ask before the machine is touched.")
@click.option("--deposited", metavar="MM",
              help="Of the bead that is in doubt, so many millimetres are on the part: you have "
                   "looked. 0, a length, or \"all\".")
@click.option("--position-restored", is_flag=True,
              help="The controller had lost its place, and you have given it back by other means "
                   "than `lmctl machine offset --here`: program coordinates are those of the part "
                   "again.")
@operator_option
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
def recover(
    run: str, runs_dir: Path, machine: Path | None, sim: bool, bench: Path | None, yes: bool,
    deposited: str | None, position_restored: bool, operator: str | None, as_json: bool,
) -> None:
    """Go on with the part of RUN, which was stopped, tripped or died.

    Its journal is verified and the machine is looked at before anything is sent to it. What will
    be done is shown, and asked. The part is entered again where deposition ended, after fresh
    powder; a new run is journaled, which names the one it continues.

    A controller that has lost its place is never believed: without homing its position has to be
    restored first. Where no report shows how much was deposited, you are asked. (The
    simulated cell is a new one with every command, so its controller has lost its place.)
    """
    from lmctl.run.journal import run_folders
    from lmctl.run.journal.replay import continuing_runs, replay_run

    choice = choose_cell(machine, sim, bench)
    answer = None if deposited is None else _length(deposited)
    made = run_folders.find_run_folder(runs_dir, run)
    after = replay_run(made)
    later, unread = continuing_runs(made)
    if later:
        again = run_folders.command_line("recover", runs_dir, later)
        raise JournalError(f"{run} has been continued by {later}",
                           hint=f"`{again}` goes on from where that one came")

    name = operator_name("" if yes and operator is None else operator)

    async def act(profile: MachineProfile) -> RunResult:
        from lmctl.run.executor import RunExecutor

        continuation = await prepare(
            after, profile, runs_dir, unread, yes=yes, restored=position_restored,
            stated_mm=answer, ask=_refuse_to_guess if yes else _ask_operator)
        with run_screen(made.job, profile) as on_screen:
            return await RunExecutor(
                made.job, profile, runs_dir, operator=name, notice=on_screen.notice,
                watcher=on_screen.watcher, continues=continuation).run()

    result = choice.run_on_cell(act)
    if as_json:
        print_json(result_as_json(result))
    else:
        print_data(outcome_text(result))


async def prepare(
    after: RunReplay, profile: MachineProfile, runs_dir: Path, unread: list[str], *, yes: bool,
    restored: bool, stated_mm: float | None, ask: DepositedMm,
) -> EarlierRun:
    """Look, say what will be done, ask, and home the machine where its position is lost.

    restored : the operator has restored the machine's position
    stated_mm : how much of the bead in doubt is on the part, as the operator has stated it
    ask : called to get that length otherwise
    Raises MachineError where the position is lost; UsageError where no operator can be asked.
    """
    from lmctl.cli.machine_actions import run_journaled, run_with_motion
    from lmctl.job.reader import JobReader
    from lmctl.machine.manual.controller import open_motion_controller
    from lmctl.machine.manual.homing import describe_homing, home_axes
    from lmctl.machine.motion.identity import is_homing_enabled
    from lmctl.run.cell.ownership import lock_machine
    from lmctl.run.execution.unreported_motion import journal_unreported_motion
    from lmctl.run.executor import EarlierRun
    from lmctl.run.journal.last_known_position import LastKnownPosition
    from lmctl.run.journal.recovery import find_recovery_place, refuse_finished

    with lock_machine(profile, "lmctl recover", runs_dir), JobReader(after.run.job) as job:
        uptimes_s = await _uptimes_s(profile)
        async with open_motion_controller(profile) as motion:
            whereabouts = LastKnownPosition(runs_dir, profile)
            whereabouts.judge_position(motion)
            seen = _seen(motion, uptimes_s, whereabouts.history.lost)
            found = find_recovery_place(job, after, seen, profile)
            if not is_homing_enabled(motion.settings):
                _refuse_lost(after, motion, found, restored=(
                    restored or whereabouts.history.is_stated_since_run))
            home = is_homing_enabled(motion.settings) and (
                _is_alarmed(motion) or (found.lost != "" and not seen.homed))
            steps = [f"home the machine: {found.lost or 'its controller is in alarm'}",
                     *describe_homing(motion.settings)] if home else []
        print_message("\n".join(_found_words(job, after, motion, found)))
        reached = _settled(job, found.reached, stated_mm, ask)
        try:
            refuse_finished(job, after, reached.place, profile.motion)
        except JournalError:
            journal_unreported_motion(job, after.run, reached)
            raise
        print_message("\n".join([
            *(f"  the journal of {name} cannot be read: do not go on if that run was to go on with "
              "this part" for name in unread),
            "what will be done:",
            *(f"  {step}" for step in steps),
            "  acknowledge the feeders' alarms; gas and powder on at the purge position, until "
            "stable",
            f"  enter the part again at most {OVERLAP_MM:g} mm before that place, and go on to its "
            "end",
        ]))
    if not ask_confirmation("go on?", yes):
        raise UsageError("not recovered: nothing has been sent that moves the machine",
                         hint="the same command asks again")
    standstill_mm = seen.position_mm
    await asyncio.sleep(_LET_GO_S)
    if home:
        standstill_mm = await run_journaled(
            profile, runs_dir, {"do": "home"},
            lambda whereabouts: run_with_motion(profile, whereabouts, home_axes))
        await asyncio.sleep(_LET_GO_S)
    return EarlierRun(after.run.run, reached, is_position_trusted=True, standstill_mm=standstill_mm)


async def _uptimes_s(profile: MachineProfile) -> dict[str, float]:
    """For how long each of the cell's other devices has run; those that answer."""
    from contextlib import suppress

    from lmctl.config.machine import HopperSettings
    from lmctl.machine.manual.inspect_modbus import inspect_feeder, inspect_safety

    uptimes_s: dict[str, float] = {}
    for feeder in profile.feeder:
        hoppers: list[HopperSettings] = []
        with suppress(MachineError):
            look = await inspect_feeder(feeder, hoppers)
            if look.identity.reports_uptime:
                uptimes_s[feeder.name] = look.status.uptime_s
    if profile.safety is not None:
        with suppress(MachineError):
            uptimes_s["the safety device"] = (await inspect_safety(profile.safety)).uptime_s
    return uptimes_s


def _seen(
    motion: MotionDriver, uptimes_s: dict[str, float], recorded_loss: str
) -> MachineSeen:
    from lmctl.machine.motion.identity import is_homing_enabled
    from lmctl.run.journal.recovery import MachineSeen

    report = motion.status
    at_mm = None if report is None else report.machine_mm
    doubt = motion.position_doubt
    if is_homing_enabled(motion.settings) and not motion.position_trusted:
        doubt = "nothing shows that the machine is homed"
    return MachineSeen(
        motion.position_mm, at_zero=at_mm is not None and not any(at_mm),
        restarted=motion.restarted,
        homed=motion.position_trusted and is_homing_enabled(motion.settings), doubt=doubt,
        recorded_loss=recorded_loss, dialect=motion.identity.dialect, uptimes_s=uptimes_s,
    )


def _refuse_lost(
    after: RunReplay, motion: MotionDriver, found: RecoveryPlace, *, restored: bool
) -> None:
    """Raise MachineError where a controller without homing has lost its place, or is in alarm."""
    from lmctl.run.cell.motion_conditions import TOUCH_OFF

    if _is_alarmed(motion):
        raise MachineError("the motion controller is in alarm, and has no homing cycle ($22=0)",
                           hint="see that its position is right, then `lmctl machine unlock`")
    if found.lost == "" or restored:
        return
    raise MachineError(
        "the controller has lost its place: going on would deposit at a wrong one",
        where=[found.lost, "it has no homing ($22=0) by which to find it again"],
        hint=f"{TOUCH_OFF}; then `{after.run.command('recover')}` (with --position-restored where "
             "you have given it back in another way)",
    )


def _found_words(
    job: JobReader, after: RunReplay, motion: MotionDriver, found: RecoveryPlace
) -> list[str]:
    """Where the job goes on, and how that was found out."""
    place = found.reached.place
    layer = sum(entry.first_line <= place.line for entry in job.manifest.layers)
    return [
        f"{after.run.run} ended {after.ended} ({after.header.get('part', '')})",
        f"  the machine was found in state {motion.first_report.state}, at "
        f"{_position(motion.position_mm)}",
        f"  executed: up to layer {layer}, program line {place.line} "
        f"({100 * place.line_fraction:.0f} % of it): {found.reason}",
    ]


def _settled(
    job: JobReader, reached: PlaceReached, stated_mm: float | None, ask: DepositedMm
) -> PlaceReached:
    """The place reached, by the operator's word where journal and machine leave it open."""
    from lmctl.run.journal.recovery import doubt_in_words, stated_by_operator
    from lmctl.run.program.job_lines import bead_between_mm

    if not reached.is_doubtful:
        if stated_mm is not None:
            raise UsageError("--deposited: no bead is in doubt", hint="leave it out")
        return reached
    doubt_mm = bead_between_mm(job, reached.place, reached.until)
    words = doubt_in_words(job, reached)
    length_mm = ask(job, reached, doubt_mm, words) if stated_mm is None else stated_mm
    if length_mm > doubt_mm + 0.1 and length_mm != float("inf"):
        raise UsageError(f"{length_mm:g} mm are more than the {doubt_mm:.1f} mm in doubt",
                         where=words, hint="say \"all\" where all of it is there")
    return stated_by_operator(job, reached, length_mm)


def _ask_operator(
    job: JobReader, reached: PlaceReached, doubt_mm: float, words: list[str]
) -> float:
    """The operator's answer after a look at the part. Raises UsageError where none is there."""
    if not sys.stdin.isatty():
        return _refuse_to_guess(job, reached, doubt_mm, words)
    print_message("\n".join([
        f"  in doubt: {doubt_mm:.1f} mm of bead that were sent, with no report of their execution:",
        *(f"    {line}" for line in words),
        "  look at the part. What is there is not deposited again; what is missing is.",
    ]))
    return _length(click.prompt(
        f"how much of it is there, in mm (0 to {doubt_mm:.1f}, or all)", err=True))


def _refuse_to_guess(
    _: JobReader, __: PlaceReached, doubt_mm: float, words: list[str]
) -> float:
    raise UsageError(
        f"{doubt_mm:.1f} mm of bead may be on the part or not, and no operator can be asked",
        where=words,
        hint="look at the part, then give the same command with `--deposited MM`: how much of that "
             f"is there, from 0 to {doubt_mm:.1f}, or all",
    )


def _length(text: str) -> float:
    """A length as the operator states it; inf for all. Raises UsageError."""
    if text.strip().lower() == _ALL:
        return float("inf")
    try:
        length_mm = float(text.replace(",", "."))
    except ValueError:
        length_mm = -1.0
    if not 0.0 <= length_mm < float("inf"):
        raise UsageError(f"{text!r} is no length in mm", hint="say 0, 3.5 or all")
    return length_mm


def _is_alarmed(motion: MotionDriver) -> bool:
    if motion.status is None:
        raise MachineError("the motion controller does not say where it is",
                           hint="see `lmctl machine doctor`")
    return motion.status.state == "Alarm"


def _position(position_mm: tuple[float, ...] | None) -> str:
    if position_mm is None:
        return "an unknown place"
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", position_mm, strict=False))
