"""What the plan says of its mixture against what is built, over 30 random parts.

Each part is planned and run on the simulated cell; the simulators' own record of what left the
nozzle is compared with the part's own composition at the nozzle's place: the built share of the
beam-on path within ±0.02. The feeders are steady: how far noise reaches is no part of the range.

Profile = truth: verdict_within_0.01, parts whose predicted share is within ±0.01 of the built one;
verdict_worst_off, the greatest difference; verdict_volume_median_off, verdict_volume_worst_off, the
same by volume within ±0.03, against the simulated process without dilution.

Hidden truth: one cell measures itself over the wires (`feeder-test` with 3 % noise, `catch-test`);
each part is then built on a cell whose dead times, lags, slopes, offsets and catches are drawn
evenly from the measured intervals: verdict_covered, parts whose stated range holds the built share;
verdict_range_median, the median width of the range; verdict_usual_covered, parts that reach what
the plan says 95 of 100 cells do.

    python -m tests.benchmarks.fidelity_rows.margins [FIRST LAST]
"""

from __future__ import annotations

import json
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np

from lmctl.calibration.calibration_file import Calibration, MeasuredValue, load_calibration
from lmctl.cli.bench import load_bench, replace_endpoints
from lmctl.cli.profiles import load_profile_or_default
from lmctl.config.machine import MachineProfile
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobManifest
from lmctl.part.load import load_part
from lmctl.part.part import Part
from lmctl.plan.planner import plan_job
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_record import BenchRecord
from simulators.process import build_from_record
from tests.benchmarks.fidelity_rows.hidden_cell import (
    NOISE,
    SHIPPED,
    lmctl,
    self_measured,
    write_bench,
    write_cell,
)
from tests.benchmarks.fidelity_rows.self_measured import MATERIALS
from tests.benchmarks.mixture_rows.as_built import PROCESS, volume_share

PARTS = 30
TOLERANCE, NEAR = 0.02, 0.01


def rows(parts: int = PARTS) -> dict[str, float | int]:
    """The rows by key."""
    return rows_of(range(parts))


def rows_of(seeds: range) -> dict[str, float | int]:
    """The rows for some of the parts."""
    true = [_true(seed) for seed in seeds]
    off, volume_off = [one[0] for one in true], [one[1] for one in true]
    with tempfile.TemporaryDirectory() as name:
        cell, calibration = _self_measured(Path(name))
        hidden = [_hidden(seed, cell, calibration) for seed in seeds]
    return {
        "verdict_within_0.01": sum(one <= NEAR for one in off),
        "verdict_worst_off": round(max(off), 4),
        "verdict_volume_median_off": round(statistics.median(volume_off), 4),
        "verdict_volume_worst_off": round(max(volume_off), 4),
        "verdict_covered": sum(
            path["worst"] <= share <= path["best"] for path, _, share in hidden),
        "verdict_range_median": round(statistics.median(
            path["best"] - path["worst"] for path, _, _ in hidden), 4),
        "verdict_usual_covered": sum(share >= usual for _, usual, share in hidden),
    }


def part_text(seed: int) -> str:
    """A random part: a box or a cylinder of two or three layers, graded in a random way."""
    random = np.random.default_rng(seed)
    layers = int(random.integers(2, 4))
    height = 0.8 * layers
    if random.random() < 0.5:
        size = random.uniform([16, 8], [36, 16]).round(1)
        body = f'kind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [{size[0]}, {size[1]}, {height}]'
        middle, reach = size / 2, float(size.max())
    else:
        radius = round(float(random.uniform(7, 13)), 1)
        body = (f'kind = "cylinder"\nbase_mm = [0, 0, 0]\ntop_mm = [0, 0, {height}]\n'
                f"radius_mm = {radius}")
        middle, reach = np.zeros(2), 2 * radius
    feature, over = [
        ('kind = "coordinate", along = "x"', (middle[0] - reach / 2, middle[0] + reach / 2)),
        ('kind = "coordinate", along = "y"', (middle[1] - reach / 2, middle[1] + reach / 2)),
        (f'kind = "axis", point_mm = [{middle[0]}, {middle[1]}, 0], direction = [0, 0, 1]',
         (0.0, reach / 2)),
        (f'kind = "point", at_mm = [{middle[0] - reach / 3:.2f}, {middle[1]}, 0]', (0.0, reach)),
    ][int(random.integers(4))]
    near = random.uniform(0.15, 0.35)
    steepness = np.exp(random.uniform(np.log(0.015), np.log(0.15)))  # per mm
    over = (over[0], min(over[1], over[0] + 0.6 / steepness))
    far = near + min(steepness * (over[1] - over[0]), 0.55)
    if random.random() < 0.5:
        near, far = far, near
    strategy = ["offset", "offset", "hatch", "iso-composition"][int(random.integers(4))]
    mode = ["lead", "lead", "lead", "none"][int(random.integers(4))]
    step = [0.01, 0.02, 0.02, 0.03][int(random.integers(4))]
    return f"""
name = "part {seed}"
{MATERIALS}
[[body]]
{body}
[composition]
feature = {{ {feature} }}
profile = {{ kind = "linear", over_mm = [{over[0]:.3f}, {over[1]:.3f}], \
near = {{ "316L" = {1 - near:.4f}, "WC-12Co" = {near:.4f} }}, \
far = {{ "316L" = {1 - far:.4f}, "WC-12Co" = {far:.4f} }} }}
[process]
strategy = "{strategy}"
fraction_step = {step}
powder = "{mode}"
min_built_fraction = 0.5
"""


