"""The first 50 mm of new path after a hold of 60 s, on the box that is graded along its tracks.

The profile is the truth. The part is held again and again, each time a little farther on a track;
each time hoses empty, powder is purged, and the bead is entered again. What was deposited before
the hold and is deposited a second time (the overlap) is no new path.

Rows: after_hold_50mm, the mean share of these 50 mm within ±0.02 of the part's own composition;
after_hold_50mm_worst, of the worst hold; holds, how many there were.

    python -m tests.benchmarks.fidelity_rows.after_hold
"""

from __future__ import annotations

import asyncio
import json
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lmctl.cli.bench import load_bench, replace_endpoints
from lmctl.cli.profiles import load_profile_or_default
from lmctl.part.load import load_part
from lmctl.part.part import Part
from lmctl.plan.planner import plan_job
from lmctl.run.executor import RunExecutor
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_record import BeamOnPath
from tests.benchmarks.fidelity_rows.hidden_cell import SHIPPED, write_bench
from tests.benchmarks.fidelity_rows.self_measured import BOX

HOLD_S, NEW_MM, TOLERANCE = 60.0, 50.0, 0.02
#: Seconds of deposition before the first hold, and from each to the next.
FIRST_S, APART_S, HOLDS = 3.3, 6.3, 6


def rows() -> dict[str, float | int]:
    """The rows by key."""
    with tempfile.TemporaryDirectory() as name:
        shares = shares_after_holds(Path(name))
    return {
        "after_hold_50mm": round(float(np.mean(shares)), 4),
        "after_hold_50mm_worst": round(min(shares), 4),
        "holds": len(shares),
    }


def shares_after_holds(folder: Path) -> list[float]:
    """The share of the new path right after each hold that has its mixture."""
    (folder / "box.toml").write_text(BOX)
    part, job = load_part(folder / "box.toml"), folder / "box.lmj"
    profile = load_profile_or_default(SHIPPED / "cell.toml")
    manifest = plan_job(part, profile, job)
    config = load_bench(write_bench(folder, [{}, {}]))

    async def whole() -> Bench:
        async with Bench(config, ephemeral_ports=True) as cell:
            executor = RunExecutor(job, replace_endpoints(profile, cell.endpoints),
                                   folder / "runs")
            run = asyncio.create_task(executor.run())
            for number in range(HOLDS):
                await _in_state(executor, RunState.DEPOSITING)
                await asyncio.sleep(APART_S if number else FIRST_S)
                executor.hold()
                await _in_state(executor, RunState.HELD)
                await asyncio.sleep(HOLD_S)
                executor.resume()
            await run
        return cell

    path = virtual_time.run_in_virtual_time(whole()).record.beam_on_path()
    return _after_holds(path, part, np.array(manifest.part_offset_mm),
                        manifest.totals["layer_height_mm"])


async def _in_state(executor: RunExecutor, state: RunState) -> None:
    while executor.state is not state:  # noqa: ASYNC110 - a run has no event for its states
        await asyncio.sleep(0.1)


def _after_holds(
    path: BeamOnPath, part: Part, offset_mm: NDArray[np.float64], layer_mm: float
) -> list[float]:
    designed = part.composition(path.position_mm - offset_mm - [0.0, 0.0, layer_mm / 2])
    columns = [path.materials.index(material.name) for material in part.materials]
    off = np.abs(path.fractions[:, columns] - designed).max(axis=1)
    off = np.where(np.isnan(off), np.inf, off)
    begins = np.flatnonzero(np.diff(path.time_s) > HOLD_S) + 1
    shares = []
    for begin in begins:
        ended_mm = path.position_mm[begin - 1]
        again = begin
        while _is_again(path, again, ended_mm):
            again += 1
        run_mm = np.cumsum(path.length_mm[again:])
        new = slice(again, again + int(np.searchsorted(run_mm, NEW_MM)) + 1)
        length = path.length_mm[new]
        shares.append(float(length[off[new] <= TOLERANCE + 1e-9].sum() / length.sum()))
    return shares


def _is_again(path: BeamOnPath, at: int, ended_mm: NDArray[np.float64]) -> bool:
    """Whether a piece lies before the place where the beam went off, seen along the path."""
    ahead_mm = float((ended_mm - path.position_mm[at]) @ path.direction[at])
    return 0.0 <= ahead_mm < 1.0


if __name__ == "__main__":
    print(json.dumps(rows()))
