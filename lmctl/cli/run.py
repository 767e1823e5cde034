"""`lmctl run`: a job on the simulated machine (--sim) or on the one a profile names (--machine)."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.cell import run_in_real_time
from lmctl.cli.console import format_duration, print_data, print_json, print_message
from lmctl.cli.number_types import FiniteRange
from lmctl.cli.operator import operator_name, operator_option
from lmctl.cli.paths import InputFile
from lmctl.cli.profiles import load_profile_or_default
from lmctl.cli.run_screen import run_screen
from lmctl.config.machine import MachineProfile
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.run.executor import RunResult


@click.command()
@click.argument("job", type=InputFile())
@click.option("--sim", is_flag=True, help="Run on the simulated machine, in virtual time.")
@click.option("-m", "--machine", type=InputFile(), help="Machine profile to run on.")
@click.option("--bench", type=InputFile(),
              help="With --sim: the simulated cell's own file [the bench that ships].")
@click.option("--speed", type=FiniteRange(min=0, min_open=True),
              help="With --sim: times real time; 1 is real time [as fast as it goes].")
@click.option("--faults", type=InputFile(),
              help="With --sim: a file of what goes wrong with the simulated cell, and when.")
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of run journals.")
@operator_option
@click.option("--json", "as_json", is_flag=True, help="Print the result as one JSON object.")
def run(
    job: Path, sim: bool, machine: Path | None, bench: Path | None, speed: float | None,
    faults: Path | None, runs_dir: Path, operator: str | None, as_json: bool,
) -> None:
    """Run JOB. Never real hardware by default: give --sim, or --machine FILE.

    With --sim, --machine may name the profile the job was planned for; its endpoints are then
    those of the simulated machine.
    """
    if not sim and machine is None:
        raise UsageError("on which machine?",
                         hint="--sim for the simulated one, --machine FILE for a real one")
    if not sim and (bench is not None or speed is not None or faults is not None):
        raise UsageError("--bench, --speed and --faults belong to --sim",
                         hint="add --sim, or leave them out")
    if job.suffix.lower() == ".toml":
        raise UsageError(f"{job} is no job file", hint=f"plan it first: {planning_command(job)}")
    profile = load_profile_or_default(machine)
    result = run_on_screen(job, profile, runs_dir, operator=operator_name(operator), sim=sim,
                           bench=bench, speed=speed, faults=faults)
    if as_json:
        print_json(result_as_json(result))
    else:
        print_data(outcome_text(result))


def planning_command(part: Path) -> str:
    """The command that makes a job of a part file, as it can be typed."""
    return f"`{shlex.join(['lmctl', 'plan', str(part)])}`"


def run_on_screen(
    job: Path, profile: MachineProfile, runs_dir: Path, *, operator: str, sim: bool,
    bench: Path | None, speed: float | None, faults: Path | None = None,
) -> RunResult:
    """Run a job; a terminal shows its state. Raises what the run raises."""
    happened: list[str] = []
    try:
        result = _run_on_screen(job, profile, runs_dir, operator=operator, sim=sim, bench=bench,
                                speed=speed, faults=faults, happened=happened)
        if faults is not None and not happened:
            print_message("faults injected: none")
    finally:
        if happened:
            print_message("faults injected: " + ", ".join(happened))
    return result


def _run_on_screen(
    job: Path, profile: MachineProfile, runs_dir: Path, *, operator: str, sim: bool,
    bench: Path | None, speed: float | None, faults: Path | None, happened: list[str],
) -> RunResult:
    from lmctl.run.executor import run_job

    with run_screen(job, profile) as on_screen:
        if not sim:
            return run_in_real_time(
                run_job(job, profile, runs_dir, operator=operator, watcher=on_screen.watcher,
                        notice=on_screen.notice)
            )
        from lmctl.cli.bench import run_simulated

        return run_simulated(job, profile, runs_dir, operator=operator, watcher=on_screen.watcher,
                             notice=on_screen.notice, bench=bench, speed=speed, faults=faults,
                             happened=happened)


def result_as_json(result: RunResult) -> dict[str, object]:
    """The keys that scripts may rely on."""
    return {
        "run": result.run, "state": result.state, "lines": result.lines,
        "machine_s": result.machine_s, "wall_s": result.wall_s, "journal": str(result.journal),
    }


def outcome_text(result: RunResult) -> str:
    """A finished run in a few lines, for people."""
    from lmctl.run.journal.run_folders import RunFolder

    faster = f", {result.machine_s / result.wall_s:.0f} × real time" if result.wall_s else ""
    return "\n".join([
        f"{result.run}: {result.state}, {result.lines} lines in "
        f"{format_duration(result.machine_s)} of machine time "
        f"({format_duration(result.wall_s)}{faster})",
        f"  journal   {result.journal}",
        f"hint: `{RunFolder(result.journal.parent).command('log')}` prints its log",
    ])
