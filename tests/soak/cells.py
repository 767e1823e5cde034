"""One run of a small job with random faults, a random operator and random wires, judged."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.errors import LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.run.executor import RunExecutor
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.state.transitions import FINAL_STATES, RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import Address, BenchConfig
from simulators.fault_outcome import judge_fault
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kind import FaultParameter, FaultTarget, ParameterValue
from simulators.faults.kinds import FAULT_KINDS, Fault
from simulators.safety_checks import SafetyChecks
from tests.faults.kills import shortened
from tests.run.conftest import squares, write_job
from tests.run.only_run import journal_of_only_run

_WITHIN_S = 16.0  # a small job takes that long with its gas and powder
_STAND_S = (0.01, 0.1, 0.5, 2.0, 5.0, 20.0, 120.0)
_LONGEST_S, _PATIENCE_S = 1500.0, 400.0
_NOTHING_MM = 0.02
_LOOKS_S = 25.0  # how often the operator comes by


@dataclass
class Outcome:
    """What happened, in words; ended : the run's last state; shortfalls : all that is wrong."""

    happened: list[str] = field(default_factory=list)
    ended: str = ""
    shortfalls: list[str] = field(default_factory=list)


def run_a_cell(seed: int, folder: Path) -> Outcome:
    """One cell of its own; the same one for the same seed."""
    outcome = Outcome()
    virtual_time.run_in_virtual_time(_Cell(np.random.default_rng(seed), folder, outcome).main())
    return outcome


