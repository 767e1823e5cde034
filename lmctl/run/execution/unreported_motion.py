"""What a run executed after its last report: inferred once the machine's place is found again.

After a killed host or a lost link the controller still runs the lines it holds. No report shows
that. The run that continues the part knows where it starts (the machine position at recovery), and
journals the difference as inferred.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.errors import JournalError, MissingFileError
from lmctl.job.reader import JobReader
from lmctl.run.execution.layer_accounts import MIN_BEAD_MM
from lmctl.run.journal.figures import ExecutionFigures
from lmctl.run.journal.format import read_records
from lmctl.run.journal.notes import notes_path
from lmctl.run.journal.recorder import place_fields
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.layer_program import LayerProgram, layer_program_of
from lmctl.run.program.place import JOB_START, PlaceReached, ProgramPlace
from lmctl.run.program.reentry import layer_of


@dataclass(frozen=True)
class UnreportedMotion:
    """Motion in one layer that no report showed, by the plan of its lines.

    complete : no bead of the layer is left after it
    """

    layer: int
    begin: ProgramPlace
    end: ProgramPlace
    figures: ExecutionFigures
    complete: bool

    def as_json(self) -> dict[str, Any]:
        """As a journal record carries it."""
        return {"layer": self.layer, "begin": place_fields(self.begin),
                "end": place_fields(self.end), "figures": self.figures.as_json(),
                "complete": self.complete}


@dataclass(frozen=True)
class _LastReport:
    """place : known last; rate : feed override; reported_s : machine time of that report

    setpoints : (machine time, {hopper: flow [g/min]}), the one in force then and those after it;
        discs keep the last one until the feeder's watchdog stops them
    """

    place: ProgramPlace = JOB_START
    beam_off: bool = False
    rate: float = 1.0
    reported_s: float = 0.0
    setpoints: tuple[tuple[float, Mapping[str, float]], ...] = ()


def find_unreported_motion(job: JobReader, earlier: Path,
                           reached: PlaceReached) -> list[UnreportedMotion]:
    """What an earlier run of the same job executed between its last report and where it ended.

    earlier : its journal. Where that cannot be read, nothing is inferred.
    """
    try:
        last = _last_report(earlier)
    except (JournalError, MissingFileError):
        return []
    found = reached.place
    if found <= last.place:
        return []
    layers = range(layer_of(job.manifest, last.place.line), layer_of(job.manifest, found.line) + 1)
    last_s = _time_of(_layer(job, layers[0]), last.place)
    spans = (_in_layer(job, index, last, last_s, reached) for index in layers)
    return [span for span in spans if span.figures.duration_s > 0.0]


def journal_unreported_motion(job: JobReader, made: RunFolder, reached: PlaceReached) -> None:
    """Write down what a run executed without a report where no later run will: nothing is left.

    It goes beside the journal, which may be sealed. Raises JournalError.
    """
    beside = notes_path(made)
    for span in find_unreported_motion(job, made.journal, reached):
        beside.append("unreported", **span.as_json())


def _last_report(journal: Path) -> _LastReport:
    """How far a run was known to be, by its own reports or by the run before it."""
    last = _LastReport()
    for record in read_records(journal):
        known = []
        match record["kind"]:
            case "header" if "begins_at" in record:
                known = [record["begins_at"]]
            case "place":
                line, share = record.get("at_least", (record["line"], record["share"]))
                known = [{"line": line, "share": share}]
            case "entry":
                known = [record]
            case "layer":
                known = [record["reached"]]
            case "samples":
                known = [account["reached"] for account in record["layers"]]
            case "machine":
                last = replace(last, beam_off=record["beam_off"])
            case "override" if record["source"] == "controller":
                last = replace(last, rate=record["feed_percent"] / 100.0)
            case "setpoint":
                last = replace(
                    last, setpoints=(*last.setpoints, (float(record["t"]), record["flow_g_min"])))
        places = [ProgramPlace(one["line"], one["share"]) for one in known]
        if places:
            t_s = float(record["at"][-1] if "at" in record else record["t"])
            in_force = [one for one in last.setpoints if one[0] <= t_s][-1:]
            later = [one for one in last.setpoints if one[0] > t_s]
            last = replace(last, place=max([last.place, *places]), reported_s=t_s,
                           setpoints=(*in_force, *later))
    return last


def _fed_g(last: _LastReport, from_s: float, to_s: float) -> dict[str, float]:
    """Powder by the set-points in force between two times after the last report [s]."""
    begins_s = [max(t_s - last.reported_s, 0.0) for t_s, _ in last.setpoints]
    grams: dict[str, float] = {}
    for begin_s, end_s, (_, flows) in zip(
        begins_s, [*begins_s[1:], max(to_s, 0.0)], last.setpoints, strict=True
    ):
        lasting_s = max(0.0, min(end_s, to_s) - max(begin_s, from_s))
        for name, flow in flows.items():
            grams[name] = grams.get(name, 0.0) + flow / 60.0 * lasting_s
    return grams


def _in_layer(
    job: JobReader, index: int, last: _LastReport, last_s: float, reached: PlaceReached
) -> UnreportedMotion:
    layer, found = _layer(job, index), reached.place
    begin = max(last.place, ProgramPlace(layer.first_line))
    end = min(found, ProgramPlace(layer.last_line + 1))
    begin_s, end_s = _time_of(layer, begin), _time_of(layer, end)
    before, after = layer.totals.up_to_program_time(begin_s), layer.totals.up_to_program_time(end_s)
    beam = 0.0 if last.beam_off else 1.0
    rest_s = end_s + (reached.beam_off_motion_s * last.rate if end == found else 0.0)
    fed_from_s = max(begin_s, layer.planned.beam_from_s)
    grams = _fed_g(last, (fed_from_s - last_s) / last.rate, (rest_s - last_s) / last.rate)
    return UnreportedMotion(index, begin, end, ExecutionFigures(
        beam * (after.path_mm - before.path_mm),
        beam * (after.beam_s - before.beam_s) / last.rate,
        beam * (after.energy_J - before.energy_J), (rest_s - begin_s) / last.rate, grams,
    ), complete=layer.totals.all_lines.path_mm - layer.totals.up_to_program_time(
        end_s).path_mm < MIN_BEAD_MM)


def _layer(job: JobReader, index: int) -> LayerProgram:
    behind = job.read_layer(index - 1).lines[-1] if index else job.read_layer(index).lines[0]
    behind_mm = np.array([behind["x_mm"], behind["y_mm"], behind["z_mm"]], dtype=np.float64)
    return layer_program_of(job.read_layer(index), behind_mm, 0.0, beam_off=False)


def _time_of(layer: LayerProgram, place: ProgramPlace) -> float:
    """Program time of a place in a layer."""
    row = place.line - layer.first_line
    if row >= len(layer.ends_s):
        return layer.ends_s[-1]
    return layer.starts_s[row] + place.line_fraction * (layer.ends_s[row] - layer.starts_s[row])
