"""Random parts that are held, resumed, stopped, killed and recovered; and what was executed.

The judge is the simulated cell's own record: its trace of motion and beam, and what left its
hoppers. It knows layers only by the N words of the lines.
"""

from __future__ import annotations

import asyncio
import shutil
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from firmware_protocol.dialect import GRBL, GRBLHAL
from lmctl.cli.bench import replace_endpoints
from lmctl.config.machine import load_profile
from lmctl.errors import JournalError, LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.part.load import load_part
from lmctl.plan.planner import plan_job
from lmctl.report.part_record import PartRecord, part_record_of
from lmctl.run.execution.unreported_motion import journal_unreported_motion
from lmctl.run.executor import EarlierRun, RunExecutor
from lmctl.run.journal.recovery import find_recovery_place, refuse_finished
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder, run_names
from lmctl.run.program.place import Known, known_place
from lmctl.run.state.transitions import FINAL_STATES, RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.part_files import block_file
from tests.run.whole.broken_off import seen

EXAMPLES = files("lmctl.examples")

#: N words of lines that bring the nozzle to the place where the part is entered again.
_WAY_IN = 9_990_000

#: A run ends within so much of the loop's time, however often it is held [s].
_LONGEST_S = 3000.0

#: A composition along `feature`; braces are doubled for `str.format`.
COMPOSITION = """
feature = {feature}
profile = {{ kind = "linear", near = {{ "316L" = {near}, "WC-12Co" = {near_rest} }}, \
far = {{ "316L" = {far}, "WC-12Co" = {far_rest} }}, over_mm = [0, {over}] }}
"""


@dataclass
class RecordedPart:
    """A part and its judge. happened : what was done to it, in words

    truth : {layer from 1: {quantity: value}} by the cell's record; record : what the log prints
    """

    seed: int
    happened: list[str] = field(default_factory=list)
    truth: dict[int, dict[str, float]] = field(default_factory=dict)
    record: PartRecord | None = None

    def errors(self) -> dict[tuple[int, str], float]:
        """Relative difference of every figure of every row; infinite where a row is missing."""
        rows = {row.number: row.executed for row in self.record.layers}
        found = {}
        for layer, quantities in self.truth.items():
            for name, true in quantities.items():
                if layer not in rows:
                    found[layer, name] = float("inf")
                    continue
                row = rows[layer]
                said = row.powder_g[name] if name in row.powder_g else getattr(row, name)
                found[layer, name] = abs(said - true) / true
        return found

    @property
    def missing_layers(self) -> list[int]:
        """Layers in which the beam was on and that have no row."""
        return sorted(set(self.truth) - {row.number for row in self.record.layers})


def record_part(seed: int, folder: Path) -> RecordedPart:
    """Make one part; the same one for the same seed."""
    part = RecordedPart(seed)
    virtual_time.run_in_virtual_time(_Making(part, folder).main())
    return part


