"""Runs that are held, stopped or fail: beam and motion first, then powder, then gas."""

from __future__ import annotations

import errno
import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest

from lmctl.errors import MachineError, RunBrokenOff, RunFailed, RunStopped, UsageError
from lmctl.run.journal_file import verify

#: Beam off within so much of a feed hold [s]: the controller's step buffer, then slowing down.
BEAM_OFF_S = 0.13

#: Bead laid twice where a path is entered again, and how exact places are [mm].
OVERLAP_MM, EXACT_MM = 3.0, 0.1


def acts(one):
    return [record["do"] for record in one.records("act")]


def laid_again_mm(one, whole):
    return one.path.length_mm.sum() - whole.path.length_mm.sum()


def check_all_is_laid(one, whole):
    """Every bead that an undisturbed run lays, by line and by length."""
    assert set(one.path.line) == set(whole.path.line)
    for line in set(whole.path.line):
        mine, wanted = (p.length_mm[p.line == line].sum() for p in (one.path, whole.path))
        assert mine > wanted - EXACT_MM


def test_a_hold_keeps_the_place_and_the_beam_returns_with_overlap_through_fresh_powder(
    run, large_square_job
):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (50.0, lambda r: r.executor.resume()),
    ])
    whole = run(large_square_job)
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) == pytest.approx(OVERLAP_MM, abs=EXACT_MM)
    (entry,) = one.records("entry")
    assert entry["repeated_mm"] == pytest.approx(OVERLAP_MM)
    assert one.entered_s("resuming") - one.entered_s("purging") >= 7.0  # θ + 4τ of hopper A
    dark = np.argmax(np.diff(one.path.time_s))
    assert one.path.time_s[dark] < one.started_s + 3.0 + BEAM_OFF_S
    assert one.path.time_s[dark + 1] >= one.entered_s("resuming")
    # The nozzle gives what it should from the first moment on.
    assert one.path.flow_g_s[dark + 1] == pytest.approx(0.1, rel=0.02)


def test_a_held_cell_feeds_no_powder_and_its_controller_holds_no_motion(run, large_square_job):
    seen = {}

    def look(one):
        seen["state"] = one.executor.state
        seen["feeding"] = [d.spans[-1].end_s > one.loop.time() for d in one.bench.feeders.values()]
        seen["at"] = one.bench.motion.position_mm
        one.bench.motion.receive(b"~")  # somebody presses cycle start at its panel

    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (8.0, look),
        (10.0, lambda r: seen.update(then=r.bench.motion.position_mm)),
        (12.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    one.check_safe()
    assert seen["state"] == "held"
    assert seen["feeding"] == [False, False]
    assert seen["then"] == seen["at"]


def test_powder_is_purged_beside_the_part(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (12.0, lambda r: r.executor.resume()),
        (20.0, lambda r: setattr(r, "purging_at", r.bench.motion.position_mm)),
    ])
    assert one.result.state == "done"
    assert one.purging_at == pytest.approx(one.executor._profile.motion.purge_mm, abs=0.01)


@pytest.mark.parametrize("at_s", [0.5, 1.1, 1.7, 2.3, 2.9, 3.7, 4.4])
def test_held_anywhere_the_part_is_made_whole(run, square_job, at_s):
    one = run(square_job, acts=[
        (at_s, lambda r: r.executor.state == "depositing" and r.executor.hold()),
        (at_s + 5.0, lambda r: r.executor.state == "held" and r.executor.resume()),
    ])
    whole = run(square_job)
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    assert -EXACT_MM < laid_again_mm(one, whole) < OVERLAP_MM + EXACT_MM
    layers = [record["layer"] for record in one.records("layer")]
    assert layers == [record["layer"] for record in whole.records("layer")]


def test_held_twice_in_the_overlap_the_first_place_counts(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (8.0, lambda r: r.executor.resume()),
        (32.0, lambda r: r.executor.state == "depositing" and r.executor.hold()),
        (40.0, lambda r: r.executor.state == "held" and r.executor.resume()),
    ])
    whole = run(large_square_job)
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    places = [(r["line"], r["share"]) for r in one.records("place")]
    assert places == sorted(places)


def stop(one):
    one.executor.stop()


def test_nobody_comes_to_a_held_run(run, large_square_job, monkeypatch):
    monkeypatch.setattr("lmctl.run.sequence.HELD_AT_MOST_S", 100.0)
    one = run(large_square_job, acts=[(3.0, lambda r: r.executor.hold())])
    assert isinstance(one.error, RunStopped)
    assert "lmctl recover" in one.error.hint
    assert one.entered_s("stopping") - one.entered_s("held") == pytest.approx(100.0, abs=0.1)
    one.check_safe()


