"""One part down the whole road: field, plan, run on the bench; and what is not as it must be."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.errors import InputError, PlanError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.part.load import load_part
from lmctl.part.part import Part
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.run.executor import RunResult, run_job
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.soak.solids import Bound

#: A part may come out of a random tree as nothing, or as too little to lay.
_NO_PART = ("leaves nothing", "leave nothing", "as wide as a bead", "mm tall", "deeper than")
_NODES = 4000
_TOLERANCE = 0.02
#: Random parts have pieces thinner than a bead and walls that lean; the road is what is looked at.
_WHATEVER_IT_IS = PlanOptions(allow_incomplete=True, allow_overhang=True)
#: Between the share promised by the plan's powder model and the share laid on the bench.
_SHARE_OFF = 0.1
_TIME_OFF = 0.01


@dataclass
class Outcome:
    """What became of a part. refused : why there was nothing to do; shortfalls : all that is wrong.

    promised, within : share of the beam-on path within ±0.02 of its mixture, by plan and on bench
    """

    refused: str = ""
    shortfalls: list[str] = field(default_factory=list)
    lines: int = 0
    promised: float = 1.0
    within: float = 1.0
    planned_over_simulated: float = 1.0


def down_the_road(
    text: str, bound: Bound, folder: Path, rng: np.random.Generator, unsure_mm: float = 1e-4
) -> Outcome:
    """text : of a part file; unsure_mm : nearer to the surface signs may be wrong."""
    outcome = Outcome()
    part_file, job = folder / "part.toml", folder / "part.lmj"
    part_file.write_text(text)
    try:
        part = load_part(part_file)
        _judge_part(part, bound, rng, unsure_mm, outcome)
        manifest = plan_job(
            part, load_profile(_shipped("cell.toml")), job, options=_WHATEVER_IT_IS)
    except (InputError, PlanError) as error:
        outcome.refused = error.what
        if not any(words in error.what for words in _NO_PART):
            outcome.shortfalls.append(f"refused: {error.what}")
        return outcome
    outcome.lines = manifest.totals["lines"]
    outcome.promised = manifest.totals["mixture_share"]
    bench, result = virtual_time.run_in_virtual_time(_whole_run(job, folder / "runs"))
    _judge_run(bench, result, job, outcome)
    return outcome


async def _whole_run(job: Path, runs: Path) -> tuple[Bench, RunResult]:
    config = BenchConfig.parse(_shipped("bench.toml").read_text())
    async with Bench(config, ephemeral_ports=True) as bench:
        profile = replace_endpoints(load_profile(_shipped("cell.toml")), bench.endpoints)
        return bench, await run_job(job, profile, runs)


def _judge_part(
    part: Part, bound: Bound, rng: np.random.Generator, unsure_mm: float, outcome: Outcome
) -> None:
    values = np.concatenate([part.distance(slab) for slab in part.grid.slabs(8)])
    at = tuple(rng.integers(0, count, _NODES) for count in values.shape)
    points = np.column_stack([part.grid.axis_mm(axis)[at[2 - axis]] for axis in range(3)])
    got, least = values[at], bound(points)
    wrong = (np.sign(got) != np.sign(least)) & (np.abs(least) > unsure_mm)
    if wrong.any():
        deepest = np.abs(least[wrong]).max()
        outcome.shortfalls.append(f"{wrong.sum()} wrong signs, {deepest:.3f} mm deep")
    inside = got > 0
    if inside.any():
        off = np.abs(part.composition(points[inside]).sum(axis=1) - 1).max()
        if off > 1e-6:
            outcome.shortfalls.append(f"fractions sum to 1 within {off:.1g} only")


def _judge_run(bench: Bench, result: RunResult, job: Path, outcome: Outcome) -> None:
    short = outcome.shortfalls
    with JobReader(job) as reader:
        lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
        planned_s = reader.manifest.layers[-1].end_s
    path, blocks = bench.record.beam_on_path(), bench.motion.trace.blocks()
    designed = path.designed_fractions(np.arange(len(lines)), lines["fractions"])
    outcome.within = float(path.length_fraction_within_tolerance(designed, _TOLERANCE))
    began_s = blocks.start_s[np.flatnonzero(blocks.line > 0)[0]]
    outcome.planned_over_simulated = planned_s / float(blocks.end_s[-1] - began_s)
    if result.state != "done":
        short.append(f"the run ended {result.state}")
    missing = set(
        np.flatnonzero(lines["kind"] == LineKind.BEAD)) - set(bench.motion.executed_line_numbers)
    if missing:
        short.append(f"{len(missing)} beads were not laid")
    if bench.motion.rx_overrun_bytes:
        short.append("bytes were lost")
    if outcome.within < outcome.promised - _SHARE_OFF:
        short.append(f"{outcome.within:.3f} of the path is right, {outcome.promised:.3f} promised")
    if abs(outcome.planned_over_simulated - 1) > _TIME_OFF:
        short.append(f"planned over simulated time is {outcome.planned_over_simulated:.4f}")


def _shipped(name: str) -> Path:
    return Path(str(files("lmctl.examples") / name))
