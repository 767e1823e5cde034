"""Every mixture where it belongs: shares of path and volume, and the time they take.

Parts are planned with strategy "auto" (`mixture_rows/parts.py`), run against the bench in virtual
time, and judged by the simulators' own record: the share of the designed path that is deposited
with a mixture within ±0.02 of the part's own at that place (what is not deposited counts as
wrong), and the share of the deposited volume within ±0.03 (`volume_…`), by the simulated process
without dilution; `volume_union_bound…` is what such beads reach there at most, by
`mixture_rows/bead_bound.py`. The cell's profile is the truth, but for `box_theta`: both dead times
0.5 s longer than it says. `time_…` is program time over that of the plan before there were
strategies (TODAY_S). `dwell_over_ours` is the blade's own job with 30 s of dwell at each change of
mixture in place of its slow travel; `dwell_uncut_over_ours` a plan in mode "dwell", which neither
cuts nor slows tracks whose mixture powder cannot follow.
`forbidden` and `detour` are about alloy rules (`mixture_rows/alloy_rows.py`).

`revisit_within` and `interpass_time` are about temperature (`mixture_rows/interpass.py`).

Prints one JSON object; names of rows choose some of them.

    python -m tests.benchmarks.mixture [ROW ...]
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from tests.benchmarks.mixture_rows.alloy_rows import detour, forbidden_points
from tests.benchmarks.mixture_rows.as_built import build, duration_s, dwelling_s
from tests.benchmarks.mixture_rows.bead_bound import bound_rows
from tests.benchmarks.mixture_rows.interpass import interpass_time, revisit_within
from tests.benchmarks.mixture_rows.parts import write_part
from tests.benchmarks.mixture_rows.standoff import standoff_row

#: Program times of the same parts as planned with tracks along the outline that cross jumps, by
#: the version before (commit 12bfc09), on the same cell [s].
TODAY_S = {
    "plate_step": 313.5, "fig8_union": 272.9, "blade": 851.0, "cutter": 938.9, "gear": 1985.0,
    "gear_steep": 3876.5, "box": 313.4,
}
_WITH_VOLUME = {"plate_step": "plate", "fig8_union": "union", "blade": "blade"}
_DWELL_S = 30.0
#: Rows that need no run on the bench (`mixture_rows/interpass.py`).
_HEAT = {"revisit_within": revisit_within, "interpass_time": interpass_time}
_ALLOY_ROWS = {"forbidden": forbidden_points, "detour": detour}
_ROWS = [*TODAY_S, "standoff", *_ALLOY_ROWS, *_HEAT]


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("rows", nargs="*", metavar="ROW", choices=[[], *_ROWS])
    chosen = options.parse_args().rows or _ROWS
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen:
            if name in _ALLOY_ROWS:
                found |= _ALLOY_ROWS[name]()
                continue
            place = Path(folder) / name
            place.mkdir()
            found |= _HEAT[name](place) if name in _HEAT else _row(name, place)
    print(json.dumps(found, indent=2))


def _row(name: str, folder: Path) -> dict[str, Any]:
    if name == "standoff":
        return standoff_row(folder)
    file = write_part(name, folder)
    as_built = build(file, late_s=0.5 if name == "box" else 0.0, volume=name in _WITH_VOLUME)
    totals = as_built.manifest.totals
    row = {
        "box_theta" if name == "box" else name: round(as_built.path_share, 4),
        f"time_{name}": round(totals["duration_s"] / TODAY_S[name], 3),
        f"strategy_{name}": totals["strategy"],
        f"built_{name}": totals["built_fraction"],
    }
    if as_built.volume_share is not None:
        row[f"volume_{_WITH_VOLUME[name]}"] = round(as_built.volume_share, 4)
    if name == "fig8_union":
        row |= bound_rows()
    if name == "blade":
        same_s = dwelling_s(file.with_suffix(".lmj"), _DWELL_S)
        row["dwell_over_ours"] = round(same_s / totals["duration_s"], 2)
        uncut_s = duration_s(file, strategy=totals["strategy"], powder="dwell", dwell_s=_DWELL_S)
        row["dwell_uncut_over_ours"] = round(uncut_s / totals["duration_s"], 2)
    return row


if __name__ == "__main__":
    main()
