"""`lmctl note`: the reason of a deviation, and what was decided about it."""

from __future__ import annotations

from pathlib import Path

import click

from lmctl.cli.console import print_data
from lmctl.cli.operator import operator_name, operator_option
from lmctl.errors import UsageError

_DISPOSITIONS = ("accepted", "reworked", "scrapped")


@click.command()
@click.argument("run")
@click.argument("text")
@click.option("--about", type=click.IntRange(min=0), metavar="NUMBER",
              help="Number of the deviation, as the log prints it behind #.")
@click.option("--disposition", type=click.Choice(_DISPOSITIONS), help="What was decided about it.")
@operator_option
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of runs.")
def note(
    run: str, text: str, about: int | None, disposition: str | None, operator: str | None,
    runs_dir: Path,
) -> None:
    """Add TEXT to the log of RUN: why something deviated from the plan, and what was decided.

    Notes are kept beside the journal, chained by hashes of their own and bound to it, so that a
    sealed journal stays as it is.
    """
    from lmctl.run.journal import run_folders
    from lmctl.run.journal.notes import Disposition, add_note

    if not text.strip():
        raise UsageError("a note has a text", hint='lmctl note RUN "the reason"')
    made = run_folders.find_run_folder(runs_dir, run)
    add_note(made, text.strip(), about=about, operator=operator_name(operator),
             disposition=None if disposition is None else Disposition(disposition))
    print_data(f"noted on {made.run}" + ("" if about is None else f", #{about}"))
    print_data(f"hint: `{made.command('log')}` prints it")
