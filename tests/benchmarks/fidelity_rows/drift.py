"""A slope that drifts by 2 % an hour during a part of four hours, corrected by loss in weight.

The shipped cell with `[feeder.correction]`; hopper A's slope rises by 2 % an hour from the first
turn of its disc, hidden. The simulators' own record of what left the nozzle is compared with the
part's own composition. Rows: within_0.02_drift; within_0.02_drift_uncorrected, the same without the
table; drift_hours, machine time of the part.

    python -m tests.benchmarks.fidelity_rows.drift
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from lmctl.cli.profiles import load_profile_or_default
from lmctl.job.reader import JobReader
from tests.benchmarks.fidelity_rows.hidden_cell import SHIPPED, write_bench
from tests.benchmarks.fidelity_rows.self_measured import MATERIALS, share_of

#: Half and half in the middle; four hours of beads and travels.
BLOCK = f"""
name = "block"
{MATERIALS}
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [110, 55, 25.6]
[composition]
feature = {{ kind = "coordinate", along = "z" }}
profile = {{ kind = "linear", near = {{ "316L" = 0.6, "WC-12Co" = 0.4 }}, \
far = {{ "316L" = 0.4, "WC-12Co" = 0.6 }}, over_mm = [0, 25.6] }}
"""
CORRECTION = "\n[feeder.correction]\nwindow_s = 120\ntime_constant_windows = 10\n"
HIDDEN = [{"slope_drift_per_h": 0.02, "fill_g": 20000}, {}]


def rows() -> dict[str, float | int]:
    """The rows by key."""
    text = (SHIPPED / "cell.toml").read_text()
    head, *feeders = text.split("[[feeder]]")
    with_correction = head + "".join(
        "[[feeder]]" + _with_table(feeder) for feeder in feeders)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "block.toml").write_text(BLOCK)
        bench = write_bench(folder, HIDDEN)
        shares = {}
        for key, profile_text in (("within_0.02_drift", with_correction),
                                  ("within_0.02_drift_uncorrected", text)):
            cell = folder / f"{key}.toml"
            cell.write_text(profile_text)
            shares[key] = round(share_of(folder / "block.toml", load_profile_or_default(cell),
                                         bench, folder), 4)
        with JobReader(folder / "block.lmj") as job:
            hours = job.manifest.layers[-1].end_s / 3600.0
    return {**shares, "drift_hours": round(hours, 2)}


def _with_table(feeder: str) -> str:
    """A feeder's table, and its correction before the next one begins."""
    own, bracket, rest = feeder.partition("\n[")
    return own + "\n" + CORRECTION + bracket + rest


if __name__ == "__main__":
    print(json.dumps(rows()))
