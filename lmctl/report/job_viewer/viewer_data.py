"""What a viewer page shows of a job, and of the runs that executed it, as plain data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib import colormaps

from lmctl.array_types import FloatArray
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, JobManifest, LineKind
from lmctl.report.composition_colours import (
    MAX_MIXED_MATERIALS,
    TWO_MATERIAL_COLOURMAP,
    material_colours,
)
from lmctl.report.job_viewer.columns import ColumnPacker
from lmctl.report.job_viewer.executed_samples import ExecutedSamples
from lmctl.report.job_viewer.predicted_mixture import MixturePredictor
from lmctl.report.part_report import PartReport
from lmctl.report.reported_values import PartScales


def viewer_head(manifest: JobManifest, digest: str, report: PartReport | None) -> dict[str, Any]:
    """Everything that is not a layer.

    report : of the runs that executed the job, None where only the job is shown
    """
    palette = (np.asarray(colormaps[TWO_MATERIAL_COLOURMAP](np.linspace(0, 1, 256)))[:, :3] * 255)
    count = len(manifest.materials)
    return {
        "part": manifest.part_name, "job": digest, "machine": manifest.machine,
        "materials": list(manifest.materials),
        "hoppers": [{"name": one.name, "material": one.material} for one in manifest.hoppers],
        "palette": palette.round().astype(int).tolist(),
        "anchors": (material_colours(count) * 255).round().astype(int).tolist(),
        "mixed": count <= MAX_MIXED_MATERIALS,
        "excerpt": manifest.excerpt[0] if manifest.excerpt else 1,
        "runs": [] if report is None else [
            {"run": run.run, "state": run.state} for run in report.record.runs],
        "interruptions": [] if report is None else [
            {"run": one.run, "cause": one.cause, "line": one.line, "share": one.share,
             "known": one.known, "entry_line": one.entry_line, "repeated_mm": one.repeated_mm,
             "resumed_in": one.resumed_in}
            for one in report.record.interruptions],
    }


def viewer_layers(
    reader: JobReader, scales: PartScales, report: PartReport | None = None,
    samples: Mapping[int, ExecutedSamples] | None = None,
) -> Iterator[dict[str, Any]]:
    """Every layer in order, a few in memory at a time.

    samples : {layer index: what devices reported in it}
    """
    predictor = MixturePredictor(reader.manifest, scales)
    records = {} if report is None else {one.number - 1: one for one in report.record.layers}
    at_mm = (float("nan"), float("nan"))
    for layer, predicted in predictor.predict(reader.iterate_layers()):
        record = records.get(layer.index)
        executed = 0 if record is None else (
            len(layer.lines) if record.complete
            else max(0, record.reached_line - layer.first_line))
        yield {
            "z_mm": round(layer.z_mm, 4), "first_line": layer.first_line,
            "start_mm": [None if np.isnan(one) else round(one, 3) for one in at_mm],
            "start_s": round(float(layer.flow_s[0]), 3),
            "end_s": round(float(layer.flow_s[-1]), 3), "executed": executed,
            "remark": "" if record is None else record.remark,
            **_lines(layer, reader.manifest, predicted),
            "reported": None if samples is None or layer.index not in samples
            else samples[layer.index].packed(layer, reader.manifest),
        }
        at_mm = (float(layer.lines["x_mm"][-1]), float(layer.lines["y_mm"][-1]))


def _lines(
    layer: JobLayer, manifest: JobManifest, predicted: FloatArray | None
) -> dict[str, Any]:
    """The columns of a layer's lines and of its flow knots.

    x, y : end of each line; s : its end since the layer's start; path : from 0 in the layer, plus
    1, 0 for none
    """
    lines, packer = layer.lines, ColumnPacker()
    packer.add_scaled("x", lines["x_mm"].astype(np.float64))
    packer.add_scaled("y", lines["y_mm"].astype(np.float64))
    packer.add_exact("s", lines["end_s"] - layer.flow_s[0])
    packer.add_small("kind", lines["kind"].astype(np.float64))
    path = lines["path"].astype(np.int64)
    first = path[path >= 0].min() if (path >= 0).any() else 0
    packer.add_small("path", np.where(path < 0, 0, (path - first) % 65_535 + 1).astype(np.float64))
    bead = lines["kind"] == LineKind.BEAD
    for name, column in (("width", "bead_width_mm"), ("power", "power_W"),
                         ("speed", "speed_mm_s")):
        packer.add_scaled(name, lines[column].astype(np.float64))
    for at in range(len(manifest.materials)):
        packer.add_scaled(f"planned{at}", lines["fractions"][:, at].astype(np.float64))
        packer.add_scaled(f"designed{at}", np.where(
            lines["designed"].any(axis=1), lines["designed"][:, at].astype(np.float64), np.nan))
        if predicted is not None:
            packer.add_scaled(f"predicted{at}", predicted[:, at])
    if predicted is not None:
        error = np.abs(predicted - lines["fractions"]).max(axis=1)
        packer.add_scaled("error", np.where(bead, error, 0.0))
    packer.add_exact("knot_s", layer.flow_s - layer.flow_s[0])
    for at in range(len(manifest.hoppers)):
        packer.add_scaled(f"flow{at}", 60.0 * layer.flow_g_s[:, at])
    return packer.packed()