class _Making:
    def __init__(self, part: RecordedPart, folder: Path) -> None:
        self._part, self._folder = part, folder
        self._rng = rng = np.random.default_rng(part.seed)
        safe = rng.random() < 0.5
        config = BenchConfig.parse(
            (EXAMPLES / ("bench-safe.toml" if safe else "bench.toml")).read_text())
        if rng.random() < 0.5:
            motion = config.motion
            config = replace(config, motion=replace(
                motion, dialect="grbl", rx_bytes=128, planner_blocks=15,
                settings={**motion.settings, 10: 3}))
        self._config = config
        self._profile = load_profile(EXAMPLES / ("cell-safe.toml" if safe else "cell.toml"))
        self._job = folder / "part.lmj"
        self._write_job()
        self._powder: dict[str, list[tuple[float, float]]] = {}

    def _write_job(self) -> None:
        """A small block of two or three layers, graded along its length or in rings."""
        rng = self._rng
        side_mm = [round(float(rng.uniform(*span)), 1) for span in ((14.0, 26.0), (9.0, 18.0))]
        near, far = (round(float(share), 2) for share in rng.uniform(0.1, 0.9, 2))
        feature = rng.choice(['{ kind = "coordinate", along = "x" }', '{ kind = "surface" }'])
        high_mm = [*side_mm, 0.8 * int(rng.integers(2, 4))]
        composition = COMPOSITION.format(
            feature=feature, near=near, near_rest=round(1.0 - near, 2), far=far,
            far_rest=round(1.0 - far, 2),
            over=side_mm[0] if "x" in feature else 4.0)
        part_file = self._folder / "part.toml"
        part_file.write_text(block_file(high_mm, composition, name="graded block"))
        plan_job(load_part(part_file), self._profile, self._job)
        with JobReader(self._job) as job:
            self._lines = [(entry.first_line, entry.n_lines) for entry in job.manifest.layers]
            self._full_W = job.manifest.max_power_W
            self._program_s = job.manifest.layers[-1].end_s

    async def main(self) -> None:
        self._loop = asyncio.get_running_loop()
        async with Bench(self._config, ephemeral_ports=True) as bench:
            self._bench = bench
            self._cell = replace_endpoints(self._profile, bench.endpoints)
            self._watch_powder()
            continues = None
            for number in range(self._rng.integers(1, 4)):
                last = number == 3
                ended = await self._one_run(continues, to_the_end=last)
                if ended == "done":
                    break
                continues = self._continuation()
                if continues is None:
                    break
            else:
                if ended != "done":
                    await self._one_run(continues, to_the_end=True)
            await asyncio.sleep(30.0)
            self._judge()
        runs = self._folder / "runs"
        self._part.record = part_record_of(runs / run_names(runs)[-1] / "journal.jsonl")

    # --- what is done to it -------------------------------------------------------------------

    async def _one_run(self, continues: EarlierRun | None, *, to_the_end: bool) -> str:
        runs = self._folder / "runs"
        run = RunExecutor(self._job, self._cell, runs, operator="Ada", continues=continues)
        acts: list[Callable[[RunExecutor], object]] = [self._hold, self._panel_hold, self._override]
        task = asyncio.create_task(run.run())
        acting = asyncio.create_task(self._act(run, acts, to_the_end))
        try:
            async with asyncio.timeout(_LONGEST_S):
                await task
        except LmctlError as error:
            self._part.happened.append(f"ended: {error.what}")
        acting.cancel()
        (died,) = await asyncio.gather(acting, return_exceptions=True)
        if isinstance(died, Exception):
            raise died
        if hasattr(self, "_snapshot"):
            shutil.rmtree(runs)
            shutil.move(self._snapshot, runs)
            del self._snapshot
            await asyncio.sleep(float(self._rng.uniform(5.0, 60.0)))
            return "killed"
        return run.state.value

    async def _act(self, run: RunExecutor, acts: list[Callable], to_the_end: bool) -> None:
        rng = self._rng
        for _ in range(int(rng.integers(0, 3))):
            await self._until(run, RunState.DEPOSITING)
            await asyncio.sleep(float(rng.uniform(0.2, self._program_s / 2)))
            if run.state is not RunState.DEPOSITING:
                continue
            await acts[rng.integers(len(acts))](run)
        await self._until(run, RunState.DEPOSITING)
        await asyncio.sleep(float(rng.uniform(0.2, self._program_s)))
        if to_the_end or run.state is not RunState.DEPOSITING:
            return
        if rng.random() < 0.5:
            self._note("stop")
            if rng.random() < 0.5:
                run.hold()
                await self._until(run, RunState.HELD)
            run.stop()
        else:
            self._kill(run)

    async def _hold(self, run: RunExecutor) -> None:
        self._note("hold")
        run.hold()
        await self._resume(run)

    async def _panel_hold(self, run: RunExecutor) -> None:
        self._note("hold at the panel")
        self._bench.motion.receive(b"!")
        await self._resume(run)

    async def _override(self, run: RunExecutor) -> None:
        percent = int(self._rng.choice([60, 80, 110, 130]))
        self._note(f"override {percent} %")
        run.set_override(percent)

    async def _resume(self, run: RunExecutor) -> None:
        await self._until(run, RunState.HELD)
        await asyncio.sleep(float(self._rng.uniform(1.0, 20.0)))
        try:
            run.resume()
        except UsageError as error:
            raise AssertionError(f"seed {self._part.seed}: {error.render()}") from error

    def _kill(self, run: RunExecutor) -> None:
        """What a killed host leaves: its files as they are, and every connection closed."""
        self._note("host killed")
        self._snapshot = self._folder / "killed"
        shutil.copytree(self._folder / "runs", self._snapshot,
                        ignore=shutil.ignore_patterns("*.sock"))
        cell = run._live.sequence._cell
        cell.motion.close_at_once() if hasattr(cell.motion, "close_at_once") else None
        asyncio.ensure_future(cell.motion.close())  # noqa: RUF006
        for device in (*cell.feeders, *filter(None, [cell.safety])):
            asyncio.ensure_future(_link_of(device).close())  # noqa: RUF006

    async def _until(self, run: RunExecutor, state: RunState) -> None:
        while run.state not in (state, *FINAL_STATES):  # noqa: ASYNC110 (it has no event)
            await asyncio.sleep(0.05)

    def _note(self, what: str) -> None:
        self._part.happened.append(f"{self._loop.time():.2f} s: {what}")

    def _continuation(self) -> EarlierRun | None:
        """As `lmctl recover` finds it; None where no bead is left."""
        runs = self._folder / "runs"
        made = RunFolder(runs / run_names(runs)[-1])
        with JobReader(made.job) as job:
            after = replay_run(made)
            dialect = GRBLHAL if self._bench.config.motion.dialect == "grblhal" else GRBL
            found = find_recovery_place(
                job, after, seen(self._bench.motion.position_mm, dialect=dialect), self._profile)
            reached = found.reached
            if reached.is_doubtful:  # a controller that is not stopped executes all it has buffered
                reached = known_place(reached.until, Known.STATED)
            try:
                refuse_finished(job, after, reached.place, self._profile.motion)
            except JournalError:
                journal_unreported_motion(job, made, reached)
                return None
        return EarlierRun(made.run, reached, is_position_trusted=not found.lost)

    # --- what was really executed -------------------------------------------------------------

    def _watch_powder(self) -> None:
        """Note what each hopper has fed whenever its flow changes; in between it is steady."""
        names = {(h.feeder, h.channel): h.name for h in self._profile.hopper}
        for feeder, device in self._bench.feeders.items():
            for hopper in device.hoppers.values():
                process = hopper.process
                knots = self._powder.setdefault(names[feeder, process.config.channel], [])
                self._spy(process, knots)

    @staticmethod
    def _spy(process, knots: list[tuple[float, float]]) -> None:
        command = process.command_rpm

        def noted(time_s: float, rpm: float, ramp_s: float = 0.0) -> None:
            assert ramp_s == 0.0
            command(time_s, rpm, ramp_s)
            knots.append((time_s, process.fed_g(time_s)))

        process.command_rpm = noted

    def _judge(self) -> None:
        path = self._bench.record.beam_on_path()
        layer_of = np.array([self._layer_of(int(line)) for line in path.line])
        for layer in sorted(set(layer_of.tolist()) - {0}):
            here = layer_of == layer
            self._part.truth[layer] = {
                "path_mm": float(path.length_mm[here].sum()),
                "beam_s": float(path.duration_s[here].sum()),
                "energy_J": float(
                    (path.power_fraction[here] * path.duration_s[here]).sum() * self._full_W),
            }
        for feeder in self._bench.feeders.values():
            now_s = feeder.advance_to_now()
        for name, knots in self._powder.items():
            times, fed = np.array(knots).T
            for layer, begin_s, end_s in self._windows():
                beam_s = path.time_s[(path.time_s >= begin_s) & (path.time_s <= end_s)]
                if len(beam_s):
                    begin_s = beam_s[0]
                    grams = np.interp([begin_s, end_s], [*times, now_s], [*fed, fed[-1]])
                    layers = self._part.truth[layer]
                    layers[name] = layers.get(name, 0.0) + float(grams[1] - grams[0])

    def _layer_of(self, line: int) -> int:
        """Number of the layer that holds a line of the job; 0 for other lines."""
        if not 0 < line < _WAY_IN:
            return 0
        return bisect_right([first for first, _ in self._lines], line)

    def _windows(self) -> list[tuple[int, float, float]]:
        """From when to when motion was in a layer, each time it was; ways in count."""
        blocks = self._bench.motion.trace.blocks()
        windows: list[list[float]] = []
        last = -1  # layer of the block before, 0 outside the program
        for line, begin_s, end_s in zip(
            blocks.line.tolist(), blocks.start_s.tolist(), blocks.end_s.tolist(), strict=True
        ):
            layer = None if line >= _WAY_IN else self._layer_of(line)  # None: of the layer to come
            if layer == 0:
                last = 0
                continue
            if layer == last or (last is None and layer):
                windows[-1][2] = end_s
            else:
                windows.append([layer, begin_s, end_s])
            if layer is not None:
                for window in windows:
                    window[0] = layer if window[0] is None else window[0]
            last = layer
        return [(int(layer), begin_s, end_s) for layer, begin_s, end_s in windows]


def _link_of(device):
    return device._link
