"""The only access to the simulated machine: an embedded bench on a loop of virtual time."""

from __future__ import annotations

import asyncio
import math
import os
import signal
from collections.abc import Callable, Coroutine
from contextlib import suppress
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from firmware_protocol.map_file import shipped_map
from lmctl.config.file_kind import FileKind, refuse_other_kind
from lmctl.config.machine import MachineProfile
from lmctl.config.toml_file import parse_tables, read_text
from lmctl.errors import ConfigError, Finding, UsageError
from lmctl.run.executor import Notice, RunExecutor, RunResult, Watcher
from lmctl.run.journal.run_folders import RunFolder
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.plan import FaultPlan, FaultPlanError
from simulators.operator import SimulatedOperator

T = TypeVar("T")

def run_simulated(
    job: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
    watcher: Watcher | None = None, notice: Notice | None = None, bench: Path | None = None,
    speed: float | None = None, faults: Path | None = None, happened: list[str] | None = None,
) -> RunResult:
    """Run a job on the bench, in virtual time.

    The stack is the one that drives a real cell; only the profile's endpoints are replaced by
    those of the bench, feeder by feeder name.
    speed : times real time, or None for as fast as it goes.
    faults : a file of what goes wrong with the bench; what did is added to `happened` in words
    A bench with a table [process] leaves what it built in the run's folder, however the run ends.
    Raises ConfigError for a bad bench or fault file, and whatever the run raises.
    """
    config = load_bench(bench)
    plan = FaultPlan() if faults is None else load_faults(faults, config)

    async def run_and_close() -> RunResult:
        async with bench_of(config, profile) as cell:
            wired = replace_endpoints(profile, cell.endpoints)
            board = FaultInjector(cell, on_host_killed=_kill_this_process)
            board.schedule(plan)
            executor = RunExecutor(job, wired, runs_dir, operator=operator, watcher=watcher,
                                   notice=notice)
            hands = asyncio.create_task(_answer_height_checks(executor, SimulatedOperator(cell)))
            try:
                return await executor.run()
            finally:
                hands.cancel()
                board.close()
                if config.process is not None and executor.folder is not None:
                    _write_voxel_map(cell, executor.folder, notice)
                if happened is not None:
                    happened.extend(map(str, board.injected))

    return virtual_time.run_in_virtual_time(
        run_and_close(), speed=math.inf if speed is None else speed)


async def _answer_height_checks(executor: RunExecutor, hands: SimulatedOperator) -> None:
    """Measure the part whenever the run is held for it, and resume."""
    while True:
        await executor.height_awaited()
        height_mm = await hands.measure_height()
        with suppress(UsageError):  # not to be believed, or an alarm: the run waits for its user
            executor.enter_height(height_mm)
            executor.resume()


def _write_voxel_map(cell: Bench, folder: RunFolder, notice: Notice | None) -> None:
    """Write what the simulated process built; report what cannot be written."""
    from simulators.process.build import BuildError, build_from_record

    assert cell.config.process is not None
    try:
        built = build_from_record(cell.record, cell.config.process)
        if built is not None:
            built.write(folder.voxel_map)
            return
        problem = "nothing was deposited: there is no voxel map"
    except BuildError as error:
        problem = f"no voxel map: {error}"
    except OSError as error:
        problem = f"cannot write {folder.voxel_map}: {error.strerror}"
    if notice is not None:
        notice(problem)


def run_on_bench(
    act: Callable[[MachineProfile], Coroutine[Any, Any, T]], profile: MachineProfile,
    bench: Path | None = None,
) -> T:
    """Do something with a simulated cell of a profile, in virtual time. Raises what it raises."""
    config = load_bench(bench)

    async def act_and_close() -> T:
        async with bench_of(config, profile) as cell:
            return await act(replace_endpoints(profile, cell.endpoints))

    return virtual_time.run_in_virtual_time(act_and_close())


