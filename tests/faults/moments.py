"""A link cut, a host killed, a controller restarted at a random moment, then recovered: what lies
on the part afterwards, by the simulators' trace alone.

Each seed is one part on one simulated cell in virtual time: Grbl or grblHAL, with or without homing
and a laser-enable output, disturbed once or twice. The operator of the test looks at the part (the
trace) when `recover` asks, to a tenth of a millimetre, and touches off where it says that the
controller has lost its place.

    python -m tests.faults.moments SEED ...
"""

from __future__ import annotations

import contextlib
import io
import random
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from lmctl.config.machine import MachineProfile, load_profile
from lmctl.errors import LmctlError
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from lmctl.run.executor import RunExecutor
from lmctl.run.journal.format import read_records
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.place import ProgramPlace
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.faults.disturbances import run_disturbed
from tests.faults.on_the_part import Deposit, OnThePart, measured
from tests.faults.recovering_operator import NothingLeftError, RecoveringOperator
from tests.part_files import block_file

EXAMPLES = files("lmctl.examples")

GRBL = {'"grblhal"': '"grbl"', "10 = 511": "10 = 3", "rx_bytes = 1024": "rx_bytes = 128",
        "planner_blocks = 100": "planner_blocks = 15"}

HOMING = "[motion.settings]\n20 = 1\n22 = 1\n24 = 600\n25 = 6000\n"
#: What may happen to a run. "restart" is a controller that loses power in it; "kill, restart" and
#: "cut, restart" one that does so before the operator recovers; "stop" and "hold" are harmless.
DISTURBANCES = (
    "kill", "cut", "mute", "restart", "kill, restart", "cut, restart", "stop", "hold",
)

#: Two layers, graded along their paths; 28 s of program.
PART = block_file((54, 49, 1.6), low_mm=(40, 40, 0), name="small graded block", composition="""
feature = { kind = "plane", point_mm = [40, 40, 0], normal = [1, 0, 0] }
[composition.profile]
kind = "linear"
near = { "316L" = 0.8, "WC-12Co" = 0.2 }
far = { "316L" = 0.3, "WC-12Co" = 0.7 }
over_mm = [0, 16]
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
""")

#: From the start of motion to the end of the part [s]; a later run is disturbed after its start.
_FIRST_S, _LATER_S = (0.0, 27.0), (0.0, 40.0)

#: One part in four is disturbed before its first bead [s after the start of its run].
_BEFORE_BEAD_S = (0.0, 12.0)


@dataclass(frozen=True)
class Scenario:
    """What one seed means.

    moments : (what happens, seconds after the start) of each disturbance
    is_before_bead : whether the first one counts from the start of its run, not of its motion
    """

    seed: int
    dialect: str
    has_laser_enable: bool
    has_homing: bool
    moments: tuple[tuple[str, float], ...]
    is_before_bead: bool = False

    def __str__(self) -> str:
        cell = ", ".join(filter(None, (
            self.dialect, self.has_homing and "homing", self.has_laser_enable and "laser-enable")))
        start = "from the start of the run: " if self.is_before_bead else ""
        return f"{self.seed} ({cell}): {start}" + ", then ".join(
            f"{what} at {at_s:.2f} s" for what, at_s in self.moments)


def scenario(seed: int) -> Scenario:
    rng = random.Random(seed)
    n = 1 if rng.random() < 0.7 else 2
    dialect, has_laser_enable = rng.choice(("grbl", "grblhal")), rng.random() < 0.5
    is_before_bead = seed % 4 == 3
    first_s = _BEFORE_BEAD_S if is_before_bead else _FIRST_S
    moments = tuple(
        (rng.choice(DISTURBANCES), rng.uniform(*(first_s if i == 0 else _LATER_S)))
        for i in range(n)
    )
    return Scenario(
        seed, dialect, has_laser_enable, rng.random() < 0.25, moments, is_before_bead)


@dataclass
class ScenarioResult:
    """What became of a scenario. refused : in words, what kept it from being recovered at all;
    asked : how often the operator had to look; lost : how often a position had to be restored;
    needless : of these, how often after a harmless stop
    """

    scenario: Scenario
    refused: str = ""
    asked: int = 0
    lost: int = 0
    needless: int = 0
    part: OnThePart | None = None


def run_scenario(one: Scenario, folder: Path) -> ScenarioResult:
    """One part, disturbed and recovered."""
    folder.mkdir(parents=True, exist_ok=True)
    profile, config = _cell(one)
    plan_job(load_part(_part_file(folder)), profile, folder / "job.lmj")
    results = ScenarioResult(one)
    with contextlib.redirect_stderr(io.StringIO()):
        virtual_time.run_in_virtual_time(_story(one, folder, profile, config, results))
    return results


