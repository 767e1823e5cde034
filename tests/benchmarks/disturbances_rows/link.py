"""The motion link disturbed: what is ridden out, what is named, and how soon the rest is held.

parts_completed_with_10_percent_reports_garbled : of 20 parts, each made while one status report in
    ten is damaged (half of those are a changed digit, which still parses) and one in ten is lost,
    from the first question to the last; over TCP and pty, Grbl and grblHAL, some of them held and
    resumed by an operator, or overridden. A part is complete where the simulators' record says
    that every bead was deposited, and nothing else is wrong with it
holds_caused : alarms in their journals: none of those disturbances is to hold anything
first_out_right : share of the fault matrix (tests/faults/matrix.py, every fault in every state)
    whose headline names the injected fault, of all cells in which something was noticed
silence_or_departure_holds_within_s : the longest time from a controller that falls silent, or a
    nozzle that leaves its path by more than 0.1 mm, to the hold; at random moments, the departures
    on a disturbed link as above
"""

from __future__ import annotations

import asyncio
import random
import re
import sys
import tempfile
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import MachineProfile, load_profile
from lmctl.errors import LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.executor import RunExecutor
from lmctl.run.interlocks.motion_rules import OFF_PATH_MM
from lmctl.run.journal.format import read_records
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench, with_motion_on_pty
from simulators.bench_config import BenchConfig
from simulators.fault_outcome import judge_fault
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import FAULT_KINDS, Fault
from simulators.safety_checks import SafetyChecks
from tests.faults.expected import EXPECTED
from tests.faults.kills import shortened
from tests.faults.matrix import STATES, faults_of, try_one
from tests.faults.matrix import write_job as write_matrix_job
from tests.run.conftest import squares, write_job

PARTS, SILENCES, DEPARTURES = 20, 10, 10
SHARE = 0.1
_EXACT_MM = 0.05
_LONGEST_S = 600.0
_LOOK_S = 0.002
_REPEAT = "python tests/benchmarks/disturbances.py link"


