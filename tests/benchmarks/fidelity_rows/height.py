"""Height of a block of fifty layers whose hoppers feed too little, with and without height checks.

Hidden: both slopes are 6 % low, and a dilution of 20 % on a plate of 316L. The bench's own operator
measures the part every five layers. Rows: height_low_slopes, height_low_slopes_checked: built over
planned, over the core; the same of a cell whose profile is the truth, height_truth_checked; and
built_over_design_* of each.

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

LOW = [{"slope_factor": 0.94}, {"slope_factor": 0.94}]
CHECKS = "\n[process]\nheight_check_every = 5\n"
CASES = {
    "low_slopes": (LOW, ""),
    "low_slopes_checked": (LOW, CHECKS),
    "truth_checked": ([{}, {}], CHECKS),
}


def rows() -> dict[str, float]:
    """The rows by key."""
    found = {}
    for key, (hidden, more) in CASES.items():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            bench = write_bench(folder, hidden)
            bench.write_text(bench.read_text() + PROCESS.format(dilution=0.2))
            cell = SHIPPED / "cell.toml"
            job = planned_case("block", folder / "block", cell, more)
            summary = summary_of(folder / "block",
                                 run_on_bench(folder / "block", job, bench, cell))
            found[f"height_{key}"] = round(summary["height_mm"] / summary["planned_height_mm"], 4)
            found[f"built_over_design_{key}"] = round(summary["built_over_design"], 4)
    return found


if __name__ == "__main__":
    print(json.dumps(rows(), indent=1))