class _Cell:
    def __init__(self, rng: np.random.Generator, folder: Path, outcome: Outcome) -> None:
        self._rng, self._folder, self._outcome = rng, folder, outcome
        self._error: LmctlError | None = None
        self._safe = rng.random() < 0.6
        self._config = self._random_wires(
            BenchConfig.parse(shortened("bench-safe.toml" if self._safe else "bench.toml")))
        profile = folder / "cell.toml"
        profile.write_text(shortened("cell-safe.toml" if self._safe else "cell.toml"))
        self._profile = load_profile(profile)
        self._job = folder / "job.lmj"
        side_mm = float(rng.choice([4.0, 8.0, 12.0]))
        write_job(self._job, self._profile, squares(layers=2, per_layer=2, side_mm=side_mm))

    async def main(self) -> None:
        loop, rng = asyncio.get_running_loop(), self._rng
        async with Bench(self._config, ephemeral_ports=True) as bench:
            self._board = FaultInjector(bench)
            self._executor = RunExecutor(
                self._job, replace_endpoints(self._profile, bench.endpoints), self._folder / "runs")
            others = [asyncio.create_task(self._operate(loop.time()))]
            others += [asyncio.create_task(self._strike()) for _ in range(rng.integers(1, 4))]
            others += [asyncio.create_task(self._meddle()) for _ in range(rng.integers(0, 4))]
            try:
                async with asyncio.timeout(_LONGEST_S):
                    await self._executor.run()
            except LmctlError as error:
                self._error = error
                self._outcome.happened.append(f"ended: {error.what}")
            except TimeoutError:
                self._outcome.shortfalls.append("the run did not end")
            ended_s = loop.time()
            for other in others:
                other.cancel()
            for died in await asyncio.gather(*others, return_exceptions=True):
                if isinstance(died, Exception):
                    self._outcome.shortfalls.append(f"{died!r}")
            self._board.clear_all()
            await asyncio.sleep(40.0)
            self._outcome.ended = self._executor.state.value
            self._judge(bench, ended_s)

    # --- what happens -------------------------------------------------------------------------

    def _random_wires(self, config: BenchConfig) -> BenchConfig:
        """Some devices on ptys, and Grbl or grblHAL."""
        rng, motion = self._rng, config.motion
        addresses = {
            name: Address(pty=True) if rng.random() < 0.5 else address
            for name, address in config.addresses.items()
        }
        if rng.random() < 0.5:
            motion = replace(motion, dialect="grbl", rx_bytes=128, planner_blocks=15,
                             settings={**motion.settings, 10: 3})
        return replace(config, addresses=addresses, motion=motion)

    async def _strike(self) -> None:
        """One fault at some time, for some time."""
        fault, stands_s = self._random_fault(), float(self._rng.choice(_STAND_S))
        at_s = float(self._rng.uniform(0.5, _WITHIN_S))
        await asyncio.sleep(at_s)
        self._outcome.happened.append(f"{at_s:.2f} s: {fault} for {stands_s:g} s")
        number = self._board.inject(fault)
        await asyncio.sleep(stands_s)
        if fault.kind.is_lasting:
            self._board.clear(number)

    def _random_fault(self) -> Fault:
        rng = self._rng
        unwanted = [FaultTarget.HOST] if self._safe else [FaultTarget.HOST, FaultTarget.SAFETY]
        kinds = [kind for kind in FAULT_KINDS.values() if kind.target not in unwanted]
        kind = kinds[rng.integers(len(kinds))]
        values = {one.name: self._random_value(one) for one in kind.parameters
                  if one.default is None or rng.random() < 0.4}
        if kind.name == "panel_override":
            values["rapid"] = int(rng.choice([25, 50, 100]))
        device = ""
        if kind.target in (FaultTarget.LINK, FaultTarget.MODBUS, FaultTarget.FEEDER,
                           FaultTarget.HOPPER):
            there = ["F1", "F2"]
            if self._safe and kind.target in (FaultTarget.LINK, FaultTarget.MODBUS):
                there.append("safety")
            if kind.target is FaultTarget.LINK:
                there.append("motion")
            if kind.name == "half_open":  # of a serial line there is no such thing
                on_network = [one for one in there if not self._config.addresses[one].pty]
                if not on_network:
                    return Fault.create("device_silent", there[0])
                there = on_network
            device = str(rng.choice(there))
        return Fault.create(kind.name, device, **values)

    def _random_value(self, one: FaultParameter) -> ParameterValue:
        rng = self._rng
        if one.choices:
            return str(rng.choice(one.choices))
        if isinstance(one.default, bool):
            return bool(rng.random() < 0.5)
        usual = 100.0 if one.default is None else float(one.default)
        value = min(max(usual * float(rng.choice([0.0, 0.3, 1.0, 2.0, 5.0])), one.minimum),
                    one.maximum)
        return round(value) if one.is_integer or isinstance(one.default, int) else value

    async def _meddle(self) -> None:
        """One act of an operator, in place or not."""
        act = str(self._rng.choice(("hold", "resume", "override")))
        at_s, percent = float(self._rng.uniform(0.0, 25.0)), int(self._rng.integers(20, 200))
        await asyncio.sleep(at_s)
        self._outcome.happened.append(f"{at_s:.2f} s: {act}")
        try:
            if act == "override":
                self._executor.set_override(percent)
            else:
                getattr(self._executor, act)()
        except UsageError:
            pass  # told, and nothing done

    async def _operate(self, began_s: float) -> None:
        """Resumes what is held, again and again, and gives up in the end."""
        while True:
            await asyncio.sleep(_LOOKS_S)
            try:
                if asyncio.get_running_loop().time() - began_s > _PATIENCE_S:
                    self._executor.stop()
                elif self._executor.state is RunState.HELD:
                    self._executor.resume()
            except UsageError:
                pass  # what keeps it held is told

    # --- what must be so ----------------------------------------------------------------------

    def _judge(self, bench: Bench, ended_s: float) -> None:
        short, found, judge = self._outcome.shortfalls, judge_fault(bench), SafetyChecks(bench)
        if RunState(self._outcome.ended) not in FINAL_STATES:
            short.append(f"it was left {self._outcome.ended}")
        if found.beam_on_without_motion:
            short.append("the beam was on without motion")
        if found.powder_on:
            short.append(f"powder was left on: {', '.join(found.powder_on)}")
        # A controller that has lost its host runs dry within the send horizon.
        beam_off_by_s = ended_s + self._profile.motion.send_horizon_s + 0.2
        if any(beam_on.end_s > beam_off_by_s for beam_on in judge.beam_on_intervals()):
            short.append("the beam was on after the end")
        journal = journal_of_only_run(self._folder / "runs", self._error)
        check = verify_journal(journal)
        if not (check.intact and check.sealed):
            short.append("the journal is not whole")
        short += [record["what"] for record in read_records(journal)
                  if record["kind"] == "fault" and "internal error" in record["what"]]
        if self._outcome.ended == "done":
            self._judge_part(bench)

    def _judge_part(self, bench: Bench) -> None:
        with JobReader(self._job) as reader:
            lines = np.concatenate([layer.lines for layer in reader.iterate_layers()])
        beads = np.flatnonzero(lines["kind"] == LineKind.BEAD)
        path = bench.record.beam_on_path()
        missing = []
        for line in set(beads) - set(bench.motion.executed_line_numbers):
            ends_mm = np.array([[lines[axis][n] for axis in ("x_mm", "y_mm", "z_mm")]
                                for n in (line - 1, line)])
            # By place: a byte lost on the wire may have made another number of its own.
            laid_mm = path.length_mm[_between(path.position_mm, *ends_mm)].sum()
            # A hold may come to rest a motor step before a line's end: nothing is left to lay.
            if np.linalg.norm(ends_mm[1] - ends_mm[0]) - laid_mm > _NOTHING_MM:
                missing.append(line)
        if missing:
            self._outcome.shortfalls.append(f"done, and {len(missing)} beads were not laid")


def _between(places_mm: np.ndarray, begin_mm: np.ndarray, end_mm: np.ndarray) -> np.ndarray:
    """Which places (n, 3) lie on the straight line from begin to end."""
    length_mm = np.linalg.norm(end_mm - begin_mm)
    way = (end_mm - begin_mm) / length_mm
    along_mm = (places_mm - begin_mm) @ way
    off_mm = np.linalg.norm(places_mm - begin_mm - along_mm[:, None] * way, axis=1)
    return (off_mm < _NOTHING_MM) & (along_mm > 0.0) & (along_mm < length_mm)
