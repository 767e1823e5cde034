"""Runs that reach their end: what was planned is what was executed, with powder in time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lmctl.errors import UsageError
from lmctl.job.reader import JobReader
from lmctl.run.journal.format import run_fingerprint
from lmctl.run.journal.run_folders import list_runs
from tests.run.whole.conftest import BenchRun


def planned(job_path):
    """N words of the lines that move, all lines, and the end position."""
    with JobReader(job_path) as job:
        layers = list(job.iterate_layers())
    at, moving = (10.0, 10.0, 20.0), []
    for layer in layers:
        for number, row in enumerate(layer.lines, start=layer.first_line):
            end = (row["x_mm"], row["y_mm"], row["z_mm"])
            if end != at:
                moving.append(number)
            at = end
    return moving, number + 1, at


def test_a_dry_run_executes_the_plan(run, square_job):
    one = run(square_job)
    moving, lines, end_mm = planned(square_job)
    assert one.result.state == "done"
    assert one.result.lines == lines
    assert one.executed == [n for n in moving if n]
    assert one.position_mm == pytest.approx(end_mm, abs=0.005)
    assert one.path.length_mm.sum() == pytest.approx(64.0, abs=0.01)
    assert one.result.warnings == ()
    one.check_safe()
    assert one.states == [
        "connecting", "checking", "gas", "powder", "armed", "depositing", "finishing", "done"
    ]


def test_dwells_in_small_pieces_take_the_time_planned(run, tmp_path, profile, job_file):
    """The next piece is always there as one ends: nothing is waited for that was not planned."""
    layers = job_file.squares(layers=1, per_layer=1)
    at = next(i for i, row in enumerate(layers[0]) if row[0] == "bead")
    place = layers[0][at - 1][1]
    layers[0][at:at] = [("dwell", place, 0.25, -1, "G4 P0.25")] * 80
    job_file(tmp_path / "job.lmj", profile, layers)
    one = run(tmp_path / "job.lmj")
    blocks = one.bench.motion.trace.blocks()
    first = int(np.flatnonzero(blocks.line == at + 80)[0])
    assert blocks.start_s[first] - blocks.end_s[first - 1] == pytest.approx(20.0, abs=0.02)


def test_the_journal_shows_what_was_run_and_how_it_ended(run, profile, square_job):
    one = run(square_job)
    (header,), (machine,), (seal,) = (one.records(k) for k in ("header", "machine", "seal"))
    with JobReader(square_job) as job:
        assert header["job"] == job.digest
    assert header["operator"] == "Ada"
    assert [h["material"] for h in header["hoppers"]] == ["316L", "WC-12Co"]
    assert (machine["dialect"], machine["is_bench"]) == ("grblhal", True)
    assert (seal["state"], seal["lines"]) == ("done", one.result.lines)
    assert seal["t"] == pytest.approx(one.result.machine_s)
    assert [r["path"] for r in one.records("executed")] == [0, 1, 2, 3]
    assert [r["reported"]["path_mm"] for r in one.records("layer")] == [32.0, 32.0]
    samples = one.records("samples")
    columns = ("at", "line", "x_mm", "y_mm", "z_mm", "feed_mm_min", "s_word")
    for batch in samples:
        flows = [*batch["set_g_min"].values(), *batch["flow_g_min"].values(),
                 *batch["carrier_L_min"].values()]
        assert {len(batch[c]) for c in columns} == {len(flow) for flow in flows} == {
            len(batch["at"])
        }
    assert min(samples[len(samples) // 2]["carrier_L_min"]["A"]) > 1.0
    at = [t for batch in samples for t in batch["at"]]
    assert at == sorted(at)
    assert max(np.diff(at)) < profile.motion.status_period_s + 0.01
    (summary,) = list_runs(one.journal.parent.parent)
    assert (summary.state, summary.part, summary.lines) == ("done", "test", one.result.lines)


def test_powder_accounted_for_is_the_powder_fed(run, square_job):
    one = run(square_job)
    counted = sum(
        grams for fed_g in [
            *(record["reported"]["powder_g"] for record in one.records("layer")),
            *(record["fed_g"] for record in one.records("purge")),
        ] for grams in fed_g.values()
    )
    fed = sum(one.bench.record.fed_g().values())
    assert counted == pytest.approx(fed, rel=0.02)


@pytest.mark.parametrize("bench", [
    [('dialect = "grblhal"', 'dialect = "grbl"'), ("rx_bytes = 1024", "rx_bytes = 128"),
     ("planner_blocks = 100", "planner_blocks = 15"), ("10 = 511", "10 = 3")],
    [("rx_bytes = 1024", "rx_bytes = 128")],
    [("10 = 511", "10 = 7")],
])
def test_both_dialects_small_buffers_and_sparse_reports(run, square_job, bench):
    one = run(square_job, bench=bench)
    assert one.result.state == "done"
    _, lines, end_mm = planned(square_job)
    assert one.result.lines == lines
    assert one.position_mm == pytest.approx(end_mm, abs=0.005)
    assert one.path.length_mm.sum() == pytest.approx(64.0, abs=0.01)
    assert one.overruns == 0
    assert len(one.standing_beam) == len(one.bare_beam) == 0


def test_the_same_job_gives_the_same_journal(run, square_job):
    runs = [run(square_job) for _ in range(5)]
    assert len({run_fingerprint(one.journal) for one in runs}) == 1
    assert len({one.journal.read_bytes() for one in runs}) == 5  # wall clock and ports differ


def test_led_powder_is_right_on_the_beam_s_path_and_unled_is_not(
    run, tmp_path, profile, job_file
):
    layers = job_file.squares(layers=2, per_layer=3, side_mm=12.0)
    swing = [(float(s), (0.1 + 0.04 * math.sin(s / 3), 0.1 - 0.04 * math.sin(s / 3)))
             for s in np.arange(0, 100, 0.25)]
    errors = {}
    for mode in ("lead", "none"):
        job_file(tmp_path / f"{mode}.lmj", profile, layers, flow=swing, mode=mode)
        one = run(tmp_path / f"{mode}.lmj")
        one.check_safe()
        errors[mode] = one.flow_error()
    # The times of this job leave out acceleration, a tenth of it: lead looks ahead a little wrong.
    assert np.quantile(errors["lead"], 0.95) < 0.05
    assert np.quantile(errors["none"], 0.5) > 0.2


def test_powder_led_through_a_wait_is_there_when_the_wait_is_over(
    run, tmp_path, profile, job_file
):
    """A dwell is answered when it is over; until then the clock must not stand."""
    (rows, *_) = layers = job_file.squares(layers=1, per_layer=3, side_mm=12.0)
    second = next(i for i, row in enumerate(rows) if row[3] == 1)
    rows.insert(second, ("dwell", rows[second - 1][1], 6.0, -1))
    begins_s = sum(row[2] for row in rows[:second])
    job_file(tmp_path / "job.lmj", profile, layers, mode="lead", flow=[
        (0.0, (0.05, 0.15)), (begins_s, (0.05, 0.15)), (begins_s + 5.0, (0.15, 0.05)),
        (100.0, (0.15, 0.05)),
    ])
    one = run(tmp_path / "job.lmj")
    one.check_safe()
    assert one.result.state == "done", one.error
    assert one.records("alarm") == []
    assert one.path.time_s.max() - one.path.time_s.min() > 20.0  # the wait, and beads on both sides
    assert np.quantile(one.flow_error(), 0.99) < 0.02


@pytest.mark.parametrize("percent", [60, 140])
def test_an_override_from_the_start_scales_speed_beam_and_powder(run, large_square_job, percent):
    one = run(large_square_job, override=percent)
    one.check_safe()
    speed = one.path.length_mm / one.path.duration_s
    assert np.median(speed) == pytest.approx(percent / 10, rel=0.01)
    assert np.median(one.path.power_fraction) == pytest.approx(0.5 * percent / 100, rel=0.01)
    assert np.quantile(one.flow_error(percent / 100), 0.95) < 0.01
    assert [r["feed_percent"] for r in one.records("override")] == [percent, percent, 100]


def test_an_override_in_the_run_waits_for_a_travel_and_for_powder(run, large_square_job):
    one = run(large_square_job, acts=[(2.0, lambda r: r.executor.set_override(60))])
    one.check_safe()
    asked, reported, taken_back = one.records("override")
    assert taken_back["feed_percent"] == 100  # at the end
    assert (asked["source"], reported["source"]) == ("operator", "controller")
    assert reported["t"] - asked["t"] >= 3.0
    with JobReader(large_square_job) as job:
        path_of = np.concatenate([layer.lines["path"] for layer in job.iterate_layers()])
    speed = one.path.length_mm / one.path.duration_s
    changed_s = one.began_s + reported["t"]
    for path in range(6):  # none is drawn at two speeds, and powder comes at each one's rate
        on_it = path_of[one.path.line] == path
        percent = 100 if one.path.time_s[on_it].min() < changed_s else 60
        assert np.median(speed[on_it]) == pytest.approx(percent / 10, rel=0.02)
        error = np.abs(one.path.flow_g_s[on_it].sum(axis=1) / (0.2 * percent / 100) - 1)
        assert np.quantile(error, 0.95) < 0.02
    assert one.path.time_s.min() < changed_s < one.path.time_s.max()


def test_overrides_left_at_the_panel_before_the_run_are_taken_back(square_job, profile, tmp_path):
    class Turned(BenchRun):
        async def _act(self, acts):
            self.bench.motion.set_overrides(60, 50, 40)

    one = Turned(tmp_path / "turned", profile, square_job, acts=["turn"])
    assert one.result.state == "done", one.error
    one.check_safe()
    assert np.median(one.path.power_fraction) == pytest.approx(0.5)
    assert np.median(one.path.length_mm / one.path.duration_s) == pytest.approx(10.0)


def test_power_turned_at_the_panel_is_journaled_and_no_damage(run, large_square_job):
    one = run(large_square_job, acts=[(3.0, lambda r: r.bench.motion.set_overrides(100, 100, 80))])
    assert one.result.state == "done", one.error
    assert one.records("alarm") == []
    assert [(r["feed_percent"], r["power_percent"]) for r in one.records("override")] == [(100, 80)]
    later = one.path.time_s > one.started_s + 5.0
    assert np.median(one.path.power_fraction[later]) == pytest.approx(0.4)


def test_remaining_time_is_right_within_5_percent_after_the_first_layer(run, large_square_job):
    one = run(large_square_job)
    end_s = one.entered_s("finishing")
    (first, _) = one.records("layer")
    later = [notify for notify in one.notify if notify[0] > one.began_s + first["t"]]
    assert len(later) > 5
    for now_s, done_s, total_s, layer, remaining_s in later:
        assert layer == 1
        assert 0.0 < done_s <= total_s
        assert remaining_s == pytest.approx(end_s - now_s, rel=0.05, abs=0.5)


def test_what_an_operator_may_not_ask_is_refused_and_does_no_harm(run, square_job):
    refused = []

    def ask(what):
        def act(one):
            with pytest.raises(UsageError) as error:
                what(one.executor)
            refused.append(error.value.what)

        return act

    one = run(square_job, acts=[
        (0.5, ask(lambda executor: executor.resume())),
        (0.6, ask(lambda executor: executor.set_override(30))),
    ])
    assert one.result.state == "done"
    assert refused == ["cannot resume now: the run is depositing",
                       "a feed override of 30 % is not possible"]


def test_a_machine_that_is_not_the_bench_gets_no_power(run, square_job, monkeypatch):
    monkeypatch.setattr("lmctl.machine.motion.identity.BENCH_INFO", "some other bench")
    one = run(square_job)
    assert one.result.state == "done"
    assert len(one.path.length_mm) == 0
    assert one.result.lines == planned(square_job)[1]
    assert "every power was sent as S0" in one.result.warnings[0]
    (seal,) = one.records("seal")
    assert seal["warnings"] == list(one.result.warnings)
    assert not one.records("machine")[0]["is_bench"]


def test_a_least_power_that_melts_nothing_keeps_no_run_from_starting(run, square_job):
    assert run(square_job, bench=[("32 = 1", "32 = 1\n31 = 10")]).result.state == "done"


@pytest.mark.parametrize(("bench", "reason"), [
    ([("30 = 1000", "30 = 255")], "full power is S255"),
    ([("32 = 1", "32 = 0")], "laser mode is off"),
    ([("32 = 1", "32 = 1\n31 = 11")], "least power: $31=11"),
    ([("10 = 511", "10 = 1")], "neither Ln: nor Bf:"),
])
def test_a_controller_set_wrongly_is_refused_untouched(run, square_job, bench, reason):
    one = run(square_job, bench=bench)
    text = one.error.render()
    assert reason in text
    assert "journal" in text
    assert one.error.exit_code == 4
    assert one.states[-1] == "faulted"
    assert one.executed == []
    assert one.bench.record.fed_g() == {"316L": 0.0, "WC-12Co": 0.0}


@pytest.mark.parametrize("period_s", [0.1, 0.25, 0.5])
class TestHoweverOftenTheControllerIsAsked:
    """Lines go with the next question, or at once where questions are far between."""

    @pytest.fixture
    def profile(self, profile, period_s):
        motion = profile.motion.model_copy(update={"status_period_s": period_s})
        return profile.model_copy(update={"motion": motion})

    def test_motion_never_waits_for_lines(self, run, large_square_job):
        one = run(large_square_job)
        assert one.result.state == "done"
        blocks = one.bench.motion.trace.blocks()
        own = blocks.line > 0
        gaps_s = blocks.start_s[own][1:] - blocks.end_s[own][:-1]
        assert gaps_s.max() == pytest.approx(0.0, abs=1e-6)
