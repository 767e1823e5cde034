"""The layers of a job as comma-separated values, as planned."""

from __future__ import annotations

import csv
import io

import numpy as np

from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer, JobManifest, LayerMixture, LineKind


def planned_layers_as_csv(job: JobReader) -> str:
    """One row a layer, units in the names of the columns, no trailing newline.

    Powder is what the nozzle is to deliver in the time of the layer, the beam on or off.
    """
    manifest = job.manifest
    mixtures = {one.layer: one for one in manifest.mixtures}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([
        "layer", "z_mm", "lines", "paths", "duration_s", "path_mm", "beam_s", "energy_J",
        "speed_mm_s_mean", "power_W_mean",
        *(f"powder_{one.name}_g" for one in manifest.hoppers),
        *(f"{kind}_{name}_fraction" for kind in ("designed", "planned", "predicted")
          for name in manifest.materials)])
    start_mm = None
    for layer in job.iterate_layers():
        writer.writerow(_row(layer, manifest, mixtures.get(layer.index), start_mm))
        start_mm = _places(layer)[-1]
    return text.getvalue().rstrip("\n")


def _row(
    layer: JobLayer, manifest: JobManifest, mixture: LayerMixture | None,
    start_mm: np.ndarray | None,
) -> list[object]:
    lines, places = layer.lines, _places(layer)
    way = np.linalg.norm(np.diff(
        places, axis=0, prepend=places[:1] if start_mm is None else start_mm[None]), axis=1)
    lasting_s = np.diff(lines["end_s"], prepend=layer.flow_s[0])
    bead = lines["kind"] == LineKind.BEAD
    path_mm, beam_s = float(way[bead].sum()), float(lasting_s[bead].sum())
    # Energy goes with length: a controller scales power with speed while it accelerates.
    energy_J = float((lines["power_W"][bead] / lines["speed_mm_s"][bead] * way[bead]).sum())
    grams = np.asarray(np.trapezoid(layer.flow_g_s, layer.flow_s, axis=0)).tolist()
    entry = manifest.layers[layer.index]
    return [
        layer.index + 1, round(layer.z_mm, 4), entry.n_lines, entry.n_paths,
        round(entry.end_s - entry.start_s, 3), round(path_mm, 3), round(beam_s, 3),
        round(energy_J, 1),
        round(path_mm / beam_s, 3) if beam_s else "",
        round(energy_J / beam_s, 1) if beam_s else "",
        *(round(one, 4) for one in grams),
        *([""] * (3 * len(manifest.materials)) if mixture is None else
          [*mixture.designed, *mixture.planned, *mixture.predicted]),
    ]


def _places(layer: JobLayer) -> np.ndarray:
    return np.column_stack([layer.lines[axis] for axis in ("x_mm", "y_mm", "z_mm")])