def rows() -> dict[str, float | int]:
    """All rows of this group."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = [disturbed_part(seed, folder / f"part-{seed}") for seed in range(PARTS)]
        held_s = [silence(seed, folder / f"silence-{seed}") for seed in range(SILENCES)]
        held_s += [departure(seed, folder / f"departure-{seed}") for seed in range(DEPARTURES)]
        for trial in (*parts, *held_s):
            if trial.shortfalls:
                print(f"{trial.name}: {'; '.join(trial.shortfalls)}; again: {_REPEAT}",
                      file=sys.stderr)
        return {
            "parts_completed_with_10_percent_reports_garbled":
                sum(not part.shortfalls for part in parts),
            "holds_caused": sum(part.alarms for part in parts),
            "silence_or_departure_holds_within_s":
                round(max(trial.held_after_s for trial in held_s), 3),
            "first_out_right": first_out_right(folder),
        }


@dataclass
class Trial:
    """One run. alarms : in its journal; held_after_s : from what went wrong to the hold"""

    name: str
    folder: Path
    seed: int
    alarms: int = 0
    held_after_s: float = 0.0
    shortfalls: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.folder.mkdir()
        profile = self.folder / "cell.toml"
        profile.write_text(shortened("cell-safe.toml"))
        self.profile: MachineProfile = load_profile(profile)
        self.job = self.folder / "job.lmj"
        write_job(self.job, self.profile, squares(layers=2, per_layer=2, side_mm=12.0))
        self.draw = random.Random(self.seed)

    def wires(self) -> BenchConfig:
        """Over TCP or a pty, Grbl or grblHAL, by the seed."""
        config = BenchConfig.parse(shortened("bench-safe.toml"))
        if self.seed % 2:
            config = replace(config, motion=replace(
                config.motion, dialect="grbl", rx_bytes=128, planner_blocks=15,
                settings={**config.motion.settings, 10: 3}))
        return with_motion_on_pty(config) if self.seed % 4 >= 2 else config

    def run(
        self, meanwhile: Callable[[Bench, FaultInjector, RunExecutor], Awaitable[None]]
    ) -> tuple[Bench, str]:
        """Run the job to its end, whatever that is; the bench afterwards, and the end."""
        return virtual_time.run_in_virtual_time(self._main(meanwhile))

    async def _main(
        self, meanwhile: Callable[[Bench, FaultInjector, RunExecutor], Awaitable[None]]
    ) -> tuple[Bench, str]:
        async with Bench(self.wires(), ephemeral_ports=True) as bench:
            executor = RunExecutor(
                self.job, replace_endpoints(self.profile, bench.endpoints), self.folder / "runs")
            board = FaultInjector(bench)
            acting = asyncio.create_task(meanwhile(bench, board, executor))
            self.began_s = asyncio.get_running_loop().time()
            try:
                async with asyncio.timeout(_LONGEST_S):
                    await executor.run()
            except LmctlError as error:
                self.shortfalls.append(error.what)
            except TimeoutError:
                self.shortfalls.append("the run did not end")
            acting.cancel()
            (died,) = await asyncio.gather(acting, return_exceptions=True)
            if isinstance(died, Exception):
                self.shortfalls.append(repr(died))
            board.clear_all()
            await asyncio.sleep(5.0)
            self._judge(bench)
            return bench, executor.state.value

    def _judge(self, bench: Bench) -> None:
        """Read what is asked of bench and journal while the bench still stands."""
        records = [
            r for path in self.folder.glob("runs/*/journal.jsonl") for r in read_records(path)]
        self.alarm_s = [r["t"] + self.began_s for r in records if r["kind"] == "alarm"]
        self.alarms = len(self.alarm_s)
        self.shortfalls += judge_fault(bench).safety_shortfalls(_LONGEST_S, _LONGEST_S)
        self.drawn_mm = {
            line.line: line.beam_on_mm for line in SafetyChecks(bench).beam_on_length_by_line()}

    def missing_lines(self) -> list[int]:
        """Beads that were not deposited to their end."""
        kinds, start_mm, end_mm = path_of(self.job)
        length_mm = np.linalg.norm(end_mm - start_mm, axis=1)
        return [n for n in np.flatnonzero(kinds == LineKind.BEAD).tolist()
                if self.drawn_mm.get(n, 0.0) < length_mm[n] - _EXACT_MM]


def disturbed_part(seed: int, folder: Path) -> Trial:
    """A part made on a link that garbles one report in ten and loses one in ten."""
    trial = Trial(f"part with seed {seed}", folder, seed)

    async def operate(bench: Bench, board: FaultInjector, executor: RunExecutor) -> None:
        disturb(board, seed)
        if seed % 3 == 0:
            return
        while executor.state is not RunState.DEPOSITING:  # noqa: ASYNC110 (states have no event)
            await asyncio.sleep(0.1)
        await asyncio.sleep(trial.draw.uniform(1.0, 8.0))
        if seed % 3 == 1:
            executor.set_override(trial.draw.choice((70, 120)))
            return
        executor.hold()
        while executor.state is not RunState.HELD:  # noqa: ASYNC110
            await asyncio.sleep(0.1)
        await asyncio.sleep(2.0)
        executor.resume()

    _, end = trial.run(operate)
    if end != RunState.DONE:
        trial.shortfalls.append(f"ended {end}")
    if missing := trial.missing_lines():
        trial.shortfalls.append(f"lines {missing[:5]} are missing")
    if trial.alarms:
        trial.shortfalls.append(f"{trial.alarms} alarms")
    return trial


def disturb(board: FaultInjector, seed: int) -> None:
    """One report in ten garbled, one in ten lost, until it is cleared."""
    board.inject(Fault.create("reports_garbled", probability=SHARE, seed=seed))
    board.inject(Fault.create("reports_lost", probability=SHARE, seed=seed + 1000))


def silence(seed: int, folder: Path) -> Trial:
    """A controller that falls silent, or takes no more bytes, at a random moment."""
    trial = Trial(f"silence with seed {seed}", folder, seed)

    async def fall_silent(bench: Bench, board: FaultInjector, executor: RunExecutor) -> None:
        await _some_way_on(trial, executor)
        kind, values = trial.draw.choice((
            ("controller_silent", {}), ("controller_silent", {"receives": True}),
            ("controller_stalls", {})))
        trial.since_s = asyncio.get_running_loop().time()
        board.inject(Fault.create(kind, **values))

    trial.run(fall_silent)
    return _timed(trial, trial.since_s)


def departure(seed: int, folder: Path) -> Trial:
    """A nozzle that leaves its path, since a place was damaged on its way to the controller."""
    trial = Trial(f"departure with seed {seed}", folder, seed)
    trial.since_s = None

    async def depart(bench: Bench, board: FaultInjector, executor: RunExecutor) -> None:
        disturb(board, seed)
        await _some_way_on(trial, executor)
        for letter in "XY":  # one alone may move the target along the path
            percent = trial.draw.choice((93, 107))
            board.inject(Fault.create("word_garbled", letter=letter, percent=percent))
        _, start_mm, end_mm = path_of(trial.job)
        loop = asyncio.get_running_loop()
        while executor.state in (RunState.DEPOSITING, RunState.ARMED):
            if trial.since_s is None and off_path_mm(
                bench.motion.position_mm, start_mm, end_mm
            ) > OFF_PATH_MM:
                trial.since_s = loop.time()
            await asyncio.sleep(_LOOK_S)
        while executor.state is not RunState.HELD:  # noqa: ASYNC110
            await asyncio.sleep(0.1)
        with suppress(UsageError):
            executor.stop()

    trial.run(depart)
    return _timed(trial, trial.since_s)


async def _some_way_on(trial: Trial, executor: RunExecutor) -> None:
    while executor.state is not RunState.DEPOSITING:  # noqa: ASYNC110 (states have no event)
        await asyncio.sleep(0.01)
    await asyncio.sleep(trial.draw.uniform(1.0, 12.0))


def _timed(trial: Trial, since_s: float | None) -> Trial:
    """Held so long after since_s; the run's own end is no shortfall of the measurement."""
    trial.shortfalls.clear()
    after = [at_s for at_s in trial.alarm_s if since_s is not None and at_s >= since_s - _LOOK_S]
    if since_s is None or not after:
        trial.shortfalls.append("it did not depart" if since_s is None else "nothing held it")
        trial.held_after_s = _LONGEST_S
    else:
        trial.held_after_s = after[0] - since_s
    return trial


