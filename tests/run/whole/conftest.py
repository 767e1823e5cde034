"""Whole runs over TCP on a bench in virtual time. The simulators' own record is the judge."""

from __future__ import annotations

import asyncio
from importlib.resources import files

import numpy as np
import pytest

from lmctl.cli.bench import bench_of
from lmctl.config.machine import load_profile
from lmctl.errors import LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.run.executor import RunExecutor
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench_config import BenchConfig
from tests.run.only_run import journal_of_only_run

EXAMPLES = files("lmctl.examples")


@pytest.fixture(scope="session")
def profile():
    return load_profile(EXAMPLES / "cell.toml")


@pytest.fixture
def square_job(tmp_path, profile, job_file):
    """Two layers of two squares with sides of 4 mm, about 10 s."""
    job_file(tmp_path / "job.lmj", profile)
    return tmp_path / "job.lmj"


@pytest.fixture
def large_square_job(tmp_path, profile, job_file):
    """Two layers of three squares with sides of 12 mm, about 35 s."""
    layers = job_file.squares(layers=2, per_layer=3, side_mm=12.0)
    job_file(tmp_path / "job.lmj", profile, layers)
    return tmp_path / "job.lmj"


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory, profile, job_file):
    """What a run makes of `square_job` and of `large_square_job` if left alone; to look at only."""
    folder = tmp_path_factory.mktemp("undisturbed")
    job_file(folder / "small.lmj", profile)
    job_file(folder / "large.lmj", profile, job_file.squares(2, per_layer=3, side_mm=12.0))
    return {name: BenchRun(folder / name, profile, folder / f"{name}.lmj")
            for name in ("small", "large")}


@pytest.fixture(scope="session")
def whole(tmp_path_factory, profile, job_file):
    """An undisturbed run of three layers, to recover from and to compare with."""
    folder = tmp_path_factory.mktemp("recovery")
    job_file(folder / "job.lmj", profile, job_file.squares(layers=3, per_layer=2, side_mm=8.0))
    return BenchRun(folder, profile, folder / "job.lmj")


@pytest.fixture
def run(tmp_path, profile):
    """Runs a job on a bench of its own: run(job, bench=..., acts=..., override=...)."""

    def one_run(job, *, profile=profile, **options):
        folder = tmp_path / f"bench-{len(list(tmp_path.glob('bench-*')))}"
        return BenchRun(folder, profile, job, **options)

    return one_run