def run_on_bench_with_operator(
    act: Callable[[MachineProfile, SimulatedOperator], Coroutine[Any, Any, T]],
    profile: MachineProfile, bench: Path | None = None,
) -> T:
    """As `run_on_bench`, with the bench's own operator, who puts weights on and weighs coupons."""
    config = load_bench(bench)

    async def act_and_close() -> T:
        async with bench_of(config, profile) as cell:
            return await act(replace_endpoints(profile, cell.endpoints), SimulatedOperator(cell))

    return virtual_time.run_in_virtual_time(act_and_close())


def bench_of(config: BenchConfig, profile: MachineProfile) -> Bench:
    """A bench for a profile: its feeders have the register maps that the profile names."""
    return Bench(
        config, ephemeral_ports=True,
        maps={feeder.name: feeder.device_map for feeder in profile.feeder
              if feeder.device_map is not None and feeder.device_map is not shipped_map("pmx")},
        relay_feeders=[feeder.name for feeder in profile.feeder if feeder.stopped_by_relay],
    )


def load_bench(path: Path | None) -> BenchConfig:
    """The simulated cell in `path`, or the one that ships. Raises ConfigError."""
    if path is None:
        with as_file(files("lmctl.examples") / "bench.toml") as shipped:
            return load_bench(shipped)
    text = read_text(path)
    refuse_other_kind(parse_tables(text, name=str(path)), FileKind.BENCH, path)
    try:
        return BenchConfig.parse(text)
    except ValueError as error:
        raise ConfigError(
            f"{path} does not describe a bench", where=str(error).splitlines(),
            hint="docs/reference/bench-keys.md lists every key"
        ) from None


def load_faults(path: Path, bench: BenchConfig) -> FaultPlan:
    """What is to go wrong with a bench. Raises ConfigError with every mistake."""
    text = read_text(path)
    refuse_other_kind(parse_tables(text, name=str(path)), FileKind.FAULTS, path)
    try:
        return FaultPlan.parse(text, bench)
    except FaultPlanError as error:
        findings = [Finding(*_key_and_reason(mistake)) for mistake in error.mistakes]
        raise ConfigError.of_findings(
            path, findings,
            hint="a fault file has a table [[fault]] for each thing that goes wrong",
        ) from None


def _key_and_reason(mistake: str) -> tuple[str, str]:
    key, colon, reason = mistake.partition(": ")
    return (key, reason) if colon else ("", mistake)


def _kill_this_process() -> None:
    """As a power cut does: nothing is written any more."""
    os.kill(os.getpid(), signal.SIGKILL)


def replace_endpoints(profile: MachineProfile, endpoints: dict[str, str]) -> MachineProfile:
    """The profile with its endpoints replaced: "motion", "safety", "scale", and each feeder by its
    name. A scale that the bench lacks is taken out.

    Raises ConfigError where the bench lacks a feeder or the safety device of the profile.
    """
    missing = [feeder.name for feeder in profile.feeder if feeder.name not in endpoints]
    if missing:
        raise ConfigError(
            f"the bench has no feeder {', '.join(missing)}",
            where=f"it has {', '.join(sorted(set(endpoints) - {'motion', 'safety'}))}",
            hint="give --bench a file with a [[feeder]] for each feeder of the profile",
        )
    if profile.safety is not None and "safety" not in endpoints:
        raise ConfigError(
            "the bench has no safety device, and the profile has one",
            hint="give --bench a file with a table [safety]",
        )
    return profile.as_simulated(uuid4().hex).model_copy(update={
        "safety": profile.safety and profile.safety.model_copy(
            update={"endpoint": endpoints["safety"]}
        ),
        "scale": profile.scale.model_copy(update={"endpoint": endpoints["scale"]})
        if profile.scale and "scale" in endpoints else None,
        "motion": profile.motion.model_copy(update={"endpoint": endpoints["motion"]}),
        "feeder": tuple(
            feeder.model_copy(update={"endpoint": endpoints[feeder.name]})
            for feeder in profile.feeder
        ),
    })
