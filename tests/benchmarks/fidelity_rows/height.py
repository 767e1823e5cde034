"""Height of a block of fifty layers whose hoppers feed too little, with and without height checks.

Hidden: both slopes are 6 % low, and a dilution of 20 % on a plate of 316L. The bench's own operator
measures the part every five layers. Rows: height_low_slopes, height_low_slopes_checked: built over
planned, over the core; the same of a cell whose profile is the truth, height_truth_checked; and
built_over_design_* of each.

Beads stand beyond the outline of so small a block: whatever is fed, its volume is greater than its
height says, by volume_over_height_*. So heights are brought back to within their tolerance only;
*_to_plan: to the planned height itself, and the volume is as much too great.

    python -m tests.benchmarks.fidelity_rows.height
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from tests.benchmarks.fidelity_rows.as_built import (
    PROCESS,
    planned_case,
    run_on_bench,
    summary_of,
)
from tests.benchmarks.fidelity_rows.hidden_cell import SHIPPED, write_bench

LOW, TRUE = [{"slope_factor": 0.94}, {"slope_factor": 0.94}], [{}, {}]
CHECKS = "\n[process]\nheight_check_every = 5\n"
CASES = {
    "low_slopes": (LOW, ""),
    "low_slopes_checked": (LOW, CHECKS),
    "low_slopes_to_plan": (LOW, CHECKS + "height_tolerance_mm = 0\n"),
    "truth_checked": (TRUE, CHECKS),
}


def rows() -> dict[str, float]:
    """The rows by key."""
    found: dict[str, float] = {}
    for key, (hidden, more) in CASES.items():
        found |= _built(key, hidden, more)
    return found


def _built(key: str, hidden: list[dict[str, float]], more: str) -> dict[str, float]:
    """Height and volume of a block. more : tables behind those of its part file"""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench = write_bench(folder, hidden)
        bench.write_text(bench.read_text() + PROCESS.format(dilution=0.2))
        cell = SHIPPED / "cell.toml"
        job = planned_case("block", folder / "block", cell, more)
        summary = summary_of(folder / "block", run_on_bench(folder / "block", job, bench, cell))
    height = summary["height_mm"] / summary["planned_height_mm"]
    volume = summary["built_over_design"]
    return {f"height_{key}": round(height, 4), f"built_over_design_{key}": round(volume, 4),
            f"volume_over_height_{key}": round(volume / height, 4)}


if __name__ == "__main__":
    print(json.dumps(rows(), indent=1))
