"""Speed rows: STL in, job out, beside PrusaSlicer and CuraEngine; the start of a small plan.

Beads of 1.2 mm at 0.8 mm spacing, layers of 0.25 mm, the gear and the organic mesh of the field
benchmark, two materials graded by the distance to an axis, the bench cell, as many processes as
cores. Whole processes by the wall clock, five times in turn, medians. Kernels are compiled before.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import trimesh

from tests.benchmarks.fields import gear_mesh, organic
from tests.benchmarks.plan_rows import peers
from tests.benchmarks.plan_rows.measured import LMCTL, Run, in_turn, median_ratio, run
from tests.benchmarks.plan_rows.shapes import write_graded

REPEATS = 5
SPACING_MM, BEAD_MM, LAYER_MM = 0.8, 1.2, 0.25
IMPORTS = "import numpy, scipy.spatial, scipy.ndimage, numba"


def speed_rows(folder: Path) -> dict[str, Any]:
    """Wall time over that of the slicers; CPU time of a small plan over that of its imports."""
    rows: dict[str, Any] = {}
    for name, mesh in (("gear", gear_mesh()), ("organic", organic())):
        part = write_graded(folder, name, trimesh.Trimesh(*mesh, process=False), BEAD_MM,
                            1 - SPACING_MM / BEAD_MM, LAYER_MM)
        runs = _beside_slicers(folder, part)
        for peer in ("prusa", "cura"):
            rows[f"vs_{peer}_{name}"] = median_ratio(runs["ours"], runs[peer], "wall_s")
    return rows | _cube(folder)


def _beside_slicers(folder: Path, part: Path) -> dict[str, list[Run]]:
    stl, gcode = part.with_suffix(".stl"), folder / "peer.gcode"
    # Crumbs of the organic mesh's poles are narrower than half a bead, and its bumps lean far.
    ours = (*LMCTL, "plan", part, "-o", folder / "ours.lmj", "--allow-incomplete",
            "--allow-overhang")
    run(ours, folder)  # compiles kernels
    return in_turn(
        REPEATS,
        ours=lambda: run(ours, folder),
        prusa=lambda: run(peers.prusa(stl, gcode, SPACING_MM, LAYER_MM), folder),
        cura=lambda: run(
            peers.cura(stl, gcode, SPACING_MM, LAYER_MM), folder, peers.cura_environment()))


def _cube(folder: Path) -> dict[str, Any]:
    trimesh.creation.box((10, 10, 10)).export(folder / "cube.stl")
    plan = (*LMCTL, "plan", "cube.stl", "--units", "mm", "-o", "cube.lmj")
    run(plan, folder)
    runs = in_turn(REPEATS, ours=lambda: run(plan, folder),
                   imports=lambda: run((sys.executable, "-c", IMPORTS), folder))
    return {"cube_vs_imports": median_ratio(runs["ours"], runs["imports"], "cpu_s")}
