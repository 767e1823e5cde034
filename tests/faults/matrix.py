"""Every fault in every state of a run, in virtual time, judged by the simulators' own record.

For each: the beam is off within 100 ms of the fault being visible to the host, powder stops, the
journal is whole, the right alarm comes first, and the run can be resumed or recovered, or says why
not. Prints a Markdown table; exits 1 if one falls short.

    python -m tests.faults.matrix [KIND …]
"""

from __future__ import annotations

import asyncio
import re
import shutil
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.errors import LmctlError, UsageError
from lmctl.run.executor import RunExecutor
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.fault_outcome import FaultOutcome, judge_fault
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import FAULT_KINDS, ExpectedReaction, Fault, FaultTarget
from tests.faults.expected import EXPECTED, LASTS_S, SEEN_WITHIN_S, UNSEEN
from tests.faults.kills import shortened
from tests.run.only_run import journal_of_only_run

#: From an alarm to beam off [s]: the most that is allowed.
BEAM_OFF_WITHIN_S = 0.1

#: States in which something can go wrong, in the order in which a run comes to them. (Connecting
#: and checking take no machine time; there a device that fails is one that does not answer.)
STATES = (
    RunState.GAS, RunState.POWDER, RunState.ARMED, RunState.DEPOSITING, RunState.HOLDING,
    RunState.HELD, RunState.REFILLING, RunState.PURGING, RunState.RESUMING, RunState.STOPPING,
    RunState.FINISHING,
)
#: The hopper that is refilled, what is poured into it, and how long that takes [s].
_HOPPER, _LOT, _MASS_G, _POURING_S = "A", "LOT-1", 10.0, 2.0
_HOLD_AT_S, _MOST_S = 1.0, 400.0
_LOOK_S = 0.005


@dataclass
class Cell:
    """What became of one fault in one state."""

    fault: Fault
    state: RunState
    came: bool = False
    headline: str = ""
    followed: tuple[str, ...] = ()
    seen_s: float | None = None
    beam_off_s: float = 0.0
    end: str = ""
    shortfalls: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        if not self.came:
            return "–"
        return ("**" + "; ".join(self.shortfalls) + "**") if self.shortfalls else self.end


