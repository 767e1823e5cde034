"""The best cylinder laid as a part with 2 mm beads, run, and simulated as it was built."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from lmctl.cli.__main__ import main as lmctl
from lmctl.design.as_built import read_as_built
from lmctl.design.part_model import build_model
from lmctl.job.reader import JobReader
from lmctl.part.load import load_measured_part
from tests.benchmarks.design_rows.cylinder import PRESSURE_MPA, optimum

BEAD_MM, LAYERS, LAYER_MM = 2.0, 3, 0.8
MESH_MM = 1.5

#: Beads of 2 mm whatever the power, on a plate that does not mix in: what is judged is the mixture.
PROCESS = """
[process]
max_power_W = 3000
bead_width_mm = 2.0
power_W = 1500
speed_mm_s = 10
"""


def as_built_row(folder: Path) -> dict[str, Any]:
    """Hoop stress over the pressure in the middle layer: largest, and largest mean over a bead."""
    height = LAYERS * LAYER_MM
    best = optimum(folder, 4.0)
    text = best.text.replace("top_mm = [0, 0, 8]", f"top_mm = [0, 0, {height}]").replace(
        "mesh_mm = 4.0", f"mesh_mm = {MESH_MM}\nsection_mm = {height / 2}")
    part = folder / "laid.toml"
    part.write_text(text)
    examples = files("lmctl.examples")
    (folder / "bench.toml").write_text((examples / "bench.toml").read_text() + PROCESS)
    runs = folder / "runs"
    for words in (["plan", part, "-m", folder / "cell.toml", "-o", folder / "laid.lmj"],
                  ["run", folder / "laid.lmj", "--sim", "--bench", folder / "bench.toml",
                   "--runs", runs]):
        code = lmctl([str(word) for word in words])
        assert code == 0, f"lmctl {words[0]} ended with {code}"
    (run,) = (path for path in runs.iterdir() if path.is_dir())
    return stress_as_built(part, run)


def stress_as_built(part: Path, run: Path) -> dict[str, Any]:
    """The stresses of a run of the cylinder; part : its part file"""
    measured = load_measured_part(part)
    names = tuple(material.name for material in measured.part.materials)
    with JobReader(run / "job.lmj") as job:
        offset = job.manifest.part_offset_mm
    built = read_as_built(run / "voxel-map.npz", names).moved(offset)
    model = build_model(measured)
    solution = model.solve(model.fractions_of(built))
    d = model.discretisation
    r = np.linalg.norm(d.places_mm, axis=2)
    x, y = d.places_mm[..., 0] / r, d.places_mm[..., 1] / r
    stress = solution.stress_MPa
    hoop = stress[..., 0] * y**2 + stress[..., 1] * x**2 - 2 * stress[..., 3] * x * y
    around = np.floor((np.arctan2(y, x) + np.pi) * 60 / BEAD_MM).astype(np.int64)
    beads = np.floor((r - 40) / BEAD_MM).astype(np.int64) * 10_000 + around
    _, cell = np.unique(beads.ravel(), return_inverse=True)
    weight = d.weights.ravel()
    mean = np.bincount(cell, weight * hoop.ravel()) / np.bincount(cell, weight)
    radii = np.floor(r - 40).astype(np.int64).ravel()
    ring = np.bincount(radii, weight * hoop.ravel()) / np.bincount(radii, weight)
    return {"cylinder_as_built_p": float(hoop.max() / PRESSURE_MPA),
            "cylinder_as_built_mean_p": float(mean.max() / PRESSURE_MPA),
            "cylinder_as_built_by_radius_p": [round(float(v) / PRESSURE_MPA, 4) for v in ring],
            "cylinder_as_built_mesh_mm": d.fitted.size_mm,
            "cylinder_as_built_voxel_mm": [float(v) for v in built.voxel_mm],
            "cylinder_as_built_void_share": built.void_share(d.part_places_mm)}
