"""Scale rows: more layers, a thousand layers, a large part; the same job wherever it is made."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import Any

import lmctl.examples
from tests.benchmarks.plan_rows.measured import LMCTL, Run, in_turn, median_ratio, run
from tests.benchmarks.plan_rows.shapes import ring, write_graded
from tests.part_files import block_file

LAYER_MM = 0.8
REPEATS = 5

BIG_BOX = block_file((300, 300, 200), name="big", composition="""
feature = { kind = "surface" }
[composition.profile]
kind = "table"
points = [
  { at_mm = 0,  of = { "316L" = 0.2, "WC-12Co" = 0.8 } },
  { at_mm = 40, of = { "316L" = 0.9, "WC-12Co" = 0.1 } },
]
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
""")


def scale_rows(folder: Path) -> dict[str, Any]:
    """CPU time of 400 layers over that of 200, medians of five in turn; memory of 1,000; seconds of
    a box of 300 mm."""
    tube = {layers: write_graded(folder, f"tube{layers}", ring(layers * LAYER_MM), 2.0, 1 / 3,
                                 LAYER_MM) for layers in (200, 400, 1000)}
    _plan(folder, tube[200])  # compiles kernels
    runs = in_turn(REPEATS, short=lambda: _plan(folder, tube[200]),
                   long=lambda: _plan(folder, tube[400]))
    tall = _plan(folder, tube[1000])
    (folder / "big.toml").write_text(BIG_BOX)
    big = _plan(folder, folder / "big.toml", "--machine", str(_large_cell(folder)))
    return {
        "growth": median_ratio(runs["long"], runs["short"], "cpu_s"),
        "peak_mb": round(tall.peak_mb, 1), "big_part_s": round(big.wall_s, 1),
        "jobs_identical": _identical(folder),
    }


def _plan(folder: Path, part: Path, *options: str) -> Run:
    machine = () if "--machine" in options else ("--machine", str(_large_cell(folder)))
    job = folder / f"{part.stem}.lmj"
    return run((*LMCTL, "plan", part, "-o", job, *options, *machine), folder)


def _large_cell(folder: Path) -> Path:
    """The example's cell with a travel of 400 mm and a height of 1,000, its purge place outside."""
    cell = folder / "large-cell.toml"
    text = (Path(lmctl.examples.__file__).parent / "cell.toml").read_text()
    lines = []
    for line in text.splitlines():
        key = line.partition("=")[0].strip()
        if key == "travel_mm":
            line = "travel_mm = { x = [-20, 400], y = [-20, 400], z = [-5, 1000] }"
        elif key == "purge_mm":
            line = "purge_mm = [-10, -10, 20]"
        lines.append(line)
    cell.write_text("\n".join(lines) + "\n")
    return cell


def _identical(folder: Path) -> bool:
    """One process, two, and a Dask cluster of two workers."""
    from distributed import LocalCluster

    part = write_graded(folder, "same", ring(60 * LAYER_MM), 1.0, 1 / 3, LAYER_MM)
    jobs = []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None,
                      silence_logs=logging.CRITICAL) as cluster:
        for options in (("--jobs", "1"), ("--jobs", "2"),
                        ("--scheduler", cluster.scheduler_address)):
            _plan(folder, part, *options)
            jobs.append(shutil.copy(folder / "same.lmj", folder / f"same-{len(jobs)}.lmj"))
    first, *others = (Path(job).read_bytes() for job in jobs)
    return all(other == first for other in others)
