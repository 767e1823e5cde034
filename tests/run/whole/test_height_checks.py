"""A run held between layers for the height of the part, and the powder that follows from it."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lmctl.errors import LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.run.executor import EarlierRun, RunExecutor
from lmctl.run.journal.format import read_records
from lmctl.run.journal.recovery import find_recovery_place
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.run.whole.broken_off import seen
from tests.run.whole.conftest import EXAMPLES, wired


@pytest.fixture
def checked_job(tmp_path, profile, job_file):
    """Four layers of 0.5 mm, about 40 s, with a check after every two."""
    layers = job_file.squares(layers=4, per_layer=2, side_mm=8.0)
    job_file(tmp_path / "job.lmj", profile, layers, peaks={"height_check_every": 2})
    return tmp_path / "job.lmj"


def enter(height_mm):
    return lambda one: one.executor.enter_height(height_mm)


def refused_height(height_mm):
    def act(one):
        with pytest.raises(UsageError) as refusal:
            one.executor.enter_height(height_mm)
        one.refused.append(refusal.value.render())
    return act


def snapshot(one):
    one.held = one.executor.snapshot()


@pytest.fixture
def checked(run, checked_job):
    """Two layers came to 0.94 mm instead of 1.0: the next two need 1.06 / 0.94."""
    return run(checked_job, acts=[
        (2.0, refused_height(0.94)), (60.0, snapshot), (60.5, lambda one: one.resume_refused()),
        (61.0, refused_height(94.0)), (62.0, enter(0.94)),
        (63.0, lambda one: one.executor.resume()),
    ])


def test_a_run_is_held_at_the_end_of_a_layer_and_asks(checked):
    assert checked.error is None
    assert checked.result.state == "done"
    assert checked.held["state"] == "held"
    assert checked.held["held_by"] == "a height check"
    assert checked.held["next"][0]["command"] == "lmctl height MM"
    assert any("planned: 1.00 mm" in line for line in checked.notices)
    wrong, resumed, unit = checked.refused
    assert "cannot take a height now" in wrong
    assert "held for a height check" in resumed
    assert "not to be believed" in unit
    (place,) = [r for r in checked.records("place") if r["known"] != "unknown"][:1]
    assert place["known"] == "reported"
    checked.check_safe()


def test_every_path_is_deposited_once_and_none_is_broken_off(checked):
    executed = [record["path"] for record in checked.records("executed")]
    assert executed == list(range(8))
    (entry,) = checked.records("entry")
    assert (entry["layer"], entry["repeated_mm"]) == (2, 0.0)
    assert checked.path.length_mm.sum() == pytest.approx(4 * 2 * 4 * 8.0, abs=0.01)


def test_flow_at_the_nozzle_is_scaled_from_then_on_and_the_mixture_stays(checked):
    (record,) = checked.records("height")
    factor = min((2.0 - 0.94) / 0.94, 1.1)
    assert record["volume_factor"] == pytest.approx(factor, abs=1e-4)
    assert (record["layers"], record["height_mm"], record["planned_mm"]) == (2, 0.94, 1.0)
    assert (record["source"], record["at_limit"]) == ("entered", True)
    first = checked.path.position_mm[:, 2] < 1.2
    before, after = (checked.path.flow_g_s[side].mean(axis=0) for side in (first, ~first))
    assert after / before == pytest.approx(factor, rel=0.01)
    assert np.diff(after / before) == pytest.approx(0.0, abs=0.005)


def test_a_check_may_be_skipped(run, checked_job):
    one = run(checked_job, acts=[(60.0, enter(None)), (61.0, lambda one: one.executor.resume())])
    assert one.error is None
    (record,) = one.records("height")
    assert record["source"] == "not measured"
    flow = one.path.flow_g_s
    assert flow.min() == pytest.approx(flow.max(), rel=0.01)


def test_a_recovered_part_goes_on_with_the_powder_of_its_last_check(
    profile, checked_job, tmp_path
):
    runs = tmp_path / "runs"

    async def main():
        config = BenchConfig.parse((EXAMPLES / "bench.toml").read_text())
        async with Bench(config, ephemeral_ports=True) as bench:
            cell = wired(profile, bench.endpoints)
            first = RunExecutor(checked_job, cell, runs)
            task = asyncio.create_task(first.run())
            await first.height_awaited()
            assert first.state is RunState.HELD
            first.enter_height(0.96)
            first.stop()
            with pytest.raises(LmctlError, match="stopped by the operator"):
                await task
            made = RunFolder(runs / "run-0001")
            with JobReader(made.job) as job:
                found = find_recovery_place(
                    job, replay_run(made), seen(bench.motion.position_mm), profile)
            result = await RunExecutor(made.job, cell, runs, continues=EarlierRun(
                "run-0001", found.reached, is_position_trusted=not found.lost)).run()
            return result, bench.record.beam_on_path()

    result, path = virtual_time.run_in_virtual_time(main())
    (record,) = [r for r in read_records(result.journal) if r["kind"] == "height"]
    assert (record["source"], record["height_mm"]) == ("earlier run", 0.96)
    first = path.position_mm[:, 2] < 1.2
    before, after = (path.flow_g_s[side].mean(axis=0) for side in (first, ~first))
    assert after / before == pytest.approx((2.0 - 0.96) / 0.96, rel=0.01)