def built(folder: Path, text: str, profile: MachineProfile, bench: Path) -> tuple[
    JobManifest, float, Part, BenchRecord]:
    """Plan and run a part; its manifest, the share of its beam-on path with its mixture, the part,
    and the record of what was built."""
    file = folder / "part.toml"
    file.write_text(text)
    part, job = load_part(file), folder / "part.lmj"
    manifest = plan_job(part, profile, job)
    config = load_bench(bench)

    async def whole() -> Bench:
        async with Bench(config, ephemeral_ports=True) as cell:
            wired = replace_endpoints(profile, cell.endpoints)
            await RunExecutor(job, wired, folder / "runs").run()
        return cell

    record = virtual_time.run_in_virtual_time(whole()).record
    path = record.beam_on_path()
    with JobReader(job) as reader:
        offset_mm = np.array(reader.manifest.part_offset_mm)
    half_mm = manifest.totals["layer_height_mm"] / 2
    designed = part.composition(path.position_mm - offset_mm - [0.0, 0.0, half_mm])
    order = [path.materials.index(material.name) for material in part.materials]
    wanted = np.zeros_like(path.fractions)
    wanted[:, order] = designed
    share = float(path.length_fraction_within_tolerance(wanted, TOLERANCE))
    return manifest, share, part, record


def _true(seed: int) -> tuple[float, float]:
    """How far the predicted shares of path and volume are from what is built, profile = truth."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cell = folder / "cell.toml"
        cell.write_text((SHIPPED / "cell.toml").read_text())
        bench = write_bench(folder, [{}, {}])
        manifest, share, part, record = built(
            folder, part_text(seed), load_profile_or_default(cell), bench)
    margins = manifest.totals["margins"]
    found = build_from_record(record, PROCESS)
    assert found is not None, "something was deposited"
    off = margins["path"]["predicted"] - share
    volume_off = margins["volume"]["predicted"] - volume_share(part, manifest, found)
    print(seed, round(share, 4), round(off, 4), round(volume_off, 4), file=sys.stderr)
    return abs(off), abs(volume_off)


def _self_measured(folder: Path) -> tuple[Path, Calibration]:
    """A profile with the calibration beside it that its cell has made, and that calibration."""
    cell, bench = write_cell(folder), write_bench(folder, [{**NOISE, "seed": 1},
                                                           {**NOISE, "seed": 2}])
    self_measured(cell, bench, folder)
    lmctl("machine", "catch-test", "--sim", "--machine", cell, "--bench", bench, "--runs",
          folder / "runs", "--no-mixture", "--operator", "bench", "--json")
    return cell, load_calibration(folder / "calibration.json")


def _hidden(seed: int, cell: Path, calibration: Calibration) -> tuple[
    dict[str, float], float, float]:
    """The stated range of the path's share, what 95 of 100 cells reach, and the built share."""
    random = np.random.default_rng(5000 + seed)
    profile = load_profile_or_default(cell)
    truth = [_truth_within(calibration, hopper.name, hopper.material, random)
             for hopper in profile.hopper]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        manifest, share, _, _ = built(folder, part_text(seed), profile, write_bench(folder, truth))
    margins = manifest.totals["margins"]
    path, usual = margins["path"], margins["path_95_of_100"]
    print(seed, path, usual, round(share, 4), file=sys.stderr)
    return path, usual, round(share, 4)


def _truth_within(
    calibration: Calibration, hopper: str, material: str, random: np.random.Generator
) -> dict[str, float]:
    """Keys of a hopper's table on the bench, drawn evenly from the intervals."""
    test, catch = calibration.hopper_calibration(hopper), calibration.catch_of(material)
    assert test is not None, "the hopper was tested"
    assert catch is not None, "its powder's catch was measured"

    def drawn(value: MeasuredValue) -> float:
        return float(random.uniform(value.low, value.high))

    while True:
        dead_time_s, lag_s = drawn(test.dead_time_s), drawn(test.lag_s)
        if test.response_s.low <= dead_time_s + lag_s <= test.response_s.high:
            break
    return {"dead_time_s": dead_time_s, "lag_s": lag_s, "slope_factor": drawn(test.slope),
            "offset_g_min": drawn(test.offset_g_min), "catch_efficiency": drawn(catch.efficiency)}


if __name__ == "__main__":
    print(json.dumps(rows_of(range(*map(int, sys.argv[1:])) if len(sys.argv) > 1
                             else range(PARTS))))
