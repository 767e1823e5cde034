"""What the planner predicts a job's beams to come back to, at every place it reads."""

from __future__ import annotations

import numpy as np

from lmctl.job.schema import JobLayer, JobManifest
from lmctl.part.part import Part
from lmctl.plan.heat import HeatPlanner
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.moves import Moves


def planner_readings(
    part: Part, layers: list[JobLayer], manifest: JobManifest, recipe: Recipe | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (r,) [s of the program], places (r, 2), temperatures (r,) [°C] of all layers.

    The layers' own lines are given to the planner's prediction as if it had just planned them.
    """
    low, high = (np.asarray(corner) for corner in part.bounds_mm)
    offset = np.array(manifest.part_offset_mm)
    assert part.build_heat is not None
    planner = HeatPlanner(part.build_heat, 1e6, recipe or _Recipe(part, manifest), low + offset,
                          high + offset)
    at_s, place_mm, found_C = [], [], []
    start_mm, start_s = np.zeros(3), 0.0
    for number, layer in enumerate(layers):
        moves, durations = _moves(layer, start_s)
        planner.begin_layer()
        planner.choose_waits(number, moves, start_mm, durations)
        planner.add_layer(number, moves, start_mm, durations, 1.0)
        read = planner.readings
        assert read is not None
        at_s.append(start_s + read.at_s)
        place_mm.append(read.place_mm)
        found_C.append(read.found_C)
        start_mm, start_s = moves.target_mm[-1], float(layer.lines["end_s"][-1])
    return np.concatenate(at_s), np.concatenate(place_mm), np.concatenate(found_C)


class _Recipe:
    """Of a recipe, what the prediction of temperature asks for."""

    def __init__(self, part: Part, manifest: JobManifest) -> None:
        self.bead_mm = part.process.bead_width_mm
        self.pitch_mm = self.bead_mm * (1 - part.process.overlap)
        self.layer_height_mm = manifest.totals["layer_height_mm"]


def _moves(layer: JobLayer, start_s: float) -> tuple[Moves, np.ndarray]:
    lines = layer.lines
    n = len(lines)
    return Moves(
        target_mm=np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]]),
        feed_mm_s=lines["speed_mm_s"].astype(float), power_W=lines["power_W"].astype(float),
        kind=lines["kind"], path=lines["path"], fractions=lines["fractions"].astype(float),
        dwell_s=np.zeros(n), bead_width_mm=lines["bead_width_mm"].astype(float),
        along_mm=np.zeros((n, 2)),
    ), np.diff(lines["end_s"], prepend=start_s)
