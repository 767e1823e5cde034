"""What devices reported while each layer was executed, placed on the lines of the job."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import JobLayer, JobManifest
from lmctl.report.job_viewer.columns import ColumnPacker
from lmctl.report.nozzle_inference import NozzleInference
from lmctl.report.reported_values import PartScales, nozzle_of

#: Lines around the one reported as executed that a sample may lie on.
_BEHIND, _AHEAD = 4, 60
#: A sample is worked on together with so many others.
_BATCH = 4096


class ExecutedSamples:
    """The samples of one layer with the beam on, over all runs.

    rows : (n, 6 + hoppers + materials) run, line, x [mm], y [mm], speed [mm/s], S word, reported
        flows [g/min], inferred fractions
    """

    def __init__(self, scales: PartScales, n_hoppers: int) -> None:
        self._scales = scales
        self._n_hoppers = n_hoppers
        self._rows: list[FloatArray] = []

    def add(self, rows: FloatArray) -> None:
        """More samples."""
        self._rows.append(rows)

    def packed(self, layer: JobLayer, manifest: JobManifest) -> dict[str, Any]:
        """Columns in the order of program time, since the layer's start."""
        rows = np.concatenate(self._rows)
        since_s = _program_times(layer, rows[:, 1], rows[:, 2:4]) - layer.flow_s[0]
        order = np.lexsort((since_s, rows[:, 0]))
        rows, since_s = rows[order], since_s[order]
        packer = ColumnPacker()
        packer.add_exact("s", since_s)
        packer.add_small("run", rows[:, 0])
        packer.add_scaled("x", rows[:, 2])
        packer.add_scaled("y", rows[:, 3])
        packer.add_scaled("speed", rows[:, 4])
        packer.add_scaled("power", rows[:, 5] * (self._scales.power_W_per_s or np.nan))
        for at in range(self._n_hoppers):
            packer.add_scaled(f"flow{at}", rows[:, 6 + at])
        for at in range(len(manifest.materials)):
            packer.add_scaled(f"inferred{at}", rows[:, 6 + self._n_hoppers + at])
        return packer.packed()


class SampleGatherer:
    """Gathers the samples of one run, layer by layer, from its records in order.

    into : {layer index: samples}, which all runs of a part share; run : its number from 0
    first_lines : of the job's layers
    """

    def __init__(
        self, into: dict[int, ExecutedSamples], run: int, first_lines: Sequence[int],
        scales: PartScales,
    ) -> None:
        self._into = into
        self._run = run
        self._first_lines = list(first_lines)
        self._scales = scales
        self._hoppers: tuple[str, ...] = ()
        self._nozzle: NozzleInference | None = None
        self._columns: dict[str, list[Any]] = {}

    def take(self, record: dict[str, Any]) -> None:
        """Any record; those of other kinds change nothing."""
        match record["kind"]:
            case "header":
                self._hoppers = tuple(str(one["name"]) for one in record.get("hoppers", []))
                self._nozzle = nozzle_of(record, self._scales)
            case "setpoint" if self._nozzle is not None:
                self._nozzle.order_flows(float(record["t"]), record["flow_g_min"])
            case "hose_response" if self._nozzle is not None:
                self._work_off()
                self._nozzle.take_hose_response(record)
            case "samples":
                for name in ("at", "line", "x_mm", "y_mm", "feed_mm_min", "s_word"):
                    self._columns.setdefault(name, []).extend(record[name])
                for name in self._hoppers:
                    self._columns.setdefault(f"flow {name}", []).extend(record["flow_g_min"][name])
                if len(self._columns["at"]) >= _BATCH:
                    self._work_off()
            case "seal":
                self._work_off()

    def finish(self) -> None:
        """The journal is over, with or without a seal."""
        self._work_off()

    def _work_off(self) -> None:
        if not self._columns.get("at"):
            return
        columns = {name: np.array(column, dtype=np.float64)
                   for name, column in self._columns.items()}
        self._columns.clear()
        flows = np.column_stack([columns[f"flow {name}"] for name in self._hoppers])
        shape = (len(columns["at"]), len(self._scales.materials))
        mixture = np.full(shape, np.nan) if self._nozzle is None else self._nozzle.advance(
            columns["at"], flows)
        rows = np.column_stack([
            np.full(len(flows), self._run), columns["line"], columns["x_mm"], columns["y_mm"],
            columns["feed_mm_min"] / 60.0, columns["s_word"], flows, mixture])
        rows = rows[columns["s_word"] > 0.0]
        layers = np.array([bisect_right(self._first_lines, line) - 1 for line in rows[:, 1]],
                          dtype=int)
        for layer in np.unique(layers):
            self._into.setdefault(int(layer), ExecutedSamples(
                self._scales, len(self._hoppers))).add(rows[layers == layer])


def _program_times(layer: JobLayer, line: FloatArray, places: FloatArray) -> FloatArray:
    """Program time of each place (n, 2), on the nearest line around the one executed last."""
    ends = np.column_stack([layer.lines["x_mm"], layer.lines["y_mm"]])
    end_s = layer.lines["end_s"]
    begins = np.vstack([ends[:1], ends[:-1]])
    begin_s = np.append(layer.flow_s[0], end_s[:-1])
    found = np.empty(len(places))
    for at, (executed, place) in enumerate(zip(line, places, strict=True)):
        first = int(np.clip(executed - layer.first_line - _BEHIND, 0, len(ends) - 1))
        last = min(first + _BEHIND + _AHEAD, len(ends))
        a, b = begins[first:last], ends[first:last]
        way = b - a
        length2 = np.maximum((way * way).sum(axis=1), 1e-12)
        share = np.clip(((place - a) * way).sum(axis=1) / length2, 0.0, 1.0)
        off2 = ((a + share[:, None] * way - place) ** 2).sum(axis=1)
        best = int(off2.argmin())
        found[at] = begin_s[first + best] + share[best] * (
            end_s[first + best] - begin_s[first + best])
    return found
