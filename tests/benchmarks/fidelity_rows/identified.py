"""How many of twenty self-measured hoppers are right: dead time, lag, slope; bench seeds 0 to 19.

Each seed hides another truth around the profile's: dead time ±0.5 s, lag ×0.7 to ×1.3, slope ±6 %,
with 3 % noise correlated over 1 s and a scale that lags by 0.3 s. `lmctl machine feeder-test`
measures it over the wires, in virtual time, the scale's lag first.

Rows: identified, theta_rms_s; identified_drive_lag, the same with a hidden drive lag of 0.5 s (the
whole response within 0.1 s and the slope within 1 %); covered_95, the share of 95 % intervals that
hold the truth; longest_test_s.

    python -m tests.benchmarks.fidelity_rows.identified [SEEDS]
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.benchmarks.fidelity_rows.hidden_cell import (
    NOISE,
    self_measured,
    write_bench,
    write_cell,
)

SEEDS = 20
DEAD_TIME_S, LAG, SLOPE, RESPONSE_S = 0.1, 0.1, 0.01, 0.1
DRIVE_LAG_S = 0.5


def rows(seeds: int = SEEDS) -> dict[str, float | int]:
    """The rows by key."""
    plain = [_one(seed, 0.0) for seed in range(seeds)]
    lagging = [_one(seed, DRIVE_LAG_S) for seed in range(seeds)]
    return {
        "identified": sum(_is_right(truth, found) for truth, found in plain),
        "theta_rms_s": round(math.sqrt(float(np.mean([
            (_value(found, "dead_time_s") - truth["dead_time_s"])**2 for truth, found in plain
        ]))), 4),
        "identified_drive_lag": sum(_is_whole_right(truth, found) for truth, found in lagging),
        "covered_95": round(float(np.mean([
            _covers(truth[key], found[key]) for truth, found in plain
            for key in ("dead_time_s", "lag_s", "slope")])), 3),
        "longest_test_s": max(float(found["duration_s"]) for _, found in plain + lagging),
    }


def _one(seed: int, drive_lag_s: float) -> tuple[dict[str, float], dict]:
    """The truth of hopper A of a bench, and what its own test says."""
    random = np.random.default_rng(1000 + seed)
    dead_time_s = round(3.0 + random.uniform(-0.5, 0.5), 4)
    lag_s = round(random.uniform(0.7, 1.3), 4)
    slope = round(random.uniform(0.94, 1.06), 4)
    hidden = {"dead_time_s": dead_time_s, "lag_s": lag_s, "slope_factor": slope,
              "drive_lag_s": drive_lag_s, "seed": seed, **NOISE}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench = write_bench(folder, [hidden, {}])
        (found,) = self_measured(write_cell(folder), bench, folder, "--hopper", "A")
    truth = {"dead_time_s": dead_time_s, "lag_s": lag_s, "slope": slope,
             "response_s": dead_time_s + lag_s + drive_lag_s}
    return truth, found


def _value(found: dict, key: str) -> float:
    return float(found[key]["value"])


def _covers(truth: float, measured: dict) -> bool:
    return bool(measured["low"] <= truth <= measured["high"])


def _is_right(truth: dict[str, float], found: dict) -> bool:
    return (abs(_value(found, "dead_time_s") - truth["dead_time_s"]) <= DEAD_TIME_S
            and abs(_value(found, "lag_s") / truth["lag_s"] - 1.0) <= LAG
            and abs(_value(found, "slope") / truth["slope"] - 1.0) <= SLOPE)


def _is_whole_right(truth: dict[str, float], found: dict) -> bool:
    """The whole response right; what the test calls unparted need not be right by itself."""
    return (abs(_value(found, "response_s") - truth["response_s"]) <= RESPONSE_S
            and abs(_value(found, "slope") / truth["slope"] - 1.0) <= SLOPE)


if __name__ == "__main__":
    print(json.dumps(rows(*map(int, sys.argv[1:]))))