class Trial:
    """One run of a small job, into which one fault is put."""

    def __init__(self, fault: Fault, state: RunState, job: Path, folder: Path) -> None:
        self.cell = Cell(fault, state)
        self._job, self._folder = job, folder
        self._error: LmctlError | None = None
        self._final = ""

    async def main(self) -> None:
        self._loop = asyncio.get_running_loop()
        config = BenchConfig.parse(shortened("bench-safe.toml"))
        async with Bench(config, ephemeral_ports=True) as bench:
            profile = replace_endpoints(load_profile(self._folder / "cell.toml"), bench.endpoints)
            self._board = FaultInjector(bench)
            self._executor = RunExecutor(self._job, profile, self._folder / "runs")
            self._began_s = self._loop.time()
            running = asyncio.create_task(self._executor.run())
            operator = asyncio.create_task(self._operate())
            try:
                async with asyncio.timeout(_MOST_S):
                    await running
            except LmctlError as error:
                self._error = error
            except TimeoutError:
                self.cell.shortfalls.append("the run did not end")
            operator.cancel()
            self._final = self._executor.state.value
            self._board.clear_all()
            await asyncio.sleep(5.0)
            since_s = self._board.injected[0].at_s if self._board.injected else self._began_s
            self._judge(judge_fault(bench, since_s))

    # --- the operator and the fault -----------------------------------------------------------

    async def _operate(self) -> None:
        await self._bring_to(self.cell.state)
        self._board.inject(self.cell.fault)
        self.cell.came = True
        await asyncio.sleep(LASTS_S.get(self.cell.fault.kind.name, LASTS_S["default"]))
        self._board.clear_all()
        await asyncio.sleep(3.0)
        while True:
            if self._executor.state is RunState.REFILLING:
                self._executor.refill(_HOPPER, _LOT, _MASS_G)
                await asyncio.sleep(_POURING_S)
            if self._executor.state is RunState.HELD:
                self._read_headline()
                try:
                    self._executor.resume()
                except UsageError as error:
                    self.cell.end = f"held: {error.what}"
                    self._executor.stop()
                await asyncio.sleep(40.0)
                if self._executor.state is RunState.HELD:
                    self._executor.stop()
            await asyncio.sleep(0.5)

    def _read_headline(self) -> None:
        """What an operator sees first, before anything is acknowledged."""
        alarms = self._executor.snapshot()["alarms"]
        if alarms and not self.cell.headline:
            self.cell.headline, *followed = [one["what"] for one in alarms]
            self.cell.followed = tuple(followed)

    async def _bring_to(self, state: RunState) -> None:
        if state in (RunState.HOLDING, RunState.HELD, RunState.PURGING, RunState.RESUMING,
                     RunState.STOPPING):
            await self._until(RunState.DEPOSITING)
            await asyncio.sleep(_HOLD_AT_S)
            (self._executor.stop if state is RunState.STOPPING else self._executor.hold)()
        if state is RunState.REFILLING:
            await self._until(RunState.DEPOSITING)
            self._executor.refill(_HOPPER)
        if state in (RunState.PURGING, RunState.RESUMING):
            await self._until(RunState.HELD)
            await asyncio.sleep(0.5)
            self._executor.resume()
        await self._until(state)
        if state is RunState.DEPOSITING:
            await asyncio.sleep(_HOLD_AT_S)

    async def _until(self, state: RunState) -> None:
        while self._executor.state is not state:  # noqa: ASYNC110 (states have no event)
            await asyncio.sleep(_LOOK_S)

    # --- the judge ----------------------------------------------------------------------------

    def _judge(self, found: FaultOutcome) -> None:
        cell = self.cell
        if not cell.came:
            return
        journal = journal_of_only_run(self._folder / "runs", self._error)
        check = verify_journal(journal)
        if not (check.intact and check.sealed):
            cell.shortfalls.append("the journal is not whole")
        records = list(read_records(journal))
        injected_s = found.since_s - self._began_s
        troubles = [r for r in records if r["kind"] in ("alarm", "fault") and r["t"] >= injected_s]
        if troubles:
            cell.seen_s = troubles[0]["t"] - injected_s
        cell.beam_off_s = found.beam_off_after_s
        seal = records[-1] if records[-1]["kind"] == "seal" else {}
        if troubles and not cell.headline:
            cause = seal.get("cause") or troubles[0]
            cell.headline, cell.followed = cause["what"], tuple(seal.get("followed", ()))
        self._judge_answer(troubles, found)
        if not cell.end:
            cell.end = self._final
        if self._final not in ("done",):
            laid = any(r.get("to") == RunState.FINISHING for r in records)
            cell.end += (", can be recovered" if seal.get("recoverable")
                         else ", all laid" if laid else ", to be begun anew")

    def _judge_answer(self, troubles: list[dict], found: FaultOutcome) -> None:
        cell, kind = self.cell, self.cell.fault.kind
        allowed_s = SEEN_WITHIN_S.get(kind.name, SEEN_WITHIN_S["default"])
        seen_s = cell.seen_s
        laying = cell.state is RunState.DEPOSITING
        if (
            kind.expected_reaction is ExpectedReaction.STOP and kind.name not in UNSEEN
            and laying and seen_s is None and self._final == "done"
        ):
            cell.shortfalls.append("nothing was noticed")
        if kind.expected_reaction is ExpectedReaction.CONTINUE and seen_s is not None:
            cell.shortfalls.append(f"held for nothing: {cell.headline}")
        if kind.expected_reaction is ExpectedReaction.CONTINUE and troubles:
            cell.shortfalls.append(f"was to be ridden out: {cell.headline}")
        elif seen_s is not None:
            if laying and seen_s > allowed_s + BEAM_OFF_WITHIN_S:
                cell.shortfalls.append(f"seen only after {seen_s:.2f} s")
            words = EXPECTED[kind.name]
            if not re.search(words, cell.headline, re.IGNORECASE):
                cell.shortfalls.append(f"headline: {cell.headline}")
        host_stops = seen_s is not None and self._final != "done"
        within_s = seen_s + BEAM_OFF_WITHIN_S if host_stops and seen_s is not None else _MOST_S
        grace_s = (seen_s or 0.0) + BEAM_OFF_WITHIN_S
        if kind.name in UNSEEN and seen_s is None:
            cell.end = f"{self._final}, not seen"
            grace_s = _MOST_S
        cell.shortfalls += found.safety_shortfalls(within_s, grace_s)
        if found.rx_overrun_bytes:
            cell.shortfalls.append("bytes were lost")


