"""`lmctl export`: a job for another controller or as a table, a part as 3MF with its mixture."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message
from lmctl.cli.paths import InputFile
from lmctl.errors import UsageError


@click.command()
@click.argument("file", type=InputFile())
@click.option("--to", "form", required=True, metavar="FORM",
              help="Of a job: plain, linuxcnc, siemens, a dialect file .toml of your own, or csv: "
              "the layers as planned. Of a part: 3mf, its surface with the mixture inside.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="File to write [FILE with the ending of FORM].")
def export(file: Path, form: str, output: Path | None) -> None:
    """Write a job for another controller, powder led by its hoses' delays already; or a part.

    Nothing of lmctl watches a machine that runs it: no interlock, no journal, no hold with powder.
    """
    if form == "3mf":
        print_data(str(_export_part(file, output)))
        return
    if file.suffix.lower() == ".toml":
        raise UsageError(f"{file} is no job file",
                         hint="plan it first, or write the part itself with --to 3mf")
    print_data(str(_export_job(file, form, output)))


def _export_part(file: Path, output: Path | None) -> Path:
    if file.suffix.lower() == ".lmj":
        raise UsageError("--to 3mf is for parts", where=str(file),
                         hint="name the part file that the job was planned of")
    from lmctl.cli.planning import open_part
    from lmctl.report.volumetric_3mf import write_volumetric_3mf

    target = output or file.with_suffix(".3mf")
    _check_folder(target)
    try:
        write_volumetric_3mf(open_part(file), target)
    except OSError as error:
        raise UsageError.cannot_write(target, error) from None
    return target


def _export_job(job: Path, form: str, output: Path | None) -> Path:
    from lmctl.exchange import gcode_lines, load_dialect, planned_layers_as_csv
    from lmctl.job.reader import JobReader

    dialect = None if form == "csv" else load_dialect(form)
    target = output or job.with_suffix(".csv" if dialect is None else dialect.extension)
    _check_folder(target)
    with JobReader(job) as reader:
        if reader.manifest.excerpt is not None:
            raise UsageError(f"{job} holds some layers only, planned for looking",
                             hint="plan all layers, without --layers")
        if dialect is None:
            _write(target, [planned_layers_as_csv(reader)])
        else:
            _write(target, gcode_lines(reader, dialect))
            print_message("note: times are those of the plan; interlocks, beam and gas are the "
                          "task of the controller that runs this")
    return target


def _check_folder(target: Path) -> None:
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")


def _write(target: Path, lines: Iterable[str]) -> None:
    """The file appears complete or not at all."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in lines)
        temporary.replace(target)
    except OSError as error:
        raise UsageError.cannot_write(target, error) from None
    finally:
        temporary.unlink(missing_ok=True)
