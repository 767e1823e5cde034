"""Feed overrides asked for at any moment of a run, and what may not be asked for."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import UsageError
from lmctl.run.executor import Executor
from lmctl.run.state.table import State
from tests.run.whole.conftest import BenchRun


class AskedIn(BenchRun):
    """acts : (state, seconds after it has been entered, callable(this))"""

    async def _act(self, acts):
        for state, after_s, act in acts:
            while self.executor.state is not state:  # noqa: ASYNC110 (it has no event)
                await asyncio.sleep(0.01)
            await asyncio.sleep(after_s)
            act(self)


def overrides(percent):
    return lambda one: one.executor.set_override(percent)


def test_one_beyond_what_the_laser_has_is_refused_before_anything_is_made(
    tmp_path, profile, job_file
):
    job_file(tmp_path / "job.lmj", profile, peaks={"peak_power_W": 2400.0})
    executor = Executor(tmp_path / "job.lmj", profile, tmp_path / "runs")
    executor.set_override(140)
    with pytest.raises(UsageError, match="140 % is not possible") as refused:
        asyncio.run(executor.run())
    assert refused.value.where == ("the job asks for 2400 W, and the laser has 3000",)
    assert refused.value.hint == "give 50 to 125"
    assert not (tmp_path / "runs").exists()


def test_one_beyond_what_a_hopper_delivers_is_refused_in_the_run(run, tmp_path, profile, job_file):
    refused = []

    def ask(one):
        one.executor.set_override(120)
        with pytest.raises(UsageError) as error:
            one.executor.set_override(121)
        refused.append(str(error.value.where))

    job_file(tmp_path / "job.lmj", profile, peaks={"peak_flow_g_min": {"A": 6.0, "B": 50.0}})
    one = run(tmp_path / "job.lmj", acts=[(0.5, ask)])
    assert one.result.state == "done"
    assert "50.0 g/min of hopper B, which delivers 60" in refused[0]
    assert [r["feed_percent"] for r in one.records("override") if r["source"] == "operator"] == [
        120]


def test_one_after_the_last_bead_is_refused_and_leaves_nothing_behind(
    tmp_path, profile, square_job
):
    refused = []

    def ask(one):
        with pytest.raises(UsageError) as error:
            one.executor.set_override(60)
        refused.append(error.value.what)

    one = AskedIn(tmp_path / "late", profile, square_job, acts=[
        (State.FINISHING, 0.0, ask), (State.DONE, 0.0, ask)])
    assert refused == ["cannot override now: the run is finishing",
                       "cannot override now: the run is done"]
    assert one.records("override") == []
