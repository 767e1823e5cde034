"""The record of a part over all the runs that made it: the one model that logs and reports print.

A part may take several runs: each continues the one before. Its record has every layer once,
with what each run put into it added up, every event of every run in order, and the notes that
people have made.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lmctl.errors import LmctlError
from lmctl.report.alarm_history import AlarmEntry
from lmctl.report.deviations import Deviation, deviations_of
from lmctl.report.interruptions import Interruption, joined_interruptions
from lmctl.report.layer_record import LayerRecord, layer_records, sum_of_figures
from lmctl.report.run_record import RunRecord, read_run
from lmctl.run.journal import run_folders
from lmctl.run.journal.figures import ExecutionFigures
from lmctl.run.journal.format import read_records
from lmctl.run.journal.notes import Note, read_notes
from lmctl.run.journal.run_folders import RunFolder


@dataclass(frozen=True)
class PartRecord:
    """A part. runs : in order; the last one's state is the part's

    layers : of which anything was, or may have been, executed; notes : in the order they were made
    """

    runs: tuple[RunRecord, ...]
    layers: tuple[LayerRecord, ...]
    notes: tuple[Note, ...]

    @property
    def state(self) -> str:
        """How the last run ended."""
        return self.runs[-1].state

    @property
    def hoppers(self) -> tuple[str, ...]:
        """Names, in the job's order."""
        return tuple(str(hopper["name"]) for hopper in self.runs[0].header.get("hoppers", []))

    @property
    def planned(self) -> ExecutionFigures:
        """Of all layers in the record."""
        return sum_of_figures(layer.planned for layer in self.layers)

    @property
    def executed(self) -> ExecutionFigures:
        """Of all layers."""
        return sum_of_figures(layer.executed for layer in self.layers)

    @property
    def weighed_g(self) -> dict[str, float]:
        """{hopper: weight lost in motion}, of hoppers that weighed in every layer."""
        weighed = [layer.weighed_g for layer in self.layers]
        names = [name for name in self.hoppers if all(name in one for one in weighed)]
        return {name: sum(one[name] for one in weighed) for name in names}

    @property
    def purged_g(self) -> dict[str, float]:
        """{hopper: powder fed into no layer}, by what the feeders reported."""
        return dict(
            sum_of_figures(ExecutionFigures(powder_g=run.purged_g) for run in self.runs).powder_g)


    @property
    def alarms(self) -> tuple[AlarmEntry, ...]:
        """Of all runs, in order."""
        return tuple(alarm for run in self.runs for alarm in run.alarms)

    @property
    def interruptions(self) -> tuple[Interruption, ...]:
        """Of all runs, in order; what ended one run ends where the next one goes on."""
        return joined_interruptions(
            (run.run, run.interruptions, run.first_entry) for run in self.runs)

    @property
    def refilled_g(self) -> dict[str, float]:
        """{hopper: powder filled in during the runs, as operators stated it}."""
        return dict(
            sum_of_figures(ExecutionFigures(powder_g=run.refilled_g) for run in self.runs).powder_g)

    @property
    def deviations(self) -> tuple[Deviation, ...]:
        """Events and layers that are not as planned, each with what was noted about it."""
        return deviations_of(self.runs, self.layers, self.interruptions, self.notes)

    @property
    def general_notes(self) -> tuple[Note, ...]:
        """Notes on a run as a whole, or on a record that is no deviation."""
        about = {(one.run, one.seq) for one in self.deviations}
        return tuple(
            note for note in self.notes if note.about is None or (note.run, note.about) not in about
        )


#: What is handed every record of a journal; made anew for each run, from its folder.
RunObserver = Callable[[RunFolder], Callable[[dict[str, Any]], None]]


def part_record_of(
    journal: Path, *, run_only: bool = False, observer: RunObserver | None = None
) -> PartRecord:
    """The record of the part that a run worked on, from the journals beside it.

    run_only : of this run alone
    observer : makes what is handed every record of a run's journal, while it is read
    Raises JournalError; KeyError, TypeError, ValueError or AttributeError for altered journals.
    """
    folders = [RunFolder(journal.parent)]
    if not run_only:
        folders = runs_of_part(RunFolder(journal.parent))
    runs = [
        read_run(journal if len(folders) == 1 else folder.journal,
                 None if observer is None else observer(folder))
        for folder in folders
    ]
    notes = [note for run in runs for note in read_notes(RunFolder(run.journal.parent))]
    notes.sort(key=lambda note: note.wall)
    return PartRecord(tuple(runs), tuple(layer_records(runs)), tuple(notes))


def runs_of_part(this: RunFolder) -> list[RunFolder]:
    """Every run of the same part: those before this one and those after it, in order."""
    runs_dir = this.path.parent
    before_of: dict[str, str] = {}
    for name in run_folders.run_names(runs_dir):
        try:
            header = next(read_records(RunFolder(runs_dir / name).journal), {})
        except LmctlError:  # no journal, or another program's: it is none of this part's
            continue
        before_of[name] = str(header.get("continues", ""))
    # A run is newer than the one it continues; an altered header may claim otherwise.
    order = {name: at for at, name in enumerate(before_of)}
    first = this.run
    while order.get(before_of.get(first, ""), len(order)) < order.get(first, 0):
        first = before_of[first]
    found = [first]
    for name, before in before_of.items():
        if before in found and name not in found:
            found.append(name)
    return [RunFolder(runs_dir / name) for name in found] if this.run in found else [this]