class BenchRun:
    """One run and what became of it: `result` or `error`, its journal, the bench's record.

    bench : replacements in the text of the example bench
    acts : (seconds after motion has started, callable(this)); before : called before the run
    notices : what was told of alarms and warnings; refused : of resumes that came too early
    """

    def __init__(self, folder, profile, job, *, bench=(), acts=(), before=None, override=100):
        text = (EXAMPLES / "bench.toml").read_text()
        for old, new in bench:
            assert old in text
            text = text.replace(old, new)
        self.job = job
        self.result = self.error = None
        self.notify = []
        self.notices = []
        self.refused = []
        self._before = before
        virtual_time.run_in_virtual_time(self._main(BenchConfig.parse(text), folder, profile, acts,
                                                    override))
        self.journal = journal_of_only_run(folder / "runs", self.error)

    async def _main(self, config, folder, profile, acts, override):
        self.loop = asyncio.get_running_loop()
        async with bench_of(config, profile) as self.bench:
            self.executor = RunExecutor(
                self.job, wired(profile, self.bench.endpoints), folder / "runs", operator="Ada",
                progress=lambda *notify: self.notify.append((self.loop.time(), *notify)),
                notice=self.notices.append,
            )
            if self._before is not None:
                self._before(self)
            if override != 100:
                self.executor.set_override(override)
            self.began_s = self.loop.time()
            self.task = asyncio.create_task(self.executor.run())
            acting = asyncio.create_task(self._act(acts))
            try:
                self.result = await self.task
            except LmctlError as error:
                self.error = error
            if acts:
                await acting
            else:
                acting.cancel()
            record = self.bench.record
            self.path = record.beam_on_path()
            self.standing_beam = record.beam_on_without_motion()
            self.bare_beam = record.beam_on_without_stable_powder()
            self.executed = [n for n in self.bench.motion.executed_line_numbers if n]
            self.position_mm = self.bench.motion.position_mm
            self.overruns = self.bench.motion.rx_overrun_bytes
            self.ended_s = self.loop.time()
            await asyncio.sleep(60.0)
            self.still_feeding = [
                name for name, device in self.bench.feeders.items() if device.spans[-1].end_s
                > self.ended_s
            ] if all(device.spans for device in self.bench.feeders.values()) else []

    async def _act(self, acts):
        while self.executor.state is not RunState.DEPOSITING:  # noqa: ASYNC110 (it has no event)
            await asyncio.sleep(0.01)
        self.started_s = self.loop.time()
        for at, act in acts:
            await asyncio.sleep(max(0.0, self.started_s + at - self.loop.time()))
            act(self)

    def resume_refused(self):
        """An act: resume, which must be refused."""
        with pytest.raises(UsageError) as refusal:
            self.executor.resume()
        self.refused.append(refusal.value.render())

    def records(self, kind):
        return [record for record in read_records(self.journal) if record["kind"] == kind]

    @property
    def states(self):
        return [record["to"] for record in self.records("state")]

    def entered_s(self, state):
        """Loop time at which a state was first entered."""
        return self.began_s + next(r["t"] for r in self.records("state") if r["to"] == state)

    def check_safe(self):
        """What must hold however a run ends."""
        assert len(self.standing_beam) == 0
        assert len(self.bare_beam) == 0
        assert self.overruns == 0
        assert self.still_feeding == []
        found = verify_journal(self.journal)
        assert found.intact
        assert found.sealed
        begun = {record["path"]: record["lines"] for record in self.records("path")}
        claimed = [record["path"] for record in self.records("executed")]
        assert claimed == sorted(set(claimed))
        executed = set(self.executed)
        for path in claimed:
            first, last = begun[path]
            assert set(range(first, last + 1)) <= executed
        for path, (first, last) in begun.items():  # journaled before its first line was sent
            beam_on = (self.path.line >= first) & (self.path.line <= last)
            reported_s = next(r["t"] for r in self.records("path") if r["path"] == path)
            assert (self.path.time_s[beam_on] > self.began_s + reported_s).all()

    def flow_error(self, rate=1.0):
        """(n,) error of the hoppers' flow along the beam's path, worst of both over the mean."""
        with JobReader(self.job) as job:
            layers = list(job.iterate_layers())
        flow_s = np.concatenate([layer.flow_s for layer in layers])
        flow = np.concatenate([layer.flow_g_s for layer in layers])
        end_s = np.concatenate([layer.lines["end_s"] for layer in layers])
        start_s = np.concatenate([[0.0], end_s[:-1]])
        line, duration_s = self.path.line, self.path.duration_s
        share = np.empty(len(line))
        for n in np.unique(line):
            pieces = np.flatnonzero(line == n)
            done_s = np.cumsum(duration_s[pieces])
            share[pieces] = (done_s - duration_s[pieces] / 2) / done_s[-1]
        s = start_s[line] + share * (end_s - start_s)[line]
        wanted = rate * np.column_stack([np.interp(s, flow_s, flow[:, h]) for h in range(2)])
        return np.abs(self.path.flow_g_s - wanted).max(axis=1) / wanted.mean()


def wired(profile, endpoints):
    """The profile at the bench's endpoints; one that the bench lacks stays as it is."""
    def at(device, name):
        return device and device.model_copy(update={"endpoint": endpoints.get(name,
                                                                              device.endpoint)})

    return profile.model_copy(update={
        "motion": at(profile.motion, "motion"), "safety": at(profile.safety, "safety"),
        "scale": at(profile.scale, "scale"),
        "feeder": tuple(at(feeder, feeder.name) for feeder in profile.feeder),
    })
