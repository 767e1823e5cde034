"""Powder on time: ten rings in steps of 0.1, judged at the simulated nozzle.

Source: docs/explanation/powder-delivery.md, Ten rings.

The whole road: a part file is planned, and its job run against the bench in virtual time; the
simulators' own record of beam, motion and powder says which share of the beam-on path was within
±0.02 of the designed volume fraction. Rings of radius 1 to 10 mm at 10 mm/s, about 1 s of beam-off
travel between them, θ 3 s, τ 1 s.

Prints one JSON object: shares for the modes `lead`, `none` and `dwell` (30 s), for `lead` at 60 %
and 140 % feed override and with a bench whose θ is 0.5 s longer than the profile says; and the
layer's time in machine seconds.

    python tests/benchmarks/powder.py
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import MachineProfile, load_profile
from lmctl.job.reader import JobReader
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from lmctl.run.executor import RunExecutor
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig

TOLERANCE = 0.02
THETA_S, LAG_S = 3.0, 1.0

#: 4.2 mm of run-up and run-out at 10 mm/s and a short way between make about a second without beam.
RINGS = """
name = "ten rings"
[[material]]
name = "316L"
density_g_cm3 = 8.0
catch_efficiency = 0.7
power_W = 1000
speed_mm_s = 10
[[material]]
name = "WC-12Co"
density_g_cm3 = 8.0
catch_efficiency = 0.7
power_W = 1000
speed_mm_s = 10
[[body]]
kind = "cylinder"
base_mm = [0, 0, 0]
top_mm = [0, 0, 0.5]
radius_mm = 10.5
[composition]
feature = {{ kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }}
profile = {{ kind = "linear", near = {{ "316L" = 1.0 }}, far = {{ "WC-12Co" = 1.0 }}, \
over_mm = [0, 10] }}
[process]
bead_width_mm = 1.0
overlap = 0.0
layer_height_mm = 0.5
speed_mm_s = 10
lead_in_mm = 4.2
fraction_step = 0.02
powder = "{mode}"
dwell_s = 30.0
"""


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(measure(Path(folder))))


def measure(folder: Path) -> dict[str, float]:
    shipped = files("lmctl.examples")
    profile = true_to(load_profile(Path(str(shipped / "cell.toml"))))
    bench = same_hoses(BenchConfig.parse((shipped / "bench.toml").read_text()), THETA_S)
    late = same_hoses(bench, THETA_S + 0.5)
    jobs = {mode: planned(folder, mode, profile) for mode in ("lead", "none", "dwell")}
    shares: dict[str, float] = {}
    for name, mode, cell, percent in (
        ("lead", "lead", bench, 100), ("none", "none", bench, 100), ("dwell", "dwell", bench, 100),
        ("lead_60", "lead", bench, 60), ("lead_140", "lead", bench, 140),
        ("lead_theta_wrong", "lead", late, 100),
    ):
        share, layer_s = judged(jobs[mode], profile, cell, folder / name, percent)
        shares[name] = round(share, 4)
        if name in ("lead", "none", "dwell"):
            shares[f"{name}_layer_s"] = round(layer_s, 2)
    return shares


def true_to(profile: MachineProfile) -> MachineProfile:
    """The cell with equal hoses, and hoppers that may run as slowly as a ring of 5 % needs."""
    return profile.model_copy(update={"hopper": tuple(
        hopper.model_copy(update={
            "dead_time_s": THETA_S, "lag_s": LAG_S, "min_flow_g_min": 0.0,
        })
        for hopper in profile.hopper
    )})


def same_hoses(bench: BenchConfig, dead_time_s: float) -> BenchConfig:
    """The bench with these hoses, powders of one density, and discs that run at any speed."""
    return replace(bench, feeders=tuple(
        replace(feeder, hoppers=tuple(
            replace(hopper, dead_time_s=dead_time_s, lag_s=LAG_S, density_g_mm3=0.008,
                    catch_efficiency=0.7, n_min_rpm=0.0)
            for hopper in feeder.hoppers
        ))
        for feeder in bench.feeders
    ))


def planned(folder: Path, mode: str, profile: MachineProfile) -> Path:
    part = folder / f"{mode}.toml"
    part.write_text(RINGS.format(mode=mode))
    job = folder / f"{mode}.lmj"
    plan_job(load_part(part), profile, job)
    return job


def judged(
    job: Path, profile: MachineProfile, config: BenchConfig, runs: Path, percent: int
) -> tuple[float, float]:
    """Share of the beam-on path within the tolerance; time from the first bead to the last [s]."""

    async def whole() -> Bench:
        async with Bench(config, ephemeral_ports=True) as bench:
            executor = RunExecutor(job, replace_endpoints(profile, bench.endpoints), runs)
            executor.set_override(percent)
            await executor.run()
        return bench

    path = virtual_time.run_in_virtual_time(whole()).record.beam_on_path()
    with JobReader(job) as reader:
        fractions = np.concatenate([layer.lines["fractions"] for layer in reader.iterate_layers()])
    designed = path.designed_fractions(np.arange(len(fractions)), fractions)
    layer_s = float(path.time_s[-1] - path.time_s[0])
    return float(path.length_fraction_within_tolerance(designed, TOLERANCE)), layer_s


if __name__ == "__main__":
    main()
