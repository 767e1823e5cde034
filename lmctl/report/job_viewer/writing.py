"""Write the viewer page of a job, or of the part that a run worked on."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from lmctl.errors import JobError, UsageError
from lmctl.job.reader import JobReader
from lmctl.report.job_viewer.executed_samples import ExecutedSamples, SampleGatherer
from lmctl.report.job_viewer.viewer_data import viewer_head, viewer_layers
from lmctl.report.job_viewer.viewer_page import viewer_page
from lmctl.report.part_report import PartReport, job_of_part, part_report_of
from lmctl.run.journal.format import read_records
from lmctl.run.journal.run_folders import RunFolder


def write_job_viewer(job: Path, target: Path, first_layer: int | None = None) -> None:
    """The page of a job. first_layer : index of the layer shown first, None for the middle one

    Raises JobError, and UsageError where the page cannot be written.
    """
    with JobReader(job) as reader:
        found = job_of_part(job, reader.digest)
        _write(target, viewer_page(
            viewer_head(reader.manifest, reader.digest, None),
            viewer_layers(reader, found.scales({})),
            len(reader.manifest.layers) // 2 if first_layer is None else first_layer))


def write_run_viewer(journal: Path, target: Path, first_layer: int | None = None) -> None:
    """The page of the part that a run worked on: planned, executed and reported, over all its runs.

    Raises JournalError; JobError where the job is not beside the journal or is another one.
    """
    header = next(read_records(journal), {})
    folder = RunFolder(journal.parent)
    job = job_of_part(folder.job, str(header.get("job", "")))
    if job.manifest is None:
        raise JobError(f"{folder.job} is not the job of this run", where=job.problem,
                       hint="put the job that was run beside the journal, as job.lmj")
    scales = job.scales(header)
    first_lines = [entry.first_line for entry in job.manifest.layers]
    samples: dict[int, ExecutedSamples] = {}
    gatherers: list[SampleGatherer] = []

    def observer(_: RunFolder) -> Callable[[dict[str, Any]], None]:
        gatherers.append(SampleGatherer(samples, len(gatherers), first_lines, scales))
        return gatherers[-1].take

    report = part_report_of(journal, also=observer)
    for gatherer in gatherers:
        gatherer.finish()
    if first_layer is None:
        first_layer = _layer_to_look_at(report)
    with JobReader(folder.job) as reader:
        _write(target, viewer_page(
            viewer_head(reader.manifest, reader.digest, report),
            viewer_layers(reader, scales, report, samples), first_layer))


def _layer_to_look_at(report: PartReport) -> int:
    """Index of the first layer in which deposition was interrupted, else of the middle one."""
    layers = report.record.layers
    for one in report.record.interruptions:
        for layer in layers:
            if one.line is not None and layer.lines[0] <= one.line <= layer.lines[1]:
                return layer.number - 1
    return layers[len(layers) // 2].number - 1 if layers else 0


def _write(target: Path, pieces: Iterable[str]) -> None:
    """The page appears complete or not at all."""
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.writelines(pieces)
        temporary.replace(target)
    except OSError as error:
        raise UsageError.cannot_write(target, error) from None
    finally:
        temporary.unlink(missing_ok=True)
