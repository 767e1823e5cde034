"""`lmctl recover`: go on with a part whose run was stopped, tripped, or died."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.cell import cell_options, choose_cell
from lmctl.cli.console import confirmed, notice, put, put_json, say
from lmctl.cli.run import outcome, result_as_json
from lmctl.config.machine import MachineProfile, Motion
from lmctl.errors import JournalError, MachineError, UsageError
from lmctl.run.program.reentry import OVERLAP_MM

if TYPE_CHECKING:
    from lmctl.machine.motion.driver import MotionDriver
    from lmctl.run.executor import Continuation, RunResult
    from lmctl.run.journal.aftermath import Aftermath
    from lmctl.run.journal.recovery import Recovery

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
    from lmctl.run.journal import rundir
    from lmctl.run.journal.aftermath import aftermath, continued_by

    choice = choose_cell(machine, sim, bench)
    made = rundir.find(runs_dir, run)
    after = aftermath(made)
    later, unread = continued_by(made)
    if later:
        raise JournalError(f"{run} has been continued by {later}",
                           hint=f"`{rundir.command('recover', runs_dir, later)}` goes on from "
                                "where that one came")

    async def act(profile: MachineProfile) -> RunResult:
        from lmctl.run.executor import Executor

        continuation = await _prepared(after, profile, runs_dir, unread, yes=yes)
        return await Executor(made.job, profile, runs_dir, operator=operator, notice=notice,
                              continues=continuation).run()

    result = choice.do(act)
    if as_json:
        put_json(result_as_json(result))
    else:
        put(outcome(result))


async def _prepared(
    after: Aftermath, profile: MachineProfile, runs_dir: Path, unread: list[str], *, yes: bool
) -> Continuation:
    """Look, say what will be done, ask, and home the machine where its position is lost."""
    from lmctl.cli.machine_acts import journaled, with_motion
    from lmctl.machine.by_hand.controller import motion_at_hand
    from lmctl.machine.by_hand.homing import homing_words, run_home
    from lmctl.machine.motion.identify import homing_enabled
    from lmctl.run.cell.ownership import owning
    from lmctl.run.executor import Continuation

    with owning(profile, "lmctl recover", runs_dir):
        async with motion_at_hand(profile) as motion:
            found, words = _found(after, motion, profile.motion)
            trusted = found.matched or motion.position_trusted
            home = not trusted or _alarmed(motion)
            steps = ["home the machine: its position is not known",
                     *homing_words(motion.settings)] if home else []
            if after.began and not found.matched and not homing_enabled(motion.settings):
                steps += _TAKEN_AT_ITS_WORD
    say("\n".join([
        *words,
        *(f"  the journal of {name} cannot be read: do not go on if that run was to go on with "
          "this part" for name in unread),
        "what will be done:",
        *(f"  {step}" for step in steps),
        "  acknowledge the feeders' alarms; gas and powder on at the purge position, until stable",
        f"  enter the part again up to {OVERLAP_MM:g} mm before that place, and go on to its end",
    ]))
    if not confirmed("go on?", yes):
        raise UsageError("not recovered: nothing has been sent that moves the machine")
    if home:
        await journaled(profile, runs_dir, {"do": "home"},
                        lambda whereabouts: with_motion(profile, whereabouts, run_home))
    return Continuation(after.run.run, found.place, trusted=found.matched or home)


def _found(
    after: Aftermath, motion: MotionDriver, profile: Motion
) -> tuple[Recovery, list[str]]:
    """Where the job goes on, and how that was found out."""
    from lmctl.job.reader import JobReader
    from lmctl.run.journal.recovery import find_place, refuse_finished

    with JobReader(after.run.job) as job:
        found = find_place(job, after, motion.position_mm)
        refuse_finished(job, after, found.place, profile)
        layer = sum(entry.first_line <= found.place.line for entry in job.manifest.layers)
    return found, [
        f"{after.run.run} ended {after.ended} ({after.header.get('part', '')})",
        f"  the machine was found in state {motion.found.state}, at "
        f"{_position(motion.position_mm)}",
        f"  executed: up to layer {layer}, program line {found.place.line} "
        f"({100 * found.place.share:.0f} % of it): {found.why}",
    ]


def _alarmed(motion: MotionDriver) -> bool:
    if motion.status is None:
        raise MachineError("the motion controller does not say where it is")
    return motion.status.state == "Alarm"


def _position(position_mm: tuple[float, ...] | None) -> str:
    if position_mm is None:
        return "an unknown place"
    return " ".join(f"{axis}{value:.3f}" for axis, value in zip("XYZ", position_mm, strict=False))
