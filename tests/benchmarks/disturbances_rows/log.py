"""How true a log is: random parts held, resumed, stopped, killed and recovered.

log_error : largest relative difference, over 50 parts, between a figure of a log row (path with the
    beam on, beam time, energy, powder of each hopper) and the simulated cell's own record of it
layers_missing_from_logs : layers in which the beam was on and that have no row

    python -m tests.benchmarks.disturbances_rows.log [PARTS] [FIRST_SEED]
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from tests.run.recorded_parts import record_part

PARTS = 50

#: Worse than this is printed with its seed.
_ALLOWED = 0.005


def rows(parts: int = PARTS, first_seed: int = 0) -> dict[str, float | int]:
    """Both keys, over so many parts."""
    worst, missing = 0.0, 0
    for seed in range(first_seed, first_seed + parts):
        with tempfile.TemporaryDirectory() as folder:
            part = record_part(seed, Path(folder))
        errors = part.errors()
        (layer, name), error = max(errors.items(), key=lambda one: one[1])
        worst = max(worst, error)
        missing += len(part.missing_layers)
        if error > _ALLOWED or part.missing_layers:
            print(
                f"seed {seed}: layer {layer}, {name} is wrong by {100 * error:.2f} %, missing "
                f"{part.missing_layers}; after {part.happened}; repeat with "
                f"`python -m tests.benchmarks.disturbances_rows.log 1 {seed}`", file=sys.stderr)
    return {"log_error": round(worst, 5), "layers_missing_from_logs": missing}


if __name__ == "__main__":
    print(json.dumps(rows(*map(int, sys.argv[1:]))))
