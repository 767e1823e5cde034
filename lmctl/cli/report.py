"""`lmctl report`: the report of a part that people sign, or its figures for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from lmctl.cli.console import print_data, print_message
from lmctl.errors import JournalError, UsageError

if TYPE_CHECKING:
    from lmctl.report.job_report import ReportSection
    from lmctl.report.part_report import PartReport

FORMS = (".html", ".pdf")


@click.command()
@click.argument("run", required=False)
@click.option("--runs", "runs_dir", type=click.Path(path_type=Path), default=Path("runs"),
              show_default=True, help="Folder of runs.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="File to write: .html or .pdf; with --csv any [RUN-report.html].")
@click.option("--set", "stated", metavar="KEY=VALUE", multiple=True,
              help="State a value of the traveller, as serial=17 or powder.316L.lot=A4711.")
@click.option("--csv", "as_csv", is_flag=True,
              help="The layers as comma-separated values; without RUN the history of all runs.")
@click.option("--run-only", is_flag=True,
              help="Of RUN alone, and not of every run that worked on its part.")
@click.option("--as-built", is_flag=True,
              help="What RUN built against the part's design: by volume, along the path, in height "
              "and powder. -o: .txt, .json, .vti, a picture, a folder for all of them; .html or "
              ".pdf: as a part of the whole report.")
@click.option("-l", "--layer", "layers", type=int, multiple=True,
              help="With --as-built: layer to draw, from 1; may be repeated [the middle one].")
@click.option("--copy", help="With --as-built: of a job with copies, the one to compare [each].")
@click.option("--data", type=click.Path(exists=True, file_okay=False, path_type=Path),
              help="With --as-built: folder of the part's data files [where the runs are, or .].")
@click.option("--json", "as_json", is_flag=True, help="With --as-built: print one JSON object.")
def report(
    run: str | None, runs_dir: Path, output: Path | None, stated: tuple[str, ...], as_csv: bool,
    run_only: bool, as_built: bool, layers: tuple[int, ...], copy: str | None,
    data: Path | None, as_json: bool,
) -> None:
    """Write the report of the part that RUN worked on, over all its runs.

    RUN is a run's name (run-0001), its folder, or a journal file. What was not recorded or
    stated is left as a ruled blank.
    """
    if as_built and not (output is not None and output.suffix.lower() in FORMS):
        if run is None or stated or as_csv or run_only:
            raise UsageError("--as-built takes a run, and neither --set, --csv nor --run-only",
                             hint="`lmctl report run-0001 --as-built`")
        from lmctl.cli.as_built import report_as_built

        report_as_built(run, runs_dir, output, layers, data, copy, as_json=as_json)
        return
    if as_built and (as_csv or as_json or run is None):
        raise UsageError("--as-built with .html or .pdf takes a run, and neither --csv nor --json",
                         hint="`lmctl report run-0001 --as-built -o report.html`")
    if not as_built and (layers or data is not None or as_json or copy is not None):
        raise UsageError("--layer, --copy, --data and --json belong to --as-built",
                         hint="add --as-built, or leave them out")
    if run is None:
        if not as_csv:
            raise UsageError("of which run?",
                             hint="`lmctl report run-0001`, or --csv for the history of all runs")
        if stated or run_only:
            raise UsageError("--set and --run-only belong to a run",
                             hint="name it: `lmctl report run-0001`")
        _write_history(runs_dir, output)
        return
    if not as_csv and output is not None and output.suffix.lower() not in FORMS:
        raise UsageError(f"cannot write a report as {output.suffix or 'a file with no ending'}",
                         where=str(output), hint="choose .html or .pdf, or add --csv")
    if output is not None and not output.parent.is_dir():
        raise UsageError(f"there is no folder {output.parent}", hint="make it first")
    found = _part_report(run, runs_dir, stated, run_only=run_only)
    if as_csv:
        from lmctl.report.part_report_csv import part_report_as_csv

        _put_text(part_report_as_csv(found), output)
        return
    target = output or Path(f"{found.record.runs[-1].run}-report.html")
    built = _as_built_sections(run, runs_dir, data, layers, copy) if as_built else ()
    _write(target, _rendered(found, target.suffix.lower(), built))
    print_data(str(target))
    _say_what_is_open(found)


def _part_report(
    run: str, runs_dir: Path, stated: tuple[str, ...], *, run_only: bool
) -> PartReport:
    """Raises JournalError where a journal holds what no report can be made of."""
    from lmctl.cli.log import find_journal
    from lmctl.report.part_report import part_report_of
    from lmctl.run.journal.format import verify_journal

    journal = find_journal(run, runs_dir)
    try:
        return part_report_of(journal, run_only=run_only, stated=stated)
    except (KeyError, TypeError, ValueError, AttributeError):
        found = verify_journal(journal)
        if found.intact:  # it is what was written, so we do not understand ourselves
            raise
        raise JournalError(
            f"{journal} was damaged or altered, and no report can be made of it",
            where=f"line {found.broken_line}: {found.reason}",
            hint="`lmctl log --json` prints its records as they are") from None


def _as_built_sections(
    run: str, runs_dir: Path, data: Path | None, layers: tuple[int, ...], copy: str | None
) -> tuple[ReportSection, ...]:
    from lmctl.cli.as_built import compared_with_design
    from lmctl.report.job_report.as_built_sections import as_built_sections

    comparison, _, heights_mm = compared_with_design(run, runs_dir, data, layers, copy)
    return as_built_sections(comparison, heights_mm)


def _rendered(found: PartReport, form: str, as_built: tuple[ReportSection, ...]) -> bytes:
    from lmctl.report.job_report import report_document, report_pictures

    if form == ".pdf":
        from lmctl.report.job_report import report_as_pdf  # says early what is not installed

        return report_as_pdf(report_document(found, report_pictures(found), as_built))
    from lmctl.report.job_report import report_as_html

    return report_as_html(report_document(found, report_pictures(found), as_built)).encode()


def _say_what_is_open(found: PartReport) -> None:
    """What a person who is to sign wants to know before."""
    record = found.record
    if record.state != "done":
        print_message(f"warning: the part is not complete: {record.state}")
    for run in record.runs:
        if not run.verification.sealed:
            print_message(f"warning: the journal of {run.run} "
                          + ("was altered: " if not run.verification.intact else "has no end: ")
                          + run.verification.reason)
    if found.job.problem:
        print_message(f"warning: {found.job.path} is not used: {found.job.problem}")
    open_ = sum(not one.disposition for one in record.deviations)
    if open_:
        print_message(f"{open_} deviations have no disposition yet; `lmctl note` adds one")


def _write_history(runs_dir: Path, output: Path | None) -> None:
    from lmctl.report.part_report_csv import history_as_csv
    from lmctl.run.journal.run_folders import run_names

    if not run_names(runs_dir):
        raise UsageError(f"{runs_dir} holds no run", hint="--runs names another folder")
    _put_text(history_as_csv(runs_dir), output)


def _put_text(text: str, output: Path | None) -> None:
    if output is None:
        print_data(text)
        return
    _write(output, (text + "\n").encode())
    print_data(str(output))


def _write(target: Path, data: bytes) -> None:
    try:
        target.write_bytes(data)
    except OSError as error:
        raise UsageError.cannot_write(target, error) from None
