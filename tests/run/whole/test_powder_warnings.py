"""Clogs, clipped set-points and warnings of feeders in whole runs, judged by the bench's record."""

from __future__ import annotations

import pytest

from lmctl.errors import RunStoppedError
from lmctl.report.run_record import read_run
from lmctl.run.journal.format import read_records, run_fingerprint
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder, list_runs
from lmctl.run.program.place import Known
from lmctl.run.state.transitions import Effect
from simulators.faults.fault_injector import FaultInjector
from simulators.faults.kinds import Fault
from simulators.safety_checks import SafetyChecks
from tests.run.whole.deposited import BEAM_OFF_S, OVERLAP_MM, acts, check_all_is_laid, laid_again_mm


def strike(kind, device, **values):
    def act(one):
        one.board = FaultInjector(one.bench)
        one.board.inject(Fault.create(kind, device, **values))

    return act


def mend(one):
    one.board.clear_all()


def resume(one):
    one.executor.resume()


def first_alarm(one):
    return one.records("alarm")[0]


#: Slow enough for the limit to be passed long before the nozzle is shut and the feeder minds.
CLOG = {"mbar": 900, "rise_s": 12.0, "share": 0.2}
LIMIT_PASSED_S = 12.0 * (200 - 40) / (900 - 40)


def test_a_clog_is_held_before_powder_minds_and_gone_on_with_when_it_has_cleared(
    run, profile, large_square_job, undisturbed
):
    seen = {}

    def look(one):
        judge = SafetyChecks(one.bench)
        seen["state"] = one.executor.state
        seen["powder"] = [name for name in one.bench.feeders if judge.is_powder_on(name)]
        seen["gas"] = [d.is_gas_flowing(one.loop.time()) for d in one.bench.feeders.values()]

    one = run(large_square_job, acts=[
        (3.0, strike("hose_clogs", "F1", **CLOG)), (14.0, look),
        (20.0, lambda r: r.resume_refused()), (30.0, mend), (35.0, resume),
    ])
    whole = undisturbed["large"]
    assert one.result.state == "done", one.error
    assert first_alarm(one)["name"] == "mixer pressure F1"
    assert "the mixer pressure is 3" in first_alarm(one)["what"]
    assert "200 mbar is allowed" in first_alarm(one)["what"]
    assert "clogged nozzle" in first_alarm(one)["hint"]
    period_s = profile.feeder[0].watchdog_s / 4
    held_by_s = one.started_s + 3.0 + LIMIT_PASSED_S + period_s + 1.0
    assert one.entered_s("holding") < held_by_s + 0.2 + 0.1
    assert one.entered_s("holding") > one.started_s + 3.0 + LIMIT_PASSED_S + 1.0
    assert seen == {"state": "held", "powder": [], "gas": [True, True]}
    assert [do for do in acts(one) if do.startswith(("feed hold", "powder off"))][:2] == [
        "feed hold", "powder off"]
    assert "cannot resume: feeder F1: the mixer pressure is 900 mbar" in one.refused[0]
    # No bead had less than its powder: the beam was dark before the nozzle shut.
    assert one.flow_error().max() < 0.02
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) == pytest.approx(OVERLAP_MM, abs=0.05)


def test_without_a_limit_the_feeder_s_own_alarm_is_the_second_line(
    run, profile, large_square_job
):
    bare = profile.model_copy(update={"feeder": tuple(
        feeder.model_copy(update={"mixer_pressure_max_mbar": None}) for feeder in profile.feeder)})
    one = run(large_square_job, profile=bare, acts=[
        (3.0, strike("hose_clogs", "F1", **CLOG)), (25.0, lambda r: r.executor.stop())])
    assert isinstance(one.error, RunStoppedError)
    assert first_alarm(one)["name"] == "feeder F1"
    assert "the mixer pressure is too high" in first_alarm(one)["what"]
    assert one.entered_s("holding") > one.started_s + 3.0 + 12.0 + 1.0
    # By then beads have had too little powder; and none, until the feeder was asked.
    assert len(one.bare_beam) == 1
    one.bare_beam = []
    one.check_safe()


def test_a_clog_that_the_feeder_does_not_notice_is_held_all_the_same(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, strike("hose_clogs", "F2", noticed=False)), (20.0, lambda r: r.executor.stop())])
    assert isinstance(one.error, RunStoppedError)
    assert first_alarm(one)["name"] == "mixer pressure F2"
    assert one.entered_s("holding") < one.started_s + 3.0 + 1.0 + 1.0 + 0.2 + BEAM_OFF_S
    one.check_safe()


def test_a_pressure_high_from_the_start_keeps_the_run_from_starting(
    run, profile, square_job, monkeypatch
):
    monkeypatch.setattr("simulators.feeder.readings._MIXER_MBAR_PER_L_MIN", 60)
    one = run(square_job)  # 240 mbar by gas alone
    assert "the mixer pressure is 240 mbar" in one.error.render()
    assert "armed" not in one.states
    assert len(one.path.time_s) == 0


