"""`help_s`: wall clock of `lmctl --help`, the whole process, median of seven."""

from __future__ import annotations

import statistics
from pathlib import Path

from tests.benchmarks.plan_rows.measured import LMCTL, run


def rows() -> dict[str, float]:
    return {"help_s": round(statistics.median(
        run([*LMCTL, "--help"], Path.cwd()).wall_s for _ in range(7)), 3)}