def undisturbed(dialect: str, *, has_laser_enable: bool, folder: Path) -> Deposit:
    """What lies on the part when nothing happens to it."""
    results = run_scenario(Scenario(-1, dialect, has_laser_enable, False, ()), folder)
    assert results.part is not None, results.refused
    return results.part.deposit


def _part_file(folder: Path) -> Path:
    path = folder / "part.toml"
    path.write_text(PART)
    return path


def _cell(one: Scenario) -> tuple[MachineProfile, BenchConfig]:
    safe = "-safe" if one.has_laser_enable else ""
    text = (EXAMPLES / f"bench{safe}.toml").read_text()
    for old, new in GRBL.items() if one.dialect == "grbl" else ():
        assert old in text
        text = text.replace(old, new)
    if one.has_homing:
        text = text.replace("[motion.settings] ", f"{HOMING}#")
    return load_profile(EXAMPLES / f"cell{safe}.toml"), BenchConfig.parse(text)


async def _story(
    one: Scenario, folder: Path, profile: MachineProfile, config: BenchConfig,
    results: ScenarioResult
) -> None:
    async with Bench(config, ephemeral_ports=True) as bench:
        from lmctl.cli.bench import replace_endpoints

        cell = replace_endpoints(profile, bench.endpoints)
        operator = RecoveringOperator(
            bench, cell, folder / "job.lmj", has_homing=one.has_homing)
        if one.has_homing:
            await operator.home(folder / "runs")
        try:
            await _runs(one, folder, bench, cell, operator)
        except LmctlError as error:
            results.refused = error.render()
        except NothingLeftError:
            pass
        results.asked = operator.times_asked
        results.lost = operator.times_touched_off
        results.needless = operator.needless_touch_offs
        results.part = measured(bench, folder / "job.lmj", _entered(folder), operator.zero_mm)


def _entered(folder: Path) -> list[ProgramPlace]:
    """Where the part was entered again, by every journal."""
    return list({
        ProgramPlace(record["line"], record["share"])
        for journal in folder.glob("runs*/run-*/journal.jsonl")
        for record in read_records(journal) if record["kind"] == "entry"
    })


async def _runs(
    one: Scenario, folder: Path, bench: Bench, cell: MachineProfile, operator: RecoveringOperator
) -> None:
    """One run after the other, until the part is whole."""
    runs, continues = folder / "runs", None
    for number, (what, at_s) in enumerate(one.moments):
        runs = await run_disturbed(
            bench, cell, folder, runs, continues, what, at_s,
            in_motion=number == 0 and not one.is_before_bead)
        made = _last_run(runs)
        if made is None:
            break
        if _is_done(made):
            return
        is_harmless = what in ("stop", "hold")
        continues = await operator.recover(made, runs, harmless=is_harmless)
        if continues is None:
            await operator.make_ready(runs, harmless=is_harmless)
    await RunExecutor(folder / "job.lmj", cell, runs, continues=continues).run()


def _last_run(runs: Path) -> RunFolder | None:
    made = sorted(runs.glob("run-*")) if runs.exists() else []
    return RunFolder(made[-1]) if made and (made[-1] / "journal.jsonl").exists() else None


def _is_done(made: RunFolder) -> bool:
    from lmctl.run.journal.run_folders import run_summary

    return run_summary(made).state == "done"


def shortfalls(results: ScenarioResult, whole: Deposit) -> Iterator[str]:
    """What is wrong with a part, in words."""
    part = results.part
    if results.refused or part is None:
        yield f"not recovered: {results.refused}"
        return
    if part.off_path_mm > 0.1:
        yield f"deposited {part.off_path_mm:.2f} mm off the path"
    if part.missing_mm > 0:
        yield f"{part.missing_mm:.2f} mm missing"
    if part.repeated_mm > 0:
        yield f"{part.repeated_mm:.2f} mm deposited twice beyond the overlap"
    if results.needless:
        yield "a harmless stop was taken for a lost position"
    least, most = part.entry_deposit(whole)
    if not 0.9 <= least <= most <= 1.3:
        yield f"2 mm around an entry hold {least:.2f} to {most:.2f} of a whole bead"
    if (mixture := part.entry_mixture_error()) > 0.02:
        yield f"the mixture after an entry is off by {mixture:.3f}"


def main() -> int:
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        for seed in map(int, sys.argv[1:]):
            results = run_scenario(scenario(seed), Path(name) / str(seed))
            whole = undisturbed(
                results.scenario.dialect, has_laser_enable=results.scenario.has_laser_enable,
                folder=Path(name) / f"{seed}-whole")
            found = list(shortfalls(results, whole))
            wrong += bool(found)
            print(results.scenario, "->", "; ".join(found) or "well")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
