"""`lmctl recover`: go on with a part whose run was stopped, tripped, or died."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.cell import cell_options, choose_cell
from lmctl.cli.console import ask_confirmation, print_data, print_json, print_message, print_notice
from lmctl.cli.run import outcome_text, result_as_json
from lmctl.config.machine import MachineProfile, MotionSettings
from lmctl.errors import JournalError, MachineError, UsageError
from lmctl.run.program.reentry import OVERLAP_MM

if TYPE_CHECKING:
    from lmctl.machine.motion.driver import MotionDriver
    from lmctl.run.executor import EarlierRun, RunResult
    from lmctl.run.journal.recovery import RecoveryPlace
    from lmctl.run.journal.replay import RunReplay

#: Of a machine without homing that does not stand where its run ended.
_TAKEN_AT_ITS_WORD = (
    "believe where the controller says that it stands, which is not where the run ended: it has no",
    "homing to prove it. Was it switched off, or moved by hand? Then do not go on, but say first",
    "where it is: `lmctl machine jog --relative`, then `lmctl machine offset --here`",
)


@click.command()
@click.argument("run")
@cell_options
@click.option("--yes", is_flag=True, help="Do not ask before the machine is touched.")
@click.option("--operator", default="", help="Name for the journal.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
def recover(
    run: str, runs_dir: Path, machine: Path | None, sim: bool, bench: Path | None, yes: bool,
    operator: str, as_json: bool,
) -> None:
    """Go on with the part of RUN, which was stopped, tripped or died.

    Its journal is verified and the machine is looked at before anything is sent to it. What will
    be done is shown, and asked. The part is entered again a few millimetres before the place
    reached, after fresh powder; a new run is journaled, which names the one it continues.
    """
    from lmctl.run.journal import run_folders
    from lmctl.run.journal.replay import continued_by, replay_run

    choice = choose_cell(machine, sim, bench)
    made = run_folders.find_run_folder(runs_dir, run)
    after = replay_run(made)
    later, unread = continued_by(made)
    if later:
        again = run_folders.command_line("recover", runs_dir, later)
        raise JournalError(f"{run} has been continued by {later}",
                           hint=f"`{again}` goes on from where that one came")

    async def act(profile: MachineProfile) -> RunResult:
        from lmctl.run.executor import RunExecutor

        continuation = await _prepared(after, profile, runs_dir, unread, yes=yes)
        return await RunExecutor(made.job, profile, runs_dir, operator=operator,
                                 notice=print_notice,
                                 continues=continuation).run()

    result = choice.run_on_cell(act)
    if as_json:
        print_json(result_as_json(result))
    else:
        print_data(outcome_text(result))


async def _prepared(
    after: RunReplay, profile: MachineProfile, runs_dir: Path, unread: list[str], *, yes: bool
) -> EarlierRun:
    """Look, say what will be done, ask, and home the machine where its position is lost."""
    from lmctl.cli.machine_actions import run_journaled, with_motion
    from lmctl.machine.manual.controller import open_motion
    from lmctl.machine.manual.homing import describe_homing, home_axes
    from lmctl.machine.motion.identity import is_homing_enabled
    from lmctl.run.cell.ownership import lock_machine
    from lmctl.run.executor import EarlierRun

    with lock_machine(profile, "lmctl recover", runs_dir):
        async with open_motion(profile) as motion:
            found, words = _found(after, motion, profile.motion)
            trusted = found.matched or motion.position_trusted
            home = not trusted or _alarmed(motion)
            steps = ["home the machine: its position is not known",
                     *describe_homing(motion.settings)] if home else []
            if after.has_begun and not found.matched and not is_homing_enabled(motion.settings):
                steps += _TAKEN_AT_ITS_WORD
    print_message("\n".join([
        *words,
        *(f"  the journal of {name} cannot be read: do not go on if that run was to go on with "
          "this part" for name in unread),
        "what will be done:",
        *(f"  {step}" for step in steps),
        "  acknowledge the feeders' alarms; gas and powder on at the purge position, until stable",
        f"  enter the part again up to {OVERLAP_MM:g} mm before that place, and go on to its end",
    ]))
    if not ask_confirmation("go on?", yes):
        raise UsageError("not recovered: nothing has been sent that moves the machine")
    if home:
        await run_journaled(profile, runs_dir, {"do": "home"},
                            lambda whereabouts: with_motion(profile, whereabouts, home_axes))
    return EarlierRun(after.run.run, found.place, trusted=found.matched or home)


def _found(
    after: RunReplay, motion: MotionDriver, profile: MotionSettings
) -> tuple[RecoveryPlace, list[str]]:
    """Where the job goes on, and how that was found out."""
    from lmctl.job.reader import JobReader
    from lmctl.run.journal.recovery import find_place, refuse_finished

    with JobReader(after.run.job) as job:
        found = find_place(job, after, motion.position_mm)
        refuse_finished(job, after, found.place, profile)
        layer = sum(entry.first_line <= found.place.line for entry in job.manifest.layers)
    return found, [
        f"{after.run.run} ended {after.ended} ({after.header.get('part', '')})",
        f"  the machine was found in state {motion.first_report.state}, at "
        f"{_position(motion.position_mm)}",
        f"  executed: up to layer {layer}, program line {found.place.line} "
        f"({100 * found.place.line_fraction:.0f} % of it): {found.reason}",
    ]


def _alarmed(motion: MotionDriver) -> bool:
    if motion.status is None:
        raise MachineError("the motion controller does not say where it is")
    return motion.status.state == "Alarm"


def _position(position_mm: tuple[float, ...] | None) -> str:
    if position_mm is None:
        return "an unknown place"
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", position_mm, strict=False))