def test_a_hold_while_purging_holds_again(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (8.0, lambda r: r.executor.resume()),
        (12.0, lambda r: r.executor.hold()), (20.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    one.check_safe()
    assert one.states.count("held") == 2
    assert one.states.count("resuming") == 1


def interrupt(one):
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("how", [
    lambda r: r.executor.stop(), lambda r: r.task.cancel(), interrupt,
    lambda r: signal.raise_signal(signal.SIGTERM),
], ids=["stop", "cancel", "ctrl-c", "terminate"])
def test_a_stop_is_orderly_and_says_where(run, large_square_job, how):
    one = run(large_square_job, acts=[(3.0, how)])
    assert isinstance(one.error, RunStopped)
    assert one.error.exit_code == 5
    text = one.error.render()
    assert "layer 1, program line" in text
    assert "journal.jsonl" in text
    one.check_safe()
    assert one.states[-2:] == ["stopping", "stopped"]
    assert acts(one)[-3:] == ["beam and motion off", "powder off", "post-flow, gas off"]
    assert one.path.time_s.max() < one.started_s + 3.0 + BEAM_OFF_S
    assert one.ended_s - one.entered_s("stopping") > 10.0  # post-flow


@pytest.mark.parametrize("how", [lambda r: r.executor.stop(), interrupt], ids=["stop", "ctrl-c"])
def test_a_second_stop_skips_the_post_flow(run, large_square_job, how):
    one = run(large_square_job, acts=[(3.0, how), (4.0, how)])
    assert isinstance(one.error, RunStopped)
    one.check_safe()
    assert acts(one)[-3:] == ["beam and motion off", "powder off", "gas off"]
    assert one.ended_s - one.entered_s("stopping") < 5.0


def test_a_stop_in_a_hold_is_a_stop(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (10.0, lambda r: r.executor.stop()),
    ])
    assert isinstance(one.error, RunStopped)
    one.check_safe()


def reboot(one):
    """Another host's 0x18 in the middle of the stream: to this host the controller restarts."""
    one.bench.motion.receive(b"\x18")


def deafen(one):
    """The wire to the controller breaks; what it says still arrives."""
    one.bench.motion.receive = lambda data: None


def silence(one):
    one.bench.motion.detach()


def estop_chain(one):
    one.bench.feeders["F1"].open_estop_chain(True)


def feeder_restarts(one):
    one.bench.feeders["F2"].restart()


def feeder_to_local(one):
    one.bench.feeders["F1"].turn_local(True)


#: What happens, in how many cycles of its feeder the host can know, and what it must say.
INTERLOCKS = {
    "estop": (estop_chain, 1, "emergency"),
    "feeder restarts": (feeder_restarts, 5, "feeder F2"),
}


def test_a_feeder_that_cannot_be_stopped_is_said_so(run, large_square_job):
    """At LOCAL a feeder takes no orders: its powder is for the people at its panel."""
    one = run(large_square_job, acts=[(3.0, feeder_to_local), (20.0, stop)])
    assert isinstance(one.error, RunBrokenOff)
    assert "its switch stands at LOCAL" in one.error.what
    assert "powder did not stop" in one.error.render()
    assert len(one.standing_beam) == 0
    assert "held" in one.states


@pytest.mark.parametrize("name", INTERLOCKS)
def test_an_interlock_takes_beam_and_motion_down_first_and_waits(
    run, profile, large_square_job, name
):
    act, cycles, words = INTERLOCKS[name]
    seen_s = cycles * profile.feeder[0].watchdog_s / 4
    one = run(large_square_job, acts=[(3.0, act), (20.0, stop)])
    assert isinstance(one.error, RunStopped), one.error
    text = one.error.render()
    assert words.lower() in text.lower()
    assert "lmctl recover" in text
    assert len(one.standing_beam) == 0
    assert one.path.time_s.max() < one.started_s + 3.0 + seen_s + BEAM_OFF_S
    assert one.still_feeding == []
    assert one.states[-4:] == ["holding", "held", "stopping", "stopped"]
    assert [do for do in acts(one) if do.startswith(("feed hold", "powder off"))][:2] == [
        "feed hold", "powder off"]
    assert words.lower() in one.records("alarm")[0]["what"].lower()
    (seal,) = one.records("seal")
    assert seal["recoverable"]


def test_after_an_interlock_the_operator_goes_on_with_the_part(run, large_square_job):
    """The disc of a feeder that was switched to LOCAL and back: alarms acknowledged, powder new."""
    one = run(large_square_job, acts=[
        (3.0, feeder_to_local), (20.0, lambda r: r.bench.feeders["F1"].turn_local(False)),
        (25.0, lambda r: r.executor.resume()),
    ])
    whole = run(large_square_job)
    assert one.result.state == "done", one.error
    # Until the feeder was asked again, a second later, nobody could know.
    assert one.bare_beam[:, 1].max() < one.started_s + 3.0 + 1.0 + BEAM_OFF_S
    one.bare_beam = []
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) == pytest.approx(OVERLAP_MM, abs=EXACT_MM)


def test_a_restarted_controller_ends_the_run(run, large_square_job):
    one = run(large_square_job, acts=[(3.0, reboot)])
    assert isinstance(one.error, RunFailed), one.error
    assert "the motion controller restarted" in one.error.render()
    assert one.path.time_s.max() < one.started_s + 3.0 + BEAM_OFF_S
    assert one.still_feeding == []
    assert one.states[-2:] == ["tripped", "faulted"]
    assert "restarted" in one.records("fault")[0]["what"]
    assert one.records("seal")[0]["state"] == "faulted"


