"""`lmctl simulate`: temperature, displacement and stress of a part in service."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import (
    format_duration,
    print_data,
    print_json,
    print_message,
    wrapped,
)
from lmctl.cli.init import make_folder
from lmctl.cli.interrupts import interruptible
from lmctl.cli.paths import InputFile
from lmctl.errors import MissingFileError, UsageError

if TYPE_CHECKING:
    from lmctl.design.as_built import AsBuiltComposition
    from lmctl.design.part_model import ModelCost
    from lmctl.part.load import MeasuredPart


@click.command()
@click.argument("part", type=InputFile())
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Folder for the results [PART-simulation].")
@click.option("--as-built", type=click.Path(path_type=Path),
              help="Simulate what a simulated run has built: its folder, or its voxel-map.npz.")
@click.option("--dry", is_flag=True, help="Say unknowns, memory and time, and stop.")
@click.option("--json", "as_json", is_flag=True, help="Print the extremes as JSON.")
@interruptible()
def simulate(
    part: Path, output: Path | None, as_built: Path | None, dry: bool, as_json: bool
) -> None:
    """Simulate PART: heat and thermo-elasticity with the composition of every place.

    The part file states loads, supports and heat. Writes fields (.vtu, .vti), pictures and extremes
    with their places and estimated errors.
    """
    require_design_extra()
    from lmctl.design.part_model import build_model, model_cost

    measured = open_measured(part)
    if dry:
        print_cost(model_cost(measured.part, measured.file.simulation), as_json)
        return
    from lmctl.design.field_files import write_vti, write_vtu
    from lmctl.design.recovery import recover_fields
    from lmctl.design.simulation_report import coarseness_warnings, extremes, summary_lines
    from lmctl.report.simulation_pictures import draw_simulation

    folder = output or Path(f"{part.stem}-simulation")
    composition = measured.part.composition
    title = measured.part.name
    model = build_model(measured)
    if as_built is not None:
        built = _open_as_built(as_built, measured)
        title += ", as built"
        void = built.void_share(model.discretisation.part_places_mm)
        if void > 0:
            print_message(f"warning: {void:.1%} of the part lies in voxels that are less than half "
                          "full; the model takes them as solid")
        solution = model.solve(model.fractions_of(built))
        fields = recover_fields(model, solution, built)
    else:
        solution = model.solve(model.fractions_of(composition))
        fields = recover_fields(model, solution, composition)
    data = extremes(model, solution, fields)
    make_folder(folder)
    try:
        write_vtu(model, fields, folder / "fields.vtu")
        write_vti(model, fields, folder / "fields.vti")
        draw_simulation(model, fields, folder / "fields.png", title)
        (folder / "extremes.json").write_text(
            json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise UsageError.cannot_write(folder, error) from None
    for warning in coarseness_warnings(data):
        print_message(wrapped(f"warning: {warning}"))
    if as_json:
        print_json(data)
        return
    for line in summary_lines(data):
        print_data(line)
    print_data(f"  results            {folder}: fields.vtu, fields.vti, fields.png, extremes.json")


def require_design_extra() -> None:
    """Raise UsageError where the libraries of the extra `design` are not installed."""
    missing = [name for name, module in (("scikit-fem", "skfem"), ("pyamg", "pyamg"))
               if importlib.util.find_spec(module) is None]
    if missing:
        raise UsageError(f"simulation needs {' and '.join(missing)}",
                         hint="pip install 'lmctl[design]'")


def open_measured(path: Path) -> MeasuredPart:
    """A part file with what a simulation measures from; reports what was taken by default."""
    if path.suffix.lower() != ".toml":
        raise UsageError(f"{path} is no part file",
                         hint="loads and supports are stated in a part file (.toml)")
    from lmctl.part.load import load_measured_part

    measured = load_measured_part(path, report=print_message)
    for text in measured.part.warnings:
        print_message(wrapped(f"warning: {text}"))
    return measured


def print_cost(cost: ModelCost, as_json: bool) -> None:
    """What a simulation will take."""
    if as_json:
        print_json({"unknowns": cost.unknowns, "elements": cost.elements,
                    "memory_mb": cost.memory_bytes / 1e6, "solve_s": cost.solve_s})
        return
    print_data(f"about {cost.unknowns:,} unknowns, {cost.elements:,} elements, "
               f"{cost.memory_bytes / 1e6:,.0f} MB, {format_duration(cost.solve_s)} a solution")


def _open_as_built(run: Path, measured: MeasuredPart) -> AsBuiltComposition:
    """The voxel map of a run, in the part's coordinates."""
    from lmctl.design.as_built import read_as_built

    names = tuple(material.name for material in measured.part.materials)
    path = run / "voxel-map.npz" if run.is_dir() else run
    if not path.is_file():
        raise MissingFileError.for_path(
            path, "a simulated run leaves it where the bench has a table [process]")
    return read_as_built(path, names).moved(_part_offset_mm(path.parent))


def _part_offset_mm(folder: Path) -> tuple[float, float, float]:
    """Where a run's job has the part's own origin; a simulated machine has no work offset."""
    from lmctl.job.reader import JobReader
    from lmctl.run.journal.run_folders import RunFolder

    with JobReader(RunFolder(folder).job) as job:
        return job.manifest.part_offset_mm
