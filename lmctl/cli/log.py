"""`lmctl log`: the log of a run, from its journal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import print_data, print_message
from lmctl.errors import JournalError, UsageError

if TYPE_CHECKING:
    from lmctl.report.part_record import PartRecord
    from lmctl.run.journal.format import JournalVerification


@click.command()
@click.argument("run")
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of runs.")
@click.option("--json", "as_json", is_flag=True, help="The journal itself, as one JSON object.")
@click.option("--csv", "as_csv", is_flag=True, help="The layers as comma-separated values.")
@click.option("--run-only", is_flag=True,
              help="Of RUN alone, and not of every run that worked on its part.")
@click.option("--verify", "verify_only", is_flag=True,
              help="Only check the journal; exit 1 where it is broken or not sealed.")
def log(
    run: str, runs_dir: Path, as_json: bool, as_csv: bool, run_only: bool, verify_only: bool
) -> None:
    """Print the log of the part that RUN worked on, over all its runs.

    RUN is a run's name (run-0001), its folder, or a journal file.
    """
    if as_json + as_csv + verify_only > 1:
        raise UsageError("--json, --csv and --verify exclude each other", hint="give one of them")
    journal = find_journal(run, runs_dir)
    if verify_only:
        _verify(journal)
    elif as_json:
        _put_journal(journal)
    elif as_csv:
        from lmctl.report.job_log_csv import part_record_as_csv as form

        print_data(_printed(journal, form, run_only=run_only))
    else:
        print_data(job_log_as_text(journal, run_only=run_only))


def job_log_as_text(journal: Path, *, run_only: bool = False) -> str:
    """The log of the part that a journal is of, as text."""
    from lmctl.report.job_log_text import part_record_as_text

    return _printed(journal, part_record_as_text, run_only=run_only)


def _printed(journal: Path, form: Callable[[PartRecord], str], *, run_only: bool) -> str:
    """The log in some form; damage is said on the way. Raises JournalError."""
    from lmctl.report.part_record import part_record_of
    from lmctl.run.journal.format import verify_journal

    found = verify_journal(journal)
    _warn(found)
    try:
        part = part_record_of(journal, run_only=run_only)
        for run in part.runs:
            if run.journal != journal:
                _warn(run.verification, run.run)
        return form(part)
    except (KeyError, TypeError, ValueError, AttributeError):
        if found.intact:  # it is what was written, so we do not understand ourselves
            raise
        raise JournalError(
            f"{journal} was damaged or altered, and no log can be printed of it",
            where=f"line {found.broken_line}: {found.reason}",
            hint="`lmctl log --json` prints its records as they are",
        ) from None


def _warn(found: JournalVerification, run: str = "") -> None:
    if found.broken_line is not None:
        of = f" of {run}" if run else ""
        print_message(
            f"warning: the journal{of} is broken at line {found.broken_line}: {found.reason}")


def find_journal(run: str, runs_dir: Path) -> Path:
    """A run's journal: by the run's name, or a path to the journal or its folder.

    Raises JournalError where there is none.
    """
    from lmctl.run.journal import run_folders

    path = Path(run)
    if path.is_file():
        return path
    if path.is_dir() and (path / run_folders.JOURNAL).is_file():
        return path / run_folders.JOURNAL
    return run_folders.find_run_folder(runs_dir, run).journal


def _verify(journal: Path) -> None:
    from lmctl.run.journal.format import verify_journal

    found = verify_journal(journal)
    _verify_notes(journal)
    if found.broken_line is not None:
        raise JournalError(
            f"{journal} was damaged or altered", where=f"line {found.broken_line}: {found.reason}",
            hint=f"the {found.records} records before that line are whole",
        )
    if not found.sealed:
        raise JournalError(
            f"{journal} is whole so far, but not sealed", where=found.reason,
            hint="the run is still going, or was broken off",
        )
    print_data(f"{journal}: whole and sealed, {found.records:,} records")


def _verify_notes(journal: Path) -> None:
    from lmctl.run.journal.notes import NOTES_FILE_NAME, verify_notes

    found = verify_notes(journal)
    if found is not None and found.broken_line is not None:
        raise JournalError(
            f"the notes of {journal.parent.name} do not fit their journal, or were altered",
            where=f"{journal.parent / NOTES_FILE_NAME}, line {found.broken_line}: {found.reason}",
            hint="restore both from a copy; without notes the journal is as it was")


def _put_journal(journal: Path) -> None:
    """One JSON object, written record by record: a journal may be larger than memory likes."""
    import json

    from lmctl.run.journal.format import read_records, verify_journal

    found = verify_journal(journal)
    _warn(found)
    head = {"journal": str(journal), "sealed": found.sealed, "whole": found.intact}
    print_data(json.dumps(head)[:-1] + ', "records": [')
    separator = ""
    for record in read_records(journal):
        print_data(separator + json.dumps(record, ensure_ascii=False))
        separator = ","
    print_data("]}")
