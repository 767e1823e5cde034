"""Going on after a run that was stopped or broken off: what the journal proves, and where the
machine stands. (Hosts killed for good are in tests/faults/test_kills.py.)"""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lmctl.errors import JournalError, LmctlError
from lmctl.job.reader import JobReader
from lmctl.run.executor import EarlierRun, RunExecutor
from lmctl.run.journal.format import read_records
from lmctl.run.journal.recovery import find_recovery_place
from lmctl.run.journal.replay import continuing_runs, replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.program.place import JOB_START, Known
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from simulators.fault_outcome import judge_fault
from tests.run.whole.broken_off import broken_off, seen
from tests.run.whole.conftest import EXAMPLES, wired

HORIZON_S, SPEED_MM_S, OVERLAP_MM = 1.0, 10.0, 0.15


def bead_between_mm(whole, place, time_s):
    """Bead drawn by the undisturbed run between a place and a moment; negative: place is later."""
    path = whole.path
    with JobReader(whole.job) as job:
        lines = np.concatenate([layer.lines for layer in job.iterate_layers()])
    done = 0.0
    for n in range(place.line):
        done += path.length_mm[path.line == n].sum()
    here = path.line == place.line
    done += place.line_fraction * path.length_mm[here].sum()
    assert len(lines) > place.line
    return path.length_mm[path.time_s <= time_s].sum() - done


def test_wherever_a_journal_breaks_off_the_machine_s_place_counts_or_all_that_was_sent_is_in_doubt(
    whole, profile, tmp_path
):
    records = list(read_records(whole.journal))
    end = next(i for i, r in enumerate(records) if r.get("to") == RunState.FINISHING)
    laying = [i for i, r in enumerate(records[:end]) if whole.started_s < whole.began_s + r["t"]]
    rng = np.random.default_rng(7)
    for cut in rng.choice(laying[:-8], 40, replace=False).tolist():
        made = broken_off(tmp_path / "run-0001", whole, cut)
        # The machine has run on, no farther than it was sent, and stands on a bead.
        t = whole.began_s + records[cut - 1]["t"]
        after = replay_run(made)
        ends = np.flatnonzero((whole.path.time_s >= t) & (whole.path.line <= after.sent_line))
        if not len(ends):
            continue
        at = int(rng.choice(ends))
        with JobReader(made.job) as job:
            known = find_recovery_place(job, after, seen(whole.path.position_mm[at]), profile)
            blind = find_recovery_place(job, after, seen(None), profile)
        time_s = whole.path.time_s[at]
        assert known.lost == ""
        assert known.reached.known is Known.REPORTED
        assert abs(bead_between_mm(whole, known.reached.place, time_s)) < 0.15, (cut, known)
        assert blind.lost
        least_mm, most_mm = (bead_between_mm(whole, place, time_s)
                             for place in (blind.reached.place, blind.reached.until))
        assert -0.15 < least_mm < 2 * HORIZON_S * SPEED_MM_S, (cut, blind)
        assert most_mm < 0.15, (cut, blind)


def test_before_anything_was_begun_it_starts_from_the_beginning(whole, profile, tmp_path):
    for records in (0, 1, 6):
        made = broken_off(tmp_path / "run-0001", whole, records)
        with JobReader(made.job) as job:
            found = find_recovery_place(job, replay_run(made), seen((1.0, 2.0, 3.0)), profile)
            assert found.reached.place == JOB_START


def test_a_run_that_is_done_or_altered_is_refused(whole, tmp_path):
    with pytest.raises(JournalError, match="is done"):
        replay_run(RunFolder(whole.journal.parent))
    made = broken_off(tmp_path / "run-0001", whole, 30)
    data = bytearray(made.journal.read_bytes())
    data[len(data) // 2] ^= 1
    made.journal.write_bytes(bytes(data))
    with pytest.raises(JournalError, match="not what was written"):
        replay_run(made)


class TwoRuns:
    """A run that ends badly, and the one that goes on with it, on one bench."""

    def __init__(self, folder, profile, job, disturb):
        self.error = self.second_error = self.result = None
        self.notify = []  # progress of the second
        virtual_time.run_in_virtual_time(self._main(folder, profile, job, disturb))

    async def _main(self, folder, profile, job, disturb):
        config = BenchConfig.parse((EXAMPLES / "bench.toml").read_text())
        async with Bench(config, ephemeral_ports=True) as bench:
            self.bench = bench
            cell = wired(profile, bench.endpoints)
            first = RunExecutor(job, cell, folder / "runs")
            task = asyncio.create_task(first.run())
            while first.state is not RunState.DEPOSITING:  # noqa: ASYNC110
                await asyncio.sleep(0.01)
            await asyncio.sleep(4.0)
            disturb(first, bench)
            try:
                await task
            except LmctlError as error:
                self.error = error
            self.made = RunFolder(folder / "runs" / "run-0001")
            position = bench.motion.position_mm
            with JobReader(self.made.job) as reader:
                self.found = find_recovery_place(reader, replay_run(self.made), seen(position),
                                                 profile)
            going_on = EarlierRun(
                "run-0001", self.found.reached, is_position_trusted=not self.found.lost,
                standstill_mm=position)
            try:
                self.result = await RunExecutor(
                    self.made.job, cell, folder / "runs", continues=going_on,
                    progress=lambda *notify: self.notify.append(notify)).run()
            except LmctlError as error:
                self.second_error = error
            self.path = bench.record.beam_on_path()
            self.verdict = judge_fault(bench)


def test_a_stopped_run_is_recovered_where_it_stood(whole, profile, tmp_path):
    two = TwoRuns(tmp_path, profile, whole.job, lambda run, bench: run.stop())
    assert two.error.exit_code == 5
    assert "lmctl recover run-0001" in two.error.hint
    assert two.found.lost == ""
    assert two.found.reached.known is Known.REPORTED
    assert two.result.state == "done"
    assert two.verdict.safety_shortfalls(1e9) == []
    assert two.verdict.repeated_mm == pytest.approx(OVERLAP_MM, abs=0.1)
    assert two.path.length_mm.sum() == pytest.approx(
        whole.path.length_mm.sum() + OVERLAP_MM, abs=0.2)
    assert set(two.path.line) == set(whole.path.line)
    assert continuing_runs(two.made) == ("run-0002", [])
    header = next(read_records(two.result.journal))
    assert header["continues"] == "run-0001"
    (first_s, end_s, _, left_s), *_ = two.notify  # before it has done anything
    assert first_s > 2.0
    assert left_s == pytest.approx(end_s - first_s)


def test_after_a_watchdog_trip_recovery_acknowledges_it(whole, profile, tmp_path):
    """The feeder was left in alarm, as after a dead host: recovering is the deliberate act."""

    def cut(run, bench):
        bench.feeders["F1"].trip_watchdog()
        asyncio.get_running_loop().call_later(3.0, run.stop)

    two = TwoRuns(tmp_path, profile, whole.job, cut)
    assert "watchdog" in two.error.render()
    assert two.result is not None, two.second_error
    assert two.result.state == "done"
    assert set(two.path.line) == set(whole.path.line)


def test_a_machine_that_lost_its_place_is_not_believed(whole, profile, tmp_path):
    two = TwoRuns(tmp_path, profile, whole.job, lambda run, bench: bench.motion.receive(b"\x18"))
    # It was reset in motion: what it says of itself proves nothing, wherever it seems to stand.
    assert "position lost" in two.found.lost
    assert next(r for r in read_records(two.made.journal) if r["kind"] == "seal")[
        "position_trusted"] is False
