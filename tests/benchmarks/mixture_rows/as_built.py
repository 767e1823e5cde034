"""A part planned, run on the simulated cell, and compared with its own material field."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobManifest, LineKind
from lmctl.part.load import load_part
from lmctl.part.part import Part
from lmctl.plan.execution import usable_cores
from lmctl.plan.planner import PlanOptions, plan_job
from lmctl.run.executor import run_job
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.bench_record import BenchRecord
from simulators.process import ProcessConfig, VoxelMap, build_from_record

EXAMPLES = files("lmctl.examples")
PATH_TOLERANCE, VOLUME_TOLERANCE = 0.02, 0.03
#: A difference of volume fraction that is a change of mixture, and time to reach travel speed [s].
_CHANGE_FRACTION, _TO_SPEED_S = 0.004, 0.1
#: Beads are of the planned width, and nothing is melted again: what the plan places is judged.
PROCESS = ProcessConfig(max_power_W=3000, bead_width_mm=2.0, power_W=1500, speed_mm_s=10)


@dataclass(frozen=True)
class AsBuilt:
    """path_share : of the designed path, deposited with its mixture within PATH_TOLERANCE
    volume_share : of the volume deposited inside the part, likewise within VOLUME_TOLERANCE; None
        where not asked for
    """

    manifest: JobManifest
    path_share: float
    volume_share: float | None


def profile():
    return load_profile(Path(str(EXAMPLES / "cell.toml")))


def bench_config(late_s: float = 0.0) -> BenchConfig:
    """The bench that the profile describes, with dead times so much longer."""
    config = BenchConfig.parse((EXAMPLES / "bench.toml").read_text())
    return replace(config, feeders=tuple(
        replace(feeder, hoppers=tuple(
            replace(hopper, dead_time_s=hopper.dead_time_s + late_s) for hopper in feeder.hoppers))
        for feeder in config.feeders))


def build(file: Path, *, late_s: float = 0.0, volume: bool = False) -> AsBuilt:
    """Plan a part file, run its job, and compare."""
    part, job = load_part(file), file.with_suffix(".lmj")
    manifest = plan_job(part, profile(), job, options=PlanOptions(jobs=usable_cores()))
    record = recorded_run(job, late_s)
    share = _path_share(part, manifest, record)
    built = build_from_record(record, PROCESS) if volume else None
    return AsBuilt(manifest, share, None if built is None else volume_share(part, manifest, built))


def duration_s(file: Path, **process: object) -> float:
    """Program time of a part file planned with other process settings."""
    part = load_part(file)
    part = replace(part, process=part.process.model_copy(update=process))
    return float(plan_job(part, profile(), file.with_suffix(".lmj")).totals["duration_s"])


def dwelling_s(job: Path, dwell_s: float) -> float:
    """Program time of the same job with a dwell at each of its changes of mixture.

    Where ours travels slowly, so that powder has time, the nozzle travels at its speed and dwells.
    """
    with JobReader(job) as reader:
        lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
    travel_mm_s = float(lines["speed_mm_s"][lines["kind"] == LineKind.TRAVEL].max())
    lasting_s = np.diff(lines["end_s"], prepend=0.0)
    place = np.column_stack([lines[axis] for axis in ("x_mm", "y_mm", "z_mm")])
    length_mm = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
    bead = np.flatnonzero(lines["kind"] == LineKind.BEAD)
    before, after = bead[:-1], bead[1:]
    change = np.abs(lines["fractions"][after] - lines["fractions"][before]).max(axis=1)
    other = (lines["path"][after] != lines["path"][before]) & (change > _CHANGE_FRACTION)
    total_s = float(lines["end_s"][-1])
    for last, first in zip(before[other], after[other], strict=True):
        own = np.arange(last + 1, first)
        travels = own[lines["kind"][own] == LineKind.TRAVEL]
        quick_s = length_mm[travels].sum() / travel_mm_s + _TO_SPEED_S * len(travels)
        total_s += dwell_s - max(float(lasting_s[travels].sum() - quick_s), 0.0)
    return total_s


def recorded_run(job: Path, late_s: float = 0.0) -> BenchRecord:
    """Run a job on the bench, in virtual time."""
    async def whole() -> Bench:
        with tempfile.TemporaryDirectory() as runs:
            async with Bench(bench_config(late_s), ephemeral_ports=True) as bench:
                await run_job(job, replace_endpoints(profile(), bench.endpoints), Path(runs))
            return bench

    return virtual_time.run_in_virtual_time(whole()).record


def _path_share(part: Part, manifest: JobManifest, record: BenchRecord) -> float:
    """By the mixture at the nozzle's place; what of the plan's path is missing counts as wrong."""
    path = record.beam_on_path()
    designed = part.composition(_part_places(manifest, path.position_mm))
    columns = [path.materials.index(material.name) for material in part.materials]
    off = np.abs(path.fractions[:, columns] - designed).max(axis=1)
    right_mm = float(path.length_mm[off <= PATH_TOLERANCE].sum())  # NaN is not
    return right_mm / max(float(path.length_mm.sum()), manifest.totals["path_length_mm"])


def _part_places(manifest: JobManifest, position_mm: np.ndarray) -> np.ndarray:
    """Where in the part the middle of a bead lies that is deposited at these tool points."""
    places = position_mm - np.array(manifest.part_offset_mm)
    places[:, 2] -= manifest.totals["layer_height_mm"] / 2
    return places


def volume_share(part: Part, manifest: JobManifest, built: VoxelMap) -> float:
    """Of what was deposited in voxels whose middle lies in the part."""
    shape = np.array(built.deposited_mm3.shape[1:])
    index = np.indices(shape).reshape(3, -1).T
    middle = built.origin_mm + (index + 0.5) * built.voxel_mm - np.array(manifest.part_offset_mm)
    low, high = part.bounds_mm
    near = np.flatnonzero(((middle >= low) & (middle <= high)).all(axis=1))
    inside = near[part.body.distance_at(middle[near]) > 0]
    columns = [built.powders.index(material.name) for material in part.materials]
    volume = built.deposited_mm3[columns].reshape(len(columns), -1)[:, inside].T.astype(float)
    total = volume.sum(axis=1)
    off = np.abs(volume / np.maximum(total, 1e-12)[:, None]
                 - part.composition(middle[inside])).max(axis=1)
    return float(total[off <= VOLUME_TOLERANCE].sum() / total.sum())