def try_one(fault: Fault, state: RunState, folder: Path, job: Path) -> Cell:
    """One fault in one state."""
    here = folder / f"{fault}-{state}".replace("/", "-")
    here.mkdir()
    shutil.copyfile(job.parent / "cell.toml", here / "cell.toml")
    trial = Trial(fault, state, job, here)
    virtual_time.run_in_virtual_time(trial.main())
    return trial.cell


def faults_of(name: str) -> list[Fault]:
    """One fault of a kind for each sort of device it may strike."""
    kind = FAULT_KINDS[name]
    values = {"grams": 100.0} if name == "hopper_level" else {}
    if name == "laser_enable_stuck":
        return [Fault.create(name, contact=how) for how in ("closed", "as it is")]
    if name == "hose_clogs":  # at once, as the feeder itself notices, and slowly, as the host does
        return [Fault.create(name, "F1"), Fault.create(name, "F1", rise_s=3.0)]
    if name == "modbus_exception":  # a refusal, and a lost answer of a gateway
        return [Fault.create(name, device, **how) for how in ({}, {"code": 11})
                for device in ("F1", "safety")]
    if name == "word_garbled":
        return [Fault.create(name, letter=letter, percent=percent) for letter, percent in (
            ("S", 10.0), ("S", 200.0), ("F", 30.0), ("F", 300.0), ("X", 97.0))]
    if kind.target is FaultTarget.LINK:
        return [Fault.create(name, device, **values) for device in ("motion", "F1", "safety")]
    if kind.target is FaultTarget.MODBUS:
        return [Fault.create(name, device, **values) for device in ("F1", "safety")]
    if kind.target in (FaultTarget.FEEDER, FaultTarget.HOPPER):
        return [Fault.create(name, "F1", **values)]
    return [] if kind.target is FaultTarget.HOST else [Fault.create(name, **values)]


def write_job(folder: Path) -> Path:
    """Two layers of two squares: four seconds of program."""
    from tests.run.conftest import squares
    from tests.run.conftest import write_job as write

    (folder / "cell.toml").write_text(shortened("cell-safe.toml"))
    job = folder / "job.lmj"
    write(job, load_profile(folder / "cell.toml"), squares(layers=2, per_layer=2, side_mm=8.0))
    return job


def main() -> int:
    from tests.faults.freshness import stamp

    names, rows = sys.argv[1:] or list(FAULT_KINDS), []
    shown = [state.value for state in STATES]
    print("# Every fault in every state of a run\n\nMade by `make faults`: small job, cell-safe "
          "and bench-safe, short delays, virtual time. *Seen, beam off*:\nfrom the fault to the "
          "first alarm and to beam off during deposition. A fault lasts 10 s (a stuck\n"
          "contact 30); then an operator tries to resume. The cell says how the run ended.\n")
    print("| fault | seen, beam off [s] | " + " | ".join(shown) + " |")
    print("| --- " * (len(shown) + 2) + "|")
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        job = write_job(folder)
        for fault in (fault for kind in names for fault in faults_of(kind)):
            cells = [try_one(fault, state, folder, job) for state in STATES]
            laying = cells[STATES.index(RunState.DEPOSITING)]
            seen = "–" if laying.seen_s is None else f"{laying.seen_s:.2f}"
            rows.append(f"| {fault} | {seen}, {laying.beam_off_s:.2f} | "
                        + " | ".join(cell.text for cell in cells) + " |")
            print(rows[-1], flush=True)
            short = [cell for cell in cells if cell.shortfalls]
            wrong += len(short)
            if short:
                print(f"{fault} fell short in {', '.join(cell.state.value for cell in short)}; "
                      f"to repeat: python -m tests.faults.matrix {fault.kind.name}",
                      file=sys.stderr)
    print(f"\n{stamp(rows)}\n\n{wrong} fell short")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
