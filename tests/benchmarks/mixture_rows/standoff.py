"""Cladding on a plate that is bent by 3 mm over 60 mm, known to the plan by a scan of it.

The plate is truly a part of a round bar: of its sagitta and chord follows the radius. The scan is
of points at random places with noise. The nozzle's distance from the surface is that of the tool
point, along the nozzle, from the true plate plus the layers under it, each of the layer height; the
tool point itself lies one layer height over what it deposits on.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lmctl.job.reader import JobReader
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from simulators.process import SubstrateHeights, build_from_record
from tests.benchmarks.mixture_rows.as_built import PROCESS, profile, recorded_run

CHORD_MM, SAGITTA_MM, WIDTH_MM = 60.0, 3.0, 20.0
RADIUS_MM = ((CHORD_MM / 2) ** 2 + SAGITTA_MM**2) / (2 * SAGITTA_MM)
LAYER_MM, LAYERS = 0.8, 3
SAMPLES, NOISE_MM = 12_000, 0.02

PART = f"""
name = "clad on a bent plate"
[[material]]
name = "316L"
[[body]]
name = "round"
kind = "cylinder"
base_mm = [0, -20, {SAGITTA_MM - RADIUS_MM}]
top_mm = [0, 20, {SAGITTA_MM - RADIUS_MM}]
radius_mm = {RADIUS_MM + LAYERS * LAYER_MM}
[[body]]
name = "window"
kind = "box"
low_mm = [{-CHORD_MM / 2}, {-WIDTH_MM / 2}, -10]
high_mm = [{CHORD_MM / 2}, {WIDTH_MM / 2}, 20]
[[body]]
kind = "intersection"
of = ["round", "window"]
[substrate]
kind = "scan"
file = "plate.csv"
units = "mm"
[process]
bead_width_mm = 2.0
layer_height_mm = {LAYER_MM}
overlap = 0.333
speed_mm_s = 10
"""


def true_height_mm(x_mm: np.ndarray) -> np.ndarray:
    """Of the plate, in the part's coordinates."""
    return np.sqrt(RADIUS_MM**2 - x_mm**2) - RADIUS_MM + SAGITTA_MM


def write_bent_plate(folder: Path) -> Path:
    """The part file and its scan."""
    random = np.random.default_rng(17)
    places = random.uniform([-40, -20], [40, 20], (SAMPLES, 2))
    z = true_height_mm(places[:, 0]) + random.normal(0, NOISE_MM, SAMPLES)
    np.savetxt(folder / "plate.csv", np.column_stack([places, z]), fmt="%.4f", delimiter=",")
    file = folder / "bent.toml"
    file.write_text(PART)
    return file


def standoff_row(folder: Path) -> dict[str, float]:
    """Errors of the nozzle's distance [mm], by the record of the bench.

    standoff_mm : the largest over all of the path with the beam on, against layers as planned
    standoff_level_mm : the same of a plan that takes the plate for level
    standoff_grown_mm : from the surface that the simulated process grew, its mean in each 10 mm
        along the plate and each layer, less the mean of all: the largest
    """
    file = write_bent_plate(folder)
    row = {"standoff_mm": _largest_error_mm(file)}
    row["standoff_grown_mm"] = _grown_error_mm(file)
    level = file.with_name("level.toml")
    level.write_text(file.read_text().replace('units = "mm"', 'units = "mm"\nlayers = "level"'))
    row["standoff_level_mm"] = _largest_error_mm(level)
    return {name: round(value, 3) for name, value in row.items()}


def _largest_error_mm(file: Path) -> float:
    job = file.with_suffix(".lmj")
    manifest = plan_job(load_part(file), profile(), job)
    path = recorded_run(job).beam_on_path()
    at = path.position_mm - np.array(manifest.part_offset_mm)
    with JobReader(job) as reader:
        first = np.array([entry.first_line for entry in reader.manifest.layers])
    layer = np.searchsorted(first, path.line, side="right")
    wanted = true_height_mm(at[:, 0]) + layer * LAYER_MM
    return float(np.abs(at[:, 2] - wanted).max())


def _grown_error_mm(file: Path) -> float:
    job = file.with_suffix(".lmj")
    record = recorded_run(job)
    with JobReader(job) as reader:
        offset = np.array(reader.manifest.part_offset_mm)
        first = np.array([entry.first_line for entry in reader.manifest.layers])
    x = np.arange(-40.0, 40.5, 0.5)
    heights = true_height_mm(x) - true_height_mm(x).min()
    built = build_from_record(record, replace(
        PROCESS, substrate_z_mm=float(offset[2] + true_height_mm(x).min()),
        substrate_heights=SubstrateHeights(
            float(offset[0] - 40), float(offset[1] - 40), 0.5,
            tuple(tuple(heights) for _ in range(161)))))
    assert built is not None
    known = np.isfinite(built.surface_mm)
    place, length = built.place_mm[known] - offset, built.beam_on_mm[known]
    gap = built.place_mm[known, 2] - built.substrate_z_mm - built.surface_mm[known]
    layer = np.searchsorted(first, built.line[known], side="right") - 1
    bin_of = layer * 6 + np.clip((place[:, 0] + CHORD_MM / 2) / 10, 0, 5).astype(int)
    mean = np.bincount(bin_of, gap * length) / np.bincount(bin_of, length)
    by_layer = mean.reshape(-1, 6)
    return float(np.abs(by_layer - by_layer.mean(axis=1, keepdims=True)).max())
