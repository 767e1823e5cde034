"""The one door to the simulated machine: an embedded bench on a loop of virtual time."""

from __future__ import annotations

import math
from importlib.resources import as_file, files
from pathlib import Path

from lmctl.config.machine import MachineProfile
from lmctl.config.toml_file import read_text
from lmctl.errors import ConfigError
from lmctl.run.executor import Progress, RunResult, run_job
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig


def run_simulated(
    job: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
    progress: Progress | None = None, bench: Path | None = None, speed: float | None = None,
) -> RunResult:
    """Run a job on the bench, in virtual time.

    The stack is the one that drives a real cell; only the profile's endpoints are replaced by
    those of the bench, feeder by feeder name.
    speed : times real time, or None for as fast as it goes.
    Raises ConfigError for a bad bench file, and whatever the run raises.
    """
    config = load_bench(bench)

    async def whole_run() -> RunResult:
        async with Bench(config, ephemeral_ports=True) as cell:
            wired = rewire(profile, cell.endpoints)
            return await run_job(job, wired, runs_dir, operator=operator, progress=progress)

    return virtual_time.run(whole_run(), speed=math.inf if speed is None else speed)


def load_bench(path: Path | None) -> BenchConfig:
    """The simulated cell in `path`, or the one that ships. Raises ConfigError."""
    if path is None:
        with as_file(files("lmctl.examples") / "bench.toml") as shipped:
            return load_bench(shipped)
    try:
        return BenchConfig.parse(read_text(path))
    except ValueError as error:
        raise ConfigError(
            f"{path} does not describe a bench", where=str(error).splitlines()
        ) from None


def rewire(profile: MachineProfile, endpoints: dict[str, str]) -> MachineProfile:
    """The profile with its endpoints replaced: "motion", and each feeder by its name.

    Raises ConfigError where the bench lacks a feeder of the profile.
    """
    missing = [feeder.name for feeder in profile.feeder if feeder.name not in endpoints]
    if missing:
        raise ConfigError(
            f"the bench has no feeder {', '.join(missing)}",
            where=f"it has {', '.join(sorted(set(endpoints) - {'motion'}))}",
            hint="give --bench a file with a [[feeder]] for each feeder of the profile",
        )
    return profile.model_copy(update={
        "motion": profile.motion.model_copy(update={"endpoint": endpoints["motion"]}),
        "feeder": tuple(
            feeder.model_copy(update={"endpoint": endpoints[feeder.name]})
            for feeder in profile.feeder
        ),
    })
