"""A run compared with its part: by its voxel map, or by what its journal lets predict."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from lmctl.as_built.comparison import AsBuiltComparison, compare_with_design
from lmctl.as_built.figures import AsBuiltSummary, MaterialBalance
from lmctl.as_built.prediction import predicted_volume
from lmctl.as_built.voxel_map_file import read_voxel_map
from lmctl.errors import InputError, MissingFileError
from lmctl.job.reader import JobReader
from lmctl.part.copies import PartCopy
from lmctl.part.load import part_from_text
from lmctl.part.part import Part
from lmctl.report.part_record import runs_of_part
from lmctl.report.run_record import RunRecord, read_run
from lmctl.run.journal.format import read_records
from lmctl.run.journal.run_folders import RunFolder


def as_built_summary(journal: Path, data_folder: Path | None = None) -> AsBuiltSummary:
    """The figures of a run's as-built comparison; see `as_built_of_run`."""
    return as_built_of_run(journal, data_folder).summary


def as_built_of_run(
    journal: Path, data_folder: Path | None = None, copy: str | None = None
) -> AsBuiltComparison:
    """Compare what a run built with its part.

    A simulated run that left a voxel map is compared by it. Of any other its part is predicted
    by the model that its job believes, and marked so, from the journals of all runs of its part.
    data_folder : of the part's data files; None: the folder of the runs' folder, or the present one
    copy : name of the one to compare, of a job with copies
    Raises MissingFileError, InputError, JobError, JournalError.
    """
    folder = RunFolder(journal.parent)
    with JobReader(folder.job) as job:
        part = _part_of(job, data_folder, folder)
        if folder.voxel_map.exists():
            found = compare_with_design(
                read_voxel_map(folder.voxel_map), part, job, _copy_of(part, copy))
            return _weighed(found, read_run(journal))
        journals = [folder.journal for folder in runs_of_part(folder)]
        if len(journals) == 1:
            journals = [journal]
        return compare_with_design(
            predicted_volume(job, part, map(read_records, journals)), part, job,
            _copy_of(part, copy))


def _copy_of(part: Part, name: str | None) -> PartCopy | None:
    """The copy of this name. Raises InputError where there is none, or none is named."""
    found = next((copy for copy in part.copies if copy.name == name), None)
    if (found is None) != (name is None and not part.copies):
        names = ", ".join(copy.name for copy in part.copies)
        raise InputError(
            "the job has several copies" if name is None else f"the job has no copy {name!r}",
            where=f"they are {names}" if names else "it is of one part",
            hint="name one with --copy" if names else "leave --copy out")
    return found


def _part_of(job: JobReader, data_folder: Path | None, folder: RunFolder) -> Part:
    """The part as it was planned. Raises where its data files are missing or changed since."""
    sources = job.manifest.sources
    places = [data_folder] if data_folder is not None else [
        folder.path.resolve().parent.parent, Path()]
    for place in places:
        if all((place / name).is_file() for name in sources):
            for name, digest in sources.items():
                if hashlib.sha256((place / name).read_bytes()).hexdigest() != digest:
                    raise InputError(f"{place / name} has changed since the part was planned",
                                     hint="compare with the file that it was planned from")
            return part_from_text(job.part_text, place, job.manifest.part_name)
    missing = next(name for name in sources if not (places[0] / name).is_file())
    raise MissingFileError(
        f"the part's data file {missing} is not here",
        where=", ".join(str(place.resolve()) for place in places),
        hint="name its folder with --data")


def _weighed(found: AsBuiltComparison, run: RunRecord) -> AsBuiltComparison:
    """With the powder fed as the run itself weighed it, where it weighed all of it."""
    weighed = _weighed_g(run)
    balance = tuple(
        _closed(one, weighed[one.material]) if one.material in weighed else one
        for one in found.summary.balance)
    return replace(found, summary=replace(found.summary, balance=balance))


def _closed(one: MaterialBalance, fed_g: float) -> MaterialBalance:
    rest = fed_g - one.deposited_g - one.overspray_g - one.beam_off_g
    return replace(one, fed_g=fed_g, unaccounted_g=rest, closure=rest / fed_g if fed_g else 0.0)


def _weighed_g(run: RunRecord) -> dict[str, float]:
    """Powder by material: weight lost in the layers, and fed in purges, where both are known."""
    return dict(_of_hoppers(run))


def _of_hoppers(run: RunRecord) -> Iterator[tuple[str, float]]:
    hoppers: list[dict[str, Any]] = run.header.get("hoppers", [])
    accounts = [account for account in run.accounts if account.reported.duration_s > 0]
    for hopper in hoppers:
        name, material = str(hopper["name"]), str(hopper["material"])
        shared = sum(str(other["material"]) == material for other in hoppers) > 1
        if accounts and not shared and all(name in one.weighed_g for one in accounts):
            layers = sum(one.weighed_g[name] for one in accounts)
            yield material, layers + run.purged_g.get(name, 0.0)
