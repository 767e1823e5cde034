"""Figures of a part by layer, and the history of a folder of runs, as comma-separated values."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from lmctl.errors import LmctlError
from lmctl.report.job_log_csv import layer_heads, layer_row
from lmctl.report.log_layout import format_number
from lmctl.report.part_record import PartRecord, part_record_of
from lmctl.report.part_report import PartReport
from lmctl.report.process_values import ProcessValues
from lmctl.report.value_range import ValueRange
from lmctl.run.journal.run_folders import RunFolder, run_names, run_summary

_PARTS = ("least", "mean", "most")
_HISTORY = (
    "run", "continues", "part", "state", "begun", "ended", "machine_s", "operator", "machine",
    "job_sha256", "layers", "layers_complete", "path_mm", "beam_s", "energy_J", "powder_g",
    "interruptions", "alarms", "deviations", "open_deviations", "journal",
)


def part_report_as_csv(report: PartReport) -> str:
    """One row a layer: the columns of the log, then process values; no trailing newline."""
    hoppers, materials = report.record.hoppers, report.materials
    quantities = [
        "speed_mm_s", "power_W",
        *(f"flow_{name}_g_min" for name in hoppers),
        *(f"{name}_fraction" for name in materials),
    ]
    heads = [
        *layer_heads(report.record),
        *(f"{kind}_{name}_{part}" for name in quantities for kind in ("planned", "reported")
          for part in _PARTS),
        *(f"reported_carrier_{name}_L_min_{part}" for name in hoppers for part in _PARTS),
        *(f"reported_shield_gas_L_min_{part}" for part in _PARTS),
        *(f"designed_{name}_fraction" for name in materials),
        *(f"predicted_{name}_fraction" for name in materials),
    ]
    # What the feeders report tells the mixture only by inference; its columns say so.
    heads = [head.replace("reported_", "inferred_", 1) if head.startswith("reported_") and any(
        f"_{name}_fraction_" in head for name in materials) else head for head in heads]
    rows: list[Sequence[object]] = []
    for layer in report.record.layers:
        index = layer.number - 1
        planned = report.planned.get(index, ProcessValues())
        reported = report.reported.get(index, ProcessValues())
        mixture = report.mixtures.get(index)
        row: list[object] = layer_row(layer, hoppers)
        for of in (_speed_and_power, _flows, _fractions):
            for one, other in zip(of(planned, report), of(reported, report), strict=True):
                row += [*_cells(one), *_cells(other)]
        for name in hoppers:
            row += _cells(reported.carrier_L_min.get(name))
        row += _cells(reported.shield_gas_L_min)
        for kind in ("designed", "predicted"):
            row += [""] * len(materials) if mixture is None else list(getattr(mixture, kind))
        rows.append(row)
    return _text([heads, *rows])


def history_as_csv(runs_dir: Path) -> str:
    """One row a run of a folder, oldest first; runs that cannot be read are listed as such."""
    return _text([list(_HISTORY), *(_history_row(RunFolder(runs_dir / name))
                                    for name in run_names(runs_dir))])


def _history_row(folder: RunFolder) -> list[object]:
    try:
        record = part_record_of(folder.journal, run_only=True)
    except (LmctlError, KeyError, TypeError, ValueError, AttributeError):
        summary = run_summary(folder)
        return [folder.run, "", summary.part, summary.state, summary.started,
                *[""] * (len(_HISTORY) - 6), "cannot be read"]
    return list(_history_cells(record))


def _history_cells(record: PartRecord) -> Iterator[object]:
    (run,) = record.runs
    executed = record.executed
    verification = run.verification
    yield from (run.run, run.continues, run.header.get("part", ""), record.state)
    yield run.header.get("local", {}).get("wall", "")
    yield run.seal.get("local", {}).get("wall", "")
    yield format_number(run.last_t_s, 3)
    yield from (run.header.get(key, "") for key in ("operator", "machine", "job", "layers"))
    yield sum(layer.complete for layer in record.layers)
    yield from (format_number(executed.path_mm, 3), format_number(executed.beam_s, 3),
                format_number(executed.energy_J, 1))
    yield format_number(sum(executed.powder_g.values()), 3)
    yield from (len(record.interruptions), len(record.alarms), len(record.deviations))
    yield sum(not one.disposition for one in record.deviations)
    yield "broken" if not verification.intact else "sealed" if verification.sealed else "no end"


def _speed_and_power(values: ProcessValues, _: PartReport) -> list[ValueRange | None]:
    return [values.speed_mm_s, values.power_W]


def _flows(values: ProcessValues, report: PartReport) -> list[ValueRange | None]:
    return [values.flow_g_min.get(name) for name in report.record.hoppers]


def _fractions(values: ProcessValues, report: PartReport) -> list[ValueRange | None]:
    return [values.fractions.get(name) for name in report.materials]


def _cells(values: ValueRange | None) -> list[str]:
    if values is None:
        return [""] * len(_PARTS)
    return [format_number(value, 4) for value in (values.least, values.mean, values.greatest)]


def _text(rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().rstrip("\n")
