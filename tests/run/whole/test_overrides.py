"""Feed overrides asked for at any moment of a run, and what may not be asked for."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lmctl.errors import UsageError
from lmctl.run.executor import RunExecutor
from lmctl.run.state.transitions import RunState
from tests.run.whole.conftest import BenchRun


class AskedIn(BenchRun):
    """acts : (state, seconds after it has been entered, callable(this))"""

    async def _act(self, acts):
        for state, after_s, act in acts:
            while self.executor.state is not state:  # noqa: ASYNC110 (it has no event)
                await asyncio.sleep(0.01)
            await asyncio.sleep(after_s)
            act(self)


def override(percent):
    return lambda one: one.executor.set_override(percent)


def hops(start_mm, beads=16, bead_mm=20.0, hop_s=0.1):
    """One layer of beads at 10 mm/s, joined by short dark moves."""
    x, y, z = start_mm
    rows = [("setup", start_mm, 0.0, -1, "G21 G90 G94"), ("setup", start_mm, 0.0, -1, "M4 S0"),
            ("lead", (x, y, z - 1.0), 0.2)]
    for path in range(beads):
        n = round(bead_mm / 10.0 / 0.25)
        for i in range(1, n + 1):
            share = i / n if path % 2 == 0 else 1.0 - i / n
            rows.append(("bead", (x + bead_mm * share, y, z - 1.0), 0.25, path))
        y += 2.0
        rows.append(("lead", (rows[-1][1][0], y, z - 1.0), hop_s))
    return [[*rows, ("setup", rows[-1][1], 0.0, -1, "M5")]]


def check_laid(one, percents, *, but_mm):
    """Powder per millimetre and speed: nothing but `but_mm` of bead is off by 10 %."""
    speed = one.path.length_mm / one.path.duration_s
    laid = one.path.volume_rate_mm3_s / speed
    off = (np.abs(laid / np.median(laid) - 1.0) > 0.1)
    assert one.path.length_mm[off].sum() < but_mm
    at = [one.path.length_mm[np.abs(speed / percent * 10.0 - 1.0) < 0.02].sum()
          for percent in percents]
    assert min(at) > 20.0
    assert sum(at) > 0.97 * one.path.length_mm.sum()


@pytest.mark.parametrize("after_s", [0.05, 1.0, 2.9])
def test_one_asked_for_while_powder_is_led_comes_in_the_run(
    tmp_path, profile, job_file, after_s
):
    """The beam is armed by then, with the override that was."""
    job_file(tmp_path / "job.lmj", profile, hops(profile.motion.purge_mm))
    one = AskedIn(tmp_path / "armed", profile, tmp_path / "job.lmj",
                  acts=[(RunState.ARMED, after_s, override(60))])
    one.check_safe()
    check_laid(one, [100, 60], but_mm=3.0)


@pytest.mark.parametrize("period_s", [0.2, 0.5])
@pytest.mark.parametrize("after_s", [3.0, 3.37, 3.71])
def test_one_comes_in_a_travel_however_short(
    run, tmp_path, profile, job_file, period_s, after_s
):
    """Between two reports, say, that lie before and after the travel."""
    motion = profile.motion.model_copy(update={"status_period_s": period_s})
    seldom = profile.model_copy(update={"motion": motion})
    job_file(tmp_path / "job.lmj", seldom, hops(profile.motion.purge_mm))
    one = run(tmp_path / "job.lmj", profile=seldom, acts=[(after_s, override(60))])
    one.check_safe()
    check_laid(one, [100, 60], but_mm=3.0)


def test_one_finds_powder_in_the_longest_bead(run, tmp_path, profile, job_file):
    """Without a travel in reach it is set when the powder sent for it is there."""
    (rows,) = hops(profile.motion.purge_mm, beads=5, bead_mm=190.0, hop_s=0.2)
    beads = [("bead", *row[1:]) if row[0] == "lead" else row for row in rows[3:]]
    job_file(tmp_path / "job.lmj", profile, [[*rows[:3], *beads]])
    one = run(tmp_path / "job.lmj", acts=[(2.0, override(60))])
    one.check_safe()
    check_laid(one, [100, 60], but_mm=8.0)


@pytest.mark.parametrize(("second", "after_s", "reached"), [
    (120, 0.5, [120, 100]),   # powder does not follow the first yet
    (100, 0.5, []),           # withdrawn
    (120, 4.0, [60, 120, 100]),  # powder follows it: it comes, then the second
    (100, 4.0, [60, 100]),
])
def test_the_last_word_counts_until_the_end_takes_it_back(
    run, tmp_path, profile, job_file, second, after_s, reached
):
    layers = hops(profile.motion.purge_mm, beads=8, bead_mm=60.0)
    job_file(tmp_path / "job.lmj", profile, layers)
    one = run(tmp_path / "job.lmj", acts=[(1.5, override(60)), (1.5 + after_s, override(second))])
    one.check_safe()
    assert [r["feed_percent"] for r in one.records("override") if r["source"] == "controller"] == (
        reached)
    check_laid(one, {100, *reached}, but_mm=8.0)

def test_one_beyond_what_the_laser_has_is_refused_before_anything_is_made(
    tmp_path, profile, job_file
):
    job_file(tmp_path / "job.lmj", profile, peaks={"peak_power_W": 2400.0})
    executor = RunExecutor(tmp_path / "job.lmj", profile, tmp_path / "runs")
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
        (RunState.FINISHING, 0.0, ask), (RunState.DONE, 0.0, ask)])
    assert refused == ["cannot override now: the run is finishing",
                       "cannot override now: the run is done"]
    assert one.records("override") == []
