"""Dilution that is hidden, measured by the cell itself, and made up for by the plan.

The shipped cell and bench with a table [process] whose dilution is 20 % ± 5, drawn for each seed,
on a plate of 316L. `lmctl machine dilution-test` lays its tracks over the wires, and the bench's
own operator analyses them. The parts state their plate's alloy and are planned with the calibration
that it wrote; the box with strategy "auto", which lays tracks of one mixture each, and as
box_offset with tracks along its outline, along which its mixture changes. Voxels of 0.25 mm are
compared by `lmctl report --as-built`; rows ending in _checked are the same by the few lines of
arithmetic of the group `as_built`.

Rows: within_0.03_volume_compensated_* of gear, ring, box and blend, medians over the seeds, and
_worst of them; dilution_error_points, the greatest error of a measured dilution, in points of per
cent; built_over_design_compensated, core_void_compensated of the gear;
height_after_50_layers_compensated of a block, built over planned. With a dilution of 18 % that
rises by 0.1 point with every J/mm: within_0.03_volume_energy_ring, and _energy_constant_ring, the
same with 18 % typed in for all energies.

    python -m tests.benchmarks.fidelity_rows.dilution [SEEDS] [PART ...]
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.benchmarks.fidelity_rows.as_built import (
    checked_against_map,
    planned_case,
    run_case,
    run_on_bench,
    summary_of,
    write_process_bench,
)
from tests.benchmarks.fidelity_rows.hidden_cell import SHIPPED, lmctl, write_cell

SEEDS = 5
PARTS = ("gear", "ring", "box", "box_offset", "blend", "block")
SUBSTRATE = '\n[substrate]\nmaterial = "316L"\n'
AUTO = '\n[process]\nstrategy = "auto"\n'


def rows(seeds: int = SEEDS, names: tuple[str, ...] = PARTS) -> dict[str, float]:
    """The rows by key."""
    shares: dict[str, list[float]] = {}
    found: dict[str, float] = {"dilution_error_points": 0.0}
    for seed in range(seeds):
        hidden = round(float(np.random.default_rng(2000 + seed).uniform(0.15, 0.25)), 4)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cell = write_cell(folder)
            error = 100 * max(abs(one - hidden) for one in _measured(cell, folder, hidden))
            found["dilution_error_points"] = max(found["dilution_error_points"], round(error, 2))
            for part in names:
                if part == "block" and seed:
                    continue
                summary, checked = _compensated(part, cell, folder / part, hidden)
                for key, share in (("", summary["by_volume"]["within"]["0.03"]),
                                   ("_checked", checked["volume"])):
                    shares.setdefault(f"{part}{key}", []).append(share)
                print(seed, hidden, part, shares[part][-1], file=sys.stderr)
                if seed == 0:
                    found |= _volumes(part, summary)
    for part, each in shares.items():
        name, checked = part.removesuffix("_checked"), part.endswith("_checked") * "_checked"
        key = f"within_0.03_volume_compensated_{name}"
        found[f"{key}{checked}"] = round(statistics.median(each), 4)
        if not checked:
            found[f"{key}_worst"] = round(min(each), 4)
    return found | (_by_energy() if "ring" in names else {})


def _by_energy() -> dict[str, float]:
    """Rows of a dilution that depends on the energy per length."""
    hidden, rises = 0.18, "dilution_per_J_mm = 0.001\n"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cells = {"energy": write_cell(folder), "energy_constant": folder / "typed-in.toml"}
        cells["energy_constant"].write_text(
            (SHIPPED / "cell.toml").read_text() + f"\n[[dilution]]\nshare = {hidden}\n")
        _measured(cells["energy"], folder, hidden, rises)
        found = {}
        for key, cell in cells.items():
            job = planned_case("ring", folder / key, cell, SUBSTRATE)
            bench = write_process_bench(folder / key, hidden, rises)
            summary = summary_of(folder / key, run_on_bench(folder / key, job, bench, cell))
            found[f"within_0.03_volume_{key}_ring"] = round(
                summary["by_volume"]["within"]["0.03"], 4)
    return found


def _measured(cell: Path, folder: Path, hidden: float, more: str = "") -> list[float]:
    """What `lmctl machine dilution-test` finds of both powders on a bench. more : keys of it"""
    bench = write_process_bench(folder, hidden, more)
    shares = []
    for material in ("316L", "WC-12Co"):
        found = lmctl("machine", "dilution-test", "--sim", "--machine", cell, "--bench", bench,
                      "--runs", folder / "runs", "--material", material, "--substrate", "316L",
                      "--operator", "bench", "--json")
        measured = found["dilution"]
        assert isinstance(measured, list)
        shares += [float(one["dilution"]["value"]) for one in measured]
    return shares


def _compensated(part: str, cell: Path, folder: Path, hidden: float) -> tuple[dict, dict]:
    """A part planned with what was measured, and run with what is true."""
    case = part.removesuffix("_offset")
    job = planned_case(case, folder, cell, SUBSTRATE + AUTO * (part == "box"))
    run = run_case(folder, job, hidden, cell)
    return summary_of(folder, run), checked_against_map(case, run)


def _volumes(part: str, summary: dict) -> dict[str, float]:
    if part == "block":
        return {"height_after_50_layers_compensated": round(
            summary["height_mm"] / summary["planned_height_mm"], 4)}
    if part == "gear":
        return {"built_over_design_compensated": round(summary["built_over_design"], 4),
                "core_void_compensated": round(summary["core_void"], 5)}
    return {}


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print(json.dumps(rows(count, tuple(sys.argv[2:]) or PARTS), indent=1))