def test_a_clipped_set_point_holds_before_the_wrong_mixture_is_deposited(
    run, large_square_job, undisturbed
):
    """Disc, weight and recipe number all agree with the device, which is not what was asked."""
    one = run(large_square_job, acts=[
        (3.0, strike("disc_limited", "F1", n_max_rpm=1.5)), (20.0, mend), (25.0, resume)])
    assert one.result.state == "done", one.error
    (alarm,) = one.records("alarm")
    assert alarm["name"] == "set-point F1"
    assert "was clipped: the mixture is not the one planned" in alarm["what"]
    assert one.entered_s("holding") < one.started_s + 3.0 + 1.0 + 0.2
    assert one.records("warning") == []  # it is not told twice
    # The hose is longer than the time it took to see it.
    assert one.flow_error().max() < 0.02
    one.check_safe()
    check_all_is_laid(one, undisturbed["large"])


def low(hopper="A"):
    return f"hopper {hopper} of feeder F1: the level is low"


def test_a_level_that_is_low_before_the_start_is_reported_before_anything_is_switched_on(
    run, square_job
):
    one = run(square_job, before=lambda r: r.bench.feeders["F1"].hoppers[1].process.set_remaining_g(
        r.loop.time(), 1500.0))
    assert one.result.state == "done"
    (warning,) = one.records("warning")
    assert warning == warning | {"feeder": "F1", "hopper": "A", "active": True, "number": 51}
    assert warning["what"] == f"{low()} (8 %, 1500 g left)"
    assert warning["hint"].startswith("fill it soon")
    kinds = [record["kind"] for record in read_records(one.journal)]
    doing = [record.get("do", "") for record in read_records(one.journal)]
    assert kinds.index("warning") < doing.index(Effect.GAS_ON)
    assert one.notices == [f"warning: {warning['what']}; what to do: {warning['hint']}"]


def test_a_warning_in_the_run_is_journaled_reported_shown_and_in_the_log(run, large_square_job):
    shown = []
    one = run(large_square_job, acts=[
        (3.0, strike("feeder_warns", "F2", of="drift")),
        (8.0, lambda r: shown.append(r.executor.snapshot()["warnings"])),
    ])
    assert one.result.state == "done"
    (warning,) = one.records("warning")
    assert "hopper B of feeder F2: the weighed flow differs" in warning["what"]
    assert [w["what"] for (w,) in shown] == [warning["what"]]
    assert shown[0][0].keys() == {"feeder", "hopper", "what", "hint"}
    log = read_run(one.journal)
    assert [event.text for event in log.events if "WARNING" in event.text] == [
        f"WARNING: {warning['what']}; what to do: {warning['hint']}"]
    assert "alarm" not in {record["kind"] for record in read_records(one.journal)}
    one.check_safe()


def test_a_warning_that_goes_is_over_after_a_minute_and_a_flickering_one_is_one(
    run, profile, job_file, tmp_path
):
    job_file(tmp_path / "long.lmj", profile, job_file.squares(6, per_layer=3, side_mm=12.0))

    def flicker(one):
        device, on = one.bench.feeders["F1"], {"bit": False}
        one.board = FaultInjector(one.bench)
        one.board.inject(Fault.create("feeder_warns", "F1", of="old calibration"))
        steady = device.defects.apply_overrides

        def notify(channel, values):
            return steady(channel, values) if on["bit"] else values

        device.defects.apply_overrides = notify
        for k in range(30):
            one.loop.call_later(0.7 * k, lambda k=k: on.update(bit=k % 2 == 0))

    shown = []
    one = run(tmp_path / "long.lmj", acts=[
        (2.0, flicker), (95.0, lambda r: shown.append(r.executor.snapshot()["warnings"]))])
    assert one.result.state == "done"
    assert [record["active"] for record in one.records("warning")] == [True, False]
    appeared, over = (record["t"] for record in one.records("warning"))
    assert 75.0 < over - appeared < 85.0
    assert shown == [[]]
    assert one.notices[-1].startswith("no longer: hopper A of feeder F1: its calibration is old")


def test_a_journal_with_warnings_can_be_recovered_from_and_listed(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, strike("feeder_warns", "F2", of="drift")), (9.0, lambda r: r.executor.stop())])
    assert isinstance(one.error, RunStoppedError)
    assert len(one.records("warning")) == 1
    after = replay_run(RunFolder(one.journal.parent))
    assert after.ended == "stopped"
    assert after.reached.known is Known.REPORTED
    assert after.proven_place.line > 0
    (listed,) = list_runs(one.journal.parent.parent)
    assert listed.state == "stopped"


def test_equal_runs_with_warnings_have_equal_fingerprints(run, large_square_job):
    def story():
        return run(large_square_job, acts=[
            (3.0, strike("feeder_warns", "F2", of="unsteady flow")), (6.0, mend)],
            before=lambda r: r.bench.feeders["F1"].hoppers[1].process.set_remaining_g(
                r.loop.time(), 1500.0))

    first, second = story(), story()
    assert [r["active"] for r in first.records("warning")] == [True, True]
    assert run_fingerprint(first.journal) == run_fingerprint(second.journal)
