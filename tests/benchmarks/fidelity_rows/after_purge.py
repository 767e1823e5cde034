"""A part graded along its tracks, whose hoses changed after the cell had measured itself.

Hidden in the feeder test: dead times +0.5 s and −0.5 s, lags ×1.3, slopes +5 %, 1 % noise. Then
the powder of A comes 0.4 s later than that, and of B 0.25 s sooner. The catch scale stands at the
purge position, and powder that falls elsewhere misses it.

Rows, share of the beam-on path within ±0.02, medians over seeds: within_0.02_box_hose_moved, purged
without measuring; within_0.02_box_after_purge.

    python -m tests.benchmarks.fidelity_rows.after_purge [SEEDS]
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from pathlib import Path

from lmctl.cli.profiles import load_profile_or_default
from tests.benchmarks.fidelity_rows.hidden_cell import self_measured, write_bench, write_cell
from tests.benchmarks.fidelity_rows.self_measured import hidden, share_within

SEEDS = 3
LATER_S = (0.4, -0.25)
#: At the purge position of the shipped cell.
AT_PURGE = "x_mm = 10\ny_mm = 10\nreach_mm = 20\n"


def rows(seeds: int = SEEDS) -> dict[str, float]:
    """The rows by key."""
    shares: dict[str, list[float]] = {"hose_moved": [], "after_purge": []}
    for seed in range(seeds):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            cell = write_cell(folder)
            truth = [{key: value for key, value in one.items() if key != "catch_efficiency"}
                     for one in hidden(seed)]
            self_measured(cell, write_bench(folder, truth), folder)
            moved = [{**one, "dead_time_s": one["dead_time_s"] + later_s}
                     for one, later_s in zip(truth, LATER_S, strict=True)]
            bench = write_bench(folder, moved, "moved.toml")
            bench.write_text(bench.read_text() + AT_PURGE)
            for key, table in (("hose_moved", ""), ("after_purge", "\n[scale.purge]\n")):
                cell.write_text(cell.read_text() + table)
                shares[key].append(share_within("box", load_profile_or_default(cell), bench,
                                                folder))
    return {f"within_0.02_box_{key}": round(statistics.median(found), 4)
            for key, found in shares.items()}


if __name__ == "__main__":
    print(json.dumps(rows(*map(int, sys.argv[1:]))))
