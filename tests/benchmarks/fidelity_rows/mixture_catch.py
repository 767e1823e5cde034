"""Powders that are caught otherwise together than alone: hidden, weighed by the cell itself.

Hidden: each powder's catch falls by 20 % of the other's share of the mass fed. `lmctl machine
catch-test` lays coupons of both powders and of one mixture; a box is planned with what it wrote and
built on the bench with a process, without dilution. Rows: built_over_design_mixture, and _powders:
the same where no coupon of a mixture was laid; within_0.03_volume_mixture, _powders.

    python -m tests.benchmarks.fidelity_rows.mixture_catch
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
from tests.benchmarks.fidelity_rows.hidden_cell import lmctl, write_bench, write_cell

HIDDEN = [{"catch_in_mixture": -0.2}, {"catch_in_mixture": -0.2}]


def rows() -> dict[str, float]:
    """The rows by key."""
    found = {}
    for key, more in (("mixture", ()), ("powders", ("--no-mixture",))):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cell, bench = write_cell(folder), write_bench(folder, HIDDEN)
            bench.write_text(bench.read_text() + PROCESS.format(dilution=0.0))
            lmctl("machine", "catch-test", "--sim", "--machine", cell, "--bench", bench,
                  "--runs", folder / "runs", "--operator", "bench", "--json", *more)
            job = planned_case("box", folder / "box", cell)
            summary = summary_of(folder / "box", run_on_bench(folder / "box", job, bench, cell))
            found[f"built_over_design_{key}"] = round(summary["built_over_design"], 4)
            found[f"within_0.03_volume_{key}"] = round(summary["by_volume"]["within"]["0.03"], 4)
    return found


if __name__ == "__main__":
    print(json.dumps(rows(), indent=1))
