"""Starts row: beam-on beads of the six shapes over the extrusions of PrusaSlicer's Arachne."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lmctl.job.reader import JobReader
from tests.benchmarks.plan_rows import peers
from tests.benchmarks.plan_rows.measured import LMCTL, run

BEAD_MM, OVERLAP, LAYER_MM = 2.0, 0.333, 0.8


def starts_rows(folder: Path, stl_files: dict[str, Path]) -> dict[str, Any]:
    """Summed over all layers of the shapes, both with beads of 2 mm and layers of 0.8 mm."""
    ours = theirs = 0
    for name, stl in stl_files.items():
        job, gcode = folder / f"{name}.lmj", folder / f"{name}.gcode"
        run((*LMCTL, "plan", stl, "--units", "mm", "-o", job, "--allow-incomplete"), folder)
        with JobReader(job) as reader:
            ours += sum(layer.n_paths for layer in reader.manifest.layers)
        run(peers.prusa(stl, gcode, BEAD_MM * (1 - OVERLAP), LAYER_MM, "arachne"), folder)
        theirs += peers.starts(gcode)
    return {"starts_vs_arachne": round(ours / theirs, 3)}
