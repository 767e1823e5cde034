"""`lmctl optimise`: the free numbers of a part file, chosen by its simulated performance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import (
    format_duration,
    print_data,
    print_json,
    print_message,
    progress_bar,
)
from lmctl.cli.init import make_folder
from lmctl.cli.interrupts import interruptible
from lmctl.cli.paths import InputFile
from lmctl.cli.profiles import load_profile_or_default
from lmctl.cli.simulate import open_measured, print_cost, require_design_extra
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.part.load import MeasuredPart


@click.command()
@click.argument("part", type=InputFile())
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Folder for the results [PART-optimised].")
@click.option("-m", "--machine", type=InputFile(),
              help="Profile of the cell that is to deposit it [the bench cell].")
@click.option("--anew", is_flag=True, help="Forget an interrupted search in the folder.")
@click.option("--dry", is_flag=True, help="Say unknowns, memory and time, and stop.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def optimise(
    part: Path, output: Path | None, machine: Path | None, anew: bool, dry: bool, as_json: bool
) -> None:
    """Choose the free numbers of PART so that the table [optimise] is met best.

    Writes the part file with the numbers in their places, and a report of before and after. An
    interrupted search goes on when it is called again.
    """
    require_design_extra()
    from lmctl.config.free_numbers_text import text_with_values
    from lmctl.design.design_problem import DesignProblem
    from lmctl.design.optimiser import read_state, search
    from lmctl.report.optimisation_report import write_report

    profile = load_profile_or_default(machine)
    with interruptible():
        measured = open_measured(part)
        if dry:
            _print_dry(measured, as_json)
            return
        problem = DesignProblem(measured, part, profile)
    folder = output or Path(f"{part.stem}-optimised")
    make_folder(folder)
    kept = folder / "search.json"
    if anew:
        kept.unlink(missing_ok=True)
    text = measured.part.text
    state = read_state(kept, text)
    if state.history:
        print_message(f"note: going on after step {len(state.history)} of an earlier search")
    try:
        with progress_bar("optimising") as update, interruptible() as check_interrupt:
            def step_done(done: int, total: int, note: str) -> None:
                check_interrupt()
                update(done, total, note)

            best = search(problem, state, kept, step_done)
        with interruptible():
            values = problem.design.values(best)
            target = folder / part.name
            target.write_text(text_with_values(text, str(part), values), encoding="utf-8")
            data = write_report(problem, state, best, folder)
    except OSError as error:
        raise UsageError.cannot_write(folder, error) from None
    if as_json:
        print_json(data)
        return
    print_data(f"{data['minimised']}: {data['objective_before']:.5g} before, "
               f"{data['objective_after']:.5g} after {data['steps']} steps")
    for name, value in values.items():
        print_data(f"  {name:40} {value:.6g}")
    print_data(f"  part file          {target}")
    print_data(f"  report             {folder / 'report.html'}")


def _print_dry(measured: MeasuredPart, as_json: bool) -> None:
    """What one solution, and the whole search at most, will take."""
    from lmctl.config import toml_file
    from lmctl.config.free_numbers import resolve_free_numbers
    from lmctl.design.part_model import model_cost

    cost = model_cost(measured.part, measured.file.simulation)
    settings = measured.file.optimise
    free = resolve_free_numbers(toml_file.parse_tables(measured.part.text, name="part")).free
    print_cost(cost, as_json)
    if settings is not None and not as_json:
        steps = settings.starts * settings.iterations
        adjoint = 2 + len(settings.limit)
        print_data(f"{len(free)} free numbers, at most {steps} steps: at most "
                   f"{format_duration(steps * adjoint * cost.solve_s)}")
