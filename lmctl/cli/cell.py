"""Which cell a `lmctl machine` command works with: a real one (--machine), or the bench (--sim)."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click

from lmctl.cli.paths import InputFile
from lmctl.cli.profiles import load_profile_or_default
from lmctl.config.machine import MachineProfile
from lmctl.errors import UsageError

T = TypeVar("T")


@dataclass(frozen=True)
class CellChoice:
    """The cell that was named on the command line."""

    profile: MachineProfile
    sim: bool
    bench: Path | None
    profile_path: Path | None = None

    def run_on_cell(self, act: Callable[[MachineProfile], Coroutine[Any, Any, T]]) -> T:
        """Do something with it; a simulated cell lives as long as that. Raises what it raises."""
        if not self.sim:
            return run_in_real_time(act(self.profile))
        from lmctl.cli.bench import run_on_bench

        return run_on_bench(act, self.profile, self.bench)


def run_in_real_time(driving: Coroutine[Any, Any, T]) -> T:
    """Drive a real cell, before other work of this computer. Raises what it raises."""
    from lmctl.run.real_time_priority import real_time_priority

    with real_time_priority():
        return asyncio.run(driving)


def choose_cell(
    machine: Path | None, sim: bool, bench: Path | None, *, calibrated: bool = True
) -> CellChoice:
    """Raises UsageError where no cell is named, ConfigError for a bad profile.

    calibrated : as `load_profile_or_default` takes it
    """
    if not sim and machine is None:
        raise UsageError("which machine?",
                         hint="--machine FILE for a real one, --sim for the simulated one")
    if bench is not None and not sim:
        raise UsageError("--bench belongs to --sim", hint="add --sim, or leave --bench out")
    return CellChoice(load_profile_or_default(machine, calibrated=calibrated), sim, bench, machine)


def cell_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options that name a cell, and the folder where its journal is."""
    for option in (
        click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
                     show_default=True, help="Folder of runs, and of the machine's journal."),
        click.option("--bench", type=InputFile(),
                     help="With --sim: the simulated cell's own file [the bench that ships]."),
        click.option("--sim", is_flag=True, help="The simulated machine."),
        click.option("-m", "--machine", type=InputFile(),
                     help="Machine profile of a real one."),
    ):
        command = option(command)
    return command
