"""Simulation and optimisation against what is known of them.

Prints one JSON object. Closed forms, a cylinder under inner pressure (one material, the best power,
free levels, and what a run has built of them), gradients, limits of the cell, the cutter's exponent
against a scan, and the blade at 200,000 unknowns in a process of its own.

    python tests/benchmarks/design.py [ROW …]

Rows: closed cylinder limits gradients cutter as-built blade; all of them without a name.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.benchmarks.design_rows import as_built, cylinder, searches  # noqa: E402
from tests.design import closed_forms  # noqa: E402

MESH_MM = 2.5

#: Exponents of the graded plate, and an edge length that resolves the steepest of them.
EXPONENTS, PLATE_MESH_MM = (0.2, 0.5, 1.0, 2.0, 5.0), 0.02


def closed(folder: Path) -> dict[str, Any]:
    errors = {
        "patch": max(closed_forms.patch_error(kind, 1.5)
                     for kind in ("plane-stress", "plane-strain", "solid")),
        "lame": max(closed_forms.thick_tube_error(2.0), closed_forms.ring_errors(MESH_MM, 0.0)[2]),
        "timoshenko": closed_forms.bilayer_error(0.8),
        **{f"plate n = {n:g}": closed_forms.heated_plate_error(PLATE_MESH_MM, n)
           for n in EXPONENTS}}
    coarse, fine = (closed_forms.ring_errors(h, closed_forms.BETA) for h in (8.0, 4.0))
    return {"closed_form_errors": errors, "worst_closed_form_error": max(errors.values()),
            "order_displacement": float(np.log2(coarse[0] / fine[0])),
            "order_stress": float(np.log2(coarse[1] / fine[1]))}


def cylinder_row(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = dict(cylinder.known_cylinders(MESH_MM))
    found["cylinder_optimum_p"] = cylinder.hoop_over_pressure(cylinder.optimum(folder, MESH_MM))
    return found


def blade(folder: Path) -> dict[str, Any]:
    done = subprocess.run([sys.executable, "-m", "tests.benchmarks.design_rows.blade"], cwd=ROOT,
                          capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


ROWS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "closed": closed,
    "cylinder": cylinder_row,
    "limits": cylinder.over_gradient,
    "gradients": lambda folder: {"gradient_error": searches.gradient_error(folder)},
    "cutter": searches.cutter_k,
    "as-built": as_built.as_built_row,
    "blade": blade,
}


def main(names: list[str]) -> None:
    found: dict[str, Any] = {}
    for name in names or list(ROWS):
        with tempfile.TemporaryDirectory() as folder:
            found |= ROWS[name](Path(folder))
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main(sys.argv[1:])
