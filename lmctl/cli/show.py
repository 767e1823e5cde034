"""`lmctl show`: a job, a run or a part, as pictures, as pages, or for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import print_data, print_message, progress_bar
from lmctl.cli.interrupts import interruptible
from lmctl.cli.number_types import FiniteRange
from lmctl.cli.paths import InputFileOrRun, is_run
from lmctl.cli.planning import check_bare_options, open_part, units_option, up_option
from lmctl.errors import UsageError

if TYPE_CHECKING:
    from lmctl.part.part import Part

PICTURES = (".png", ".svg", ".pdf")
SURFACES = (".ply", ".stl", ".3mf")
FIELD = ".vti"
PAGE = ".html"


@click.command()
@click.argument("file", metavar="FILE|RUN", type=InputFileOrRun())
@click.option("-l", "--layer", type=int,
              help="Of a job or run: layer number, from 1 [the middle one].")
@click.option("-x", "x_mm", type=FiniteRange(),
              help="Of a part: where the plane across x lies [middle].")
@click.option("-y", "y_mm", type=FiniteRange(), help="The same for y.")
@click.option("-z", "z_mm", type=FiniteRange(), help="The same for z.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="File to write. .html: all of a job or run, to look through; .png, .svg, .pdf: "
              "a picture; .vti: a part's distance and composition for ParaView; .ply: its surface, "
              "coloured; .stl, .3mf: its surface.")
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of runs.")
@click.option("--frame", type=click.Choice(["machine", "part"]), default="machine",
              show_default=True, help="Of a job: whose coordinates the picture shows.")
@units_option
@up_option
def show(
    file: Path, layer: int | None, x_mm: float | None, y_mm: float | None, z_mm: float | None,
    output: Path | None, runs_dir: Path, frame: str, units: str | None, up: str | None,
) -> None:
    """Show FILE: a job, or sections of a part's distance and composition; or a RUN.

    A job or a run as .html is one page that needs no network: every layer with the beads at their
    width, by mixture, power, speed, flow, mixture error or order, and curves of flow and mixture.
    Of a run it also shows what was executed, and what devices reported.
    """
    planes = (x_mm, y_mm, z_mm)
    if planes != (None, None, None) and (is_run(file) or file.suffix.lower() == ".lmj"):
        raise UsageError("-x, -y and -z are for parts", where=str(file),
                         hint="choose a layer with --layer")
    if is_run(file):
        print_data(str(_show_run(file, runs_dir, layer, output)))
        return
    check_bare_options(file, units, up)
    if file.suffix.lower() == ".lmj":
        print_data(str(_show_job(file, layer, output, frame)))
        return
    if layer is not None:
        raise UsageError("--layer is for jobs", where=str(file),
                         hint="choose planes of a part with -x, -y and -z")
    target = output or Path(f"{file.stem}-fields.png")
    if target.suffix.lower() not in (*PICTURES, *SURFACES, FIELD):
        raise UsageError(f"cannot show a part as {target.suffix or 'a file with no ending'}",
                         where=str(target),
                         hint=f"choose one of {', '.join((*PICTURES, FIELD, *SURFACES))}")
    if planes != (None, None, None) and target.suffix.lower() not in PICTURES:
        raise UsageError("-x, -y and -z are for pictures", where=str(target),
                         hint=f"all of the part goes into a {target.suffix} file; leave them out")
    _check_folder(target)
    part = open_part(file, units, up)
    for text in part.warnings:
        print_message(f"warning: {text}")
    _refuse_beside(part, planes)
    _write_part(part, planes, target)
    print_data(str(target))


def _refuse_beside(part: Part, planes_mm: tuple[float | None, ...]) -> None:
    """Raise UsageError for planes that do not meet the part."""
    low, high = part.bounds_mm
    beside = [
        f"{axis} = {plane:g} mm, and the part is from {least:g} to {most:g}"
        for axis, plane, least, most in zip("xyz", planes_mm, low, high, strict=True)
        if plane is not None and not least <= plane <= most
    ]
    if beside:
        raise UsageError("a plane does not meet the part", where=beside,
                         hint="choose another, or leave it out for the middle")


@interruptible()
def _write_part(
    part: Part, planes_mm: tuple[float | None, float | None, float | None], target: Path
) -> None:
    """What `show` has to say of a part, in the form its file's ending asks for."""
    try:
        if target.suffix.lower() == FIELD:
            from lmctl.report.part_export import write_field

            with progress_bar("writing") as update, interruptible() as check_interrupt:
                def slab_done(done: int, total: int) -> None:
                    check_interrupt()
                    update(done, total, "")

                write_field(part, target, slab_done)
        elif target.suffix.lower() in SURFACES:
            from lmctl.report.part_export import write_surface

            write_surface(part, target)
        else:
            from lmctl.report.part_picture import draw_part

            draw_part(part, planes_mm, target)
    except OSError as error:
        raise UsageError.cannot_write(target, error) from None


@interruptible()
def _show_job(job: Path, layer: int | None, output: Path | None, frame: str) -> Path:
    from lmctl.job.reader import JobReader

    with JobReader(job) as reader:
        count = len(reader.manifest.layers)
        number = layer if layer is not None else count // 2 + 1
        if not 1 <= number <= count:
            raise UsageError(f"{job} has no layer {number}", hint=f"layers go from 1 to {count}")
        target = output or Path(f"{job.stem}-layer-{number}.png")
        if target.suffix.lower() != PAGE:
            from lmctl.report.job_layer_picture import draw_job_layer

            draw_job_layer(reader, number - 1, target, frame)
            return target
    from lmctl.report.job_viewer import write_job_viewer

    _check_folder(target)
    write_job_viewer(job, target, number - 1)
    return target


@interruptible()
def _show_run(run: Path, runs_dir: Path, layer: int | None, output: Path | None) -> Path:
    from lmctl.cli.log import find_journal
    from lmctl.report.job_viewer import write_run_viewer

    journal = find_journal(str(run), runs_dir)
    target = output or Path(f"{journal.parent.name}.html")
    if target.suffix.lower() != PAGE:
        raise UsageError(f"cannot show a run as {target.suffix or 'a file with no ending'}",
                         where=str(target), hint="choose .html")
    _check_folder(target)
    write_run_viewer(journal, target, None if layer is None else layer - 1)
    return target


def _check_folder(target: Path) -> None:
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")