@pytest.mark.parametrize("act", [deafen, silence])
def test_without_a_host_the_controller_runs_dry_within_the_send_horizon(
    run, large_square_job, act
):
    one = run(large_square_job, acts=[(3.0, act)])
    assert isinstance(one.error, RunFailed)
    assert "the motion controller has not reported for" in one.error.what
    assert one.path.time_s.max() < one.started_s + 3.0 + 1.0 + BEAM_OFF_S
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    assert one.records("seal")[0]["state"] == "faulted"


def test_a_locked_machine_is_refused_and_left_alone(run, square_job):
    """Grbl with homing on ($22=1) starts in alarm until it is homed."""
    one = run(square_job, bench=[('dialect = "grblhal"', 'dialect = "grbl"'),
                                 ("10 = 511", "10 = 3\n22 = 1")])
    assert isinstance(one.error, MachineError)
    assert "Alarm" in one.error.render()
    assert one.executed == []
    assert one.states == ["connecting", "checking", "faulted"]


def test_a_hold_that_does_not_come_is_followed_by_a_reset(run, large_square_job):
    """A controller that ignores `!`: 0x18 after 250 ms, and the run is over."""

    def deaf_to_hold(one):
        receive = one.bench.motion.receive
        one.bench.motion.receive = lambda data: receive(data.replace(b"!", b""))
        one.executor.hold()

    one = run(large_square_job, acts=[(3.0, deaf_to_hold)])
    assert isinstance(one.error, RunFailed)
    assert "no hold showed" in one.error.render()
    assert one.path.time_s.max() < one.started_s + 3.0 + 2 * 0.25 + 2 * BEAM_OFF_S
    assert one.still_feeding == []
    assert one.records("seal")[0]["state"] == "faulted"


@pytest.mark.parametrize("bench", [
    [], [('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3")],
])
def test_a_line_damaged_on_its_way_stops_the_run_at_once(run, large_square_job, bench):
    def damage(one):
        receive = one.bench.motion.receive
        left = [1]

        def damaged(data):
            if b" G1 " in data and left:
                left.clear()
                data = data.replace(b" G1 ", b" G9 ", 1)
            receive(data)

        one.bench.motion.receive = damaged

    one = run(large_square_job, bench=bench, acts=[(3.0, damage)])
    assert isinstance(one.error, RunFailed)
    text = one.error.render()
    assert "program line" in text
    assert "was rejected" in text
    assert len(one.standing_beam) == 0
    assert one.path.time_s.max() < one.started_s + 4.5
    assert one.still_feeding == []


def test_a_hold_at_the_controller_s_own_panel_is_a_hold(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.receive(b"!")), (20.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    one.check_safe()
    assert one.states.count("held") == 1


def test_an_opened_door_holds_the_run_until_it_is_closed(run, large_square_job):
    refused = []

    def too_early(one):
        try:
            one.executor.resume()
        except UsageError as error:
            refused.append(error.render())

    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.set_door(True)), (8.0, too_early),
        (10.0, lambda r: r.bench.motion.set_door(False)), (12.0, lambda r: r.executor.resume()),
    ])
    whole = run(large_square_job)
    assert one.result.state == "done", one.error
    assert "door is open" in refused[0]
    one.check_safe()
    check_all_is_laid(one, whole)


def test_a_job_altered_while_it_runs_ends_the_run(run, tmp_path, profile, job_file):
    job_file(tmp_path / "job.lmj", profile, job_file.squares(layers=4, per_layer=3, side_mm=12.0))

    def alter(one):
        (copy,) = tmp_path.glob("bench-*/runs/*/job.lmj")
        data = bytearray(copy.read_bytes())
        at = data.rindex(b"S500")
        data[at:at + 4] = b"S999"
        copy.write_bytes(data)

    one = run(tmp_path / "job.lmj", acts=[(1.0, alter)])
    assert isinstance(one.error, RunFailed)
    assert "job.lmj" in one.error.what
    assert "plan the part again" in one.error.hint
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    assert one.states[-2:] == ["tripped", "faulted"]


def test_a_full_disk_ends_the_run_safely(run, large_square_job, monkeypatch):
    def fill_disk(one):
        def write(fd, data):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        full = SimpleNamespace(**{**vars(os), "write": write})
        monkeypatch.setattr("lmctl.run.journal.os", full)

    one = run(large_square_job, acts=[(3.0, fill_disk)])
    monkeypatch.undo()
    assert isinstance(one.error, RunFailed)
    assert "No space left on device" in one.error.render()
    assert len(one.standing_beam) == 0
    assert one.still_feeding == []
    found = verify(one.journal)
    assert found.whole
    assert not found.sealed  # it could not be
    assert one.path.time_s.max() < one.started_s + 3.0 + 5.0
