"""All that the report of a part prints: its record, what its job planned, what devices reported."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.config.machine import MachineProfile
from lmctl.config.mixture_catch import MixtureCatchSettings
from lmctl.config.part_rules import parse_part_file
from lmctl.config.traveller import TravellerSettings, with_stated_values
from lmctl.errors import ConfigError, JobError, MissingFileError
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobManifest, LayerMixture
from lmctl.part.materials.powders import MaterialSpec, resolve_materials
from lmctl.plan.mixture_catch import MixtureCatch, mixture_catch
from lmctl.report.part_record import PartRecord, RunObserver, part_record_of
from lmctl.report.powder_balance import PowderBalance, powder_balances
from lmctl.report.process_values import ProcessValues, planned_process_values
from lmctl.report.reported_values import PartScales, ReportedValueGatherer
from lmctl.run.journal.format import read_records
from lmctl.run.journal.run_folders import RunFolder


@dataclass(frozen=True)
class JobOfPart:
    """The job that a part was made from, as it lies beside a journal.

    path : of the file; manifest : None where it cannot be read, or is another job
    problem : in words why it cannot be used, "" where it can
    powders : of the part file in it; traveller : what that states
    """

    path: Path
    manifest: JobManifest | None
    problem: str = ""
    powders: tuple[MaterialSpec, ...] = ()
    traveller: TravellerSettings = field(default_factory=TravellerSettings)

    def scales(self, header: Mapping[str, Any]) -> PartScales:
        """What turns the numbers that a run reported into power and mixture.

        header : of the run; a catch efficiency that was measured stands in it, and counts
        """
        if self.manifest is None:
            return PartScales()
        measured = {str(one["material"]): one.get("catch_efficiency")
                    for one in header.get("hoppers", [])}
        catch = {one.name: float(measured.get(one.name) or one.catch_efficiency)
                 for one in self.powders}
        return PartScales(
            self.manifest.max_power_W / self.manifest.s_max, self.manifest.materials,
            {one.name: catch[one.name] / one.density_g_mm3 for one in self.powders},
            _mixture_catch(header, self.manifest.materials, catch))


def _mixture_catch(
    header: Mapping[str, Any], materials: Sequence[str], catch: Mapping[str, float]
) -> MixtureCatch | None:
    """How powders fed together were caught, as the run's header has it; None: as alone."""
    stated = header.get("mixture_catch")
    if not stated or not set(materials) <= catch.keys():
        return None
    return mixture_catch([MixtureCatchSettings.model_validate(one) for one in stated],
                         materials, np.array([catch[name] for name in materials]))


@dataclass(frozen=True)
class PartReport:
    """What a report prints of one part.

    planned, reported : {layer index: process values while the beam is on}; mixtures in `reported`
        are inferred from flows
    mixtures : {layer index: mixture as designed, planned and predicted}
    """

    record: PartRecord
    job: JobOfPart
    traveller: TravellerSettings
    planned: dict[int, ProcessValues]
    reported: dict[int, ProcessValues]
    mixtures: dict[int, LayerMixture]

    @property
    def header(self) -> dict[str, Any]:
        """The first record of the first run."""
        return self.record.runs[0].header

    @property
    def materials(self) -> tuple[str, ...]:
        """Names, in the part's order."""
        return tuple(str(name) for name in self.header.get("materials", ()))

    @property
    def powder_balances(self) -> tuple[PowderBalance, ...]:
        """One a hopper."""
        totals = {} if self.job.manifest is None else self.job.manifest.totals
        in_part, fed = totals.get("powder_in_part_g", {}), totals.get("powder_g", {})
        return powder_balances(self.record, {
            name: grams / fed[name] for name, grams in in_part.items() if fed.get(name)})


def part_report_of(
    journal: Path, *, run_only: bool = False, stated: Sequence[str] = (),
    also: RunObserver | None = None,
) -> PartReport:
    """The report of the part that a run worked on, each journal and the job read once.

    run_only : of this run alone; stated : KEY=VALUE of the traveller
    also : makes what else is handed every record of a run's journal
    Raises what `part_record_of` raises, and UsageError for values that cannot be meant.
    """
    header = next(read_records(journal), {})
    job = job_of_part(RunFolder(journal.parent).job, str(header.get("job", "")))
    gathered: list[ReportedValueGatherer] = []

    def observer(run: RunFolder) -> Callable[[dict[str, Any]], None]:
        values = ReportedValueGatherer(job.scales(header))
        gathered.append(values)
        other = None if also is None else also(run)

        def take(record: dict[str, Any]) -> None:
            values.take(record)
            if other is not None:
                other(record)

        return take

    record = part_record_of(journal, run_only=run_only, observer=observer)
    reported: dict[int, ProcessValues] = {}
    for one in gathered:
        for layer, values in one.values().items():
            reported[layer] = reported.get(layer, ProcessValues()).joined_with(values)
    materials = tuple(str(name) for name in record.runs[0].header.get("materials", ()))
    return PartReport(
        record, job, with_stated_values(job.traveller, stated, materials),
        _planned(job, record), reported,
        {} if job.manifest is None else {one.layer: one for one in job.manifest.mixtures})


def scales_on_cell(job: Path, profile: MachineProfile) -> PartScales:
    """What turns the numbers of a run of this job on this cell into power and mixture.

    The catch that the cell measured counts, as in `JobOfPart.scales`.
    """
    return job_of_part(job, None).scales({
        "hoppers": [] if profile.calibration_use is None else [
            {"material": one.material, "catch_efficiency": one.catch_efficiency}
            for one in profile.hopper],
        "mixture_catch": [one.model_dump(mode="json") for one in profile.mixture_catch]})


def job_of_part(path: Path, digest: str | None) -> JobOfPart:
    """A job with its powders; with a digest, if it is the one of that; else what is wrong with it.
    """
    try:
        with JobReader(path) as reader:
            if digest not in (None, reader.digest):
                return JobOfPart(path, None,
                                 f"it is another job: its SHA-256 is {reader.digest}")
            part = parse_part_file(reader.part_text, name="part.toml")
            return JobOfPart(path, reader.manifest, "", resolve_materials(part),
                             part.traveller)
    except ConfigError:  # a part file of another version of this software
        return JobOfPart(path, reader.manifest,
                         "the part file in it cannot be read by this version")
    except (JobError, MissingFileError) as error:
        return JobOfPart(path, None, error.what)


def _planned(job: JobOfPart, record: PartRecord) -> dict[int, ProcessValues]:
    if job.manifest is None:
        return {}
    with JobReader(job.path) as reader:
        return {
            layer.number - 1: planned_process_values(
                reader.read_layer(layer.number - 1), job.manifest)
            for layer in record.layers
        }
