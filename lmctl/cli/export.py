"""`lmctl export`: a job in the language of another controller, or as a table."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import click

from lmctl.cli.console import print_data, print_message
from lmctl.cli.paths import InputFile
from lmctl.errors import UsageError


@click.command()
@click.argument("job", type=InputFile())
@click.option("--to", "form", required=True, metavar="FORM",
              help="plain, linuxcnc, siemens, a dialect file .toml of your own, or csv: the "
              "layers as planned.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="File to write [JOB with the ending of FORM].")
def export(job: Path, form: str, output: Path | None) -> None:
    """Write JOB for another controller, powder led by its hoses' delays already.

    Nothing of lmctl watches a machine that runs it: no interlock, no journal, no hold with powder.
    """
    from lmctl.exchange import gcode_lines, load_dialect, planned_layers_as_csv
    from lmctl.job.reader import JobReader

    dialect = None if form == "csv" else load_dialect(form)
    target = output or job.with_suffix(".csv" if dialect is None else dialect.extension)
    if not target.parent.is_dir():
        raise UsageError(f"there is no folder {target.parent}", hint="make it first")
    with JobReader(job) as reader:
        if reader.manifest.excerpt is not None:
            raise UsageError(f"{job} holds some layers only, planned for looking",
                             hint="plan all layers, without --layers")
        if dialect is None:
            _write(target, [planned_layers_as_csv(reader)])
        else:
            _write(target, gcode_lines(reader, dialect))
            print_message("note: times are those of the plan; whoever runs this elsewhere answers "
                          "for interlocks, beam and gas")
    print_data(str(target))


def _write(target: Path, lines: Iterable[str]) -> None:
    """The file appears complete or not at all."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.writelines(f"{line}\n" for line in lines)
        temporary.replace(target)
    except OSError as error:
        raise UsageError(f"cannot write {target}", where=str(error.strerror)) from None
    finally:
        temporary.unlink(missing_ok=True)