def path_of(job: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Kinds, starts and ends of all lines of a job; places are (lines, 3) [mm]."""
    with JobReader(job) as reader:
        lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
    end_mm = np.column_stack([lines["x_mm"], lines["y_mm"], lines["z_mm"]]).astype(float)
    return lines["kind"], np.vstack([end_mm[:1], end_mm[:-1]]), end_mm


def off_path_mm(
    at_mm: tuple[float, float, float], start_mm: np.ndarray, end_mm: np.ndarray
) -> float:
    """Distance of a place from the nearest line of the whole program [mm]."""
    along, off = end_mm - start_mm, np.array(at_mm) - start_mm
    length2 = np.einsum("ij,ij->i", along, along)
    share = np.divide(np.einsum("ij,ij->i", off, along), length2,
                      out=np.zeros_like(length2), where=length2 > 0.0)
    off = off - np.clip(share, 0.0, 1.0)[:, None] * along
    return float(np.sqrt(np.einsum("ij,ij->i", off, off).min()))


def first_out_right(folder: Path) -> float:
    """Share of the cells of the fault matrix with a headline in which it names the fault."""
    here = folder / "matrix"
    here.mkdir()
    job = write_matrix_job(here)
    right = noticed = 0
    for fault in (fault for name in FAULT_KINDS for fault in faults_of(name)):
        for state in STATES:
            cell = try_one(fault, state, here, job)
            if not cell.headline:
                continue
            noticed += 1
            named = re.search(EXPECTED[fault.kind.name], cell.headline, re.IGNORECASE)
            right += named is not None
            if named is None:
                print(f"{fault} in {state}: {cell.headline}; again: python -m tests.faults.matrix "
                      f"{fault.kind.name}", file=sys.stderr)
    return round(right / noticed, 4)
