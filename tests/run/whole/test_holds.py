"""Holds, panel and door: the place is kept, powder is fresh, and the part is made whole."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.errors import RunFailedError, RunStoppedError
from tests.run.whole.deposited import (
    BEAM_OFF_S,
    EXACT_MM,
    OVERLAP_MM,
    check_all_is_laid,
    laid_again_mm,
)


def test_a_hold_keeps_the_place_and_the_beam_returns_with_overlap_through_fresh_powder(
    run, large_square_job, undisturbed
):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (50.0, lambda r: r.executor.resume()),
    ])
    whole = undisturbed["large"]
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    assert laid_again_mm(one, whole) == pytest.approx(OVERLAP_MM, abs=EXACT_MM)
    (entry,) = one.records("entry")
    assert entry["repeated_mm"] == pytest.approx(OVERLAP_MM)
    assert one.entered_s("resuming") - one.entered_s("purging") >= 7.0  # θ + 4τ of hopper A
    beam_off = np.argmax(np.diff(one.path.time_s))
    assert one.path.time_s[beam_off] < one.started_s + 3.0 + BEAM_OFF_S
    assert one.path.time_s[beam_off + 1] >= one.entered_s("resuming")
    # The nozzle gives what it should from the first moment on.
    assert one.path.flow_g_s[beam_off + 1] == pytest.approx(0.1, rel=0.02)


def test_a_held_cell_feeds_no_powder_and_its_controller_holds_no_motion(run, large_square_job):
    seen = {}

    def look(one):
        seen["state"] = one.executor.state
        seen["feeding"] = [d.spans[-1].end_s > one.loop.time() for d in one.bench.feeders.values()]
        seen["at"] = one.bench.motion.position_mm
        one.bench.motion.receive(b"~")  # an operator presses cycle start at its panel

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
def test_held_anywhere_the_part_is_made_whole(run, square_job, undisturbed, at_s):
    one = run(square_job, acts=[
        (at_s, lambda r: r.executor.state == "depositing" and r.executor.hold()),
        (at_s + 5.0, lambda r: r.executor.state == "held" and r.executor.resume()),
    ])
    whole = undisturbed["small"]
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    assert -EXACT_MM < laid_again_mm(one, whole) < OVERLAP_MM + EXACT_MM
    layers = [record["layer"] for record in one.records("layer")]
    assert layers == [record["layer"] for record in whole.records("layer")]


def test_held_twice_in_the_overlap_the_first_place_counts(run, large_square_job, undisturbed):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (8.0, lambda r: r.executor.resume()),
        (32.0, lambda r: r.executor.state == "depositing" and r.executor.hold()),
        (40.0, lambda r: r.executor.state == "held" and r.executor.resume()),
    ])
    whole = undisturbed["large"]
    assert one.result.state == "done"
    one.check_safe()
    check_all_is_laid(one, whole)
    places = [(r["line"], r["share"]) for r in one.records("place")]
    assert places == sorted(places)


def test_no_one_comes_to_a_held_run(run, large_square_job, monkeypatch):
    monkeypatch.setattr("lmctl.run.sequence.HELD_AT_MOST_S", 100.0)
    one = run(large_square_job, acts=[(3.0, lambda r: r.executor.hold())])
    assert isinstance(one.error, RunStoppedError)
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


def test_a_hold_that_does_not_come_is_followed_by_a_reset(run, large_square_job):
    """A controller that ignores `!`: 0x18 after 250 ms, and the run is over."""

    def deaf_to_hold(one):
        receive = one.bench.motion.receive
        one.bench.motion.receive = lambda data: receive(data.replace(b"!", b""))
        one.executor.hold()

    one = run(large_square_job, acts=[(3.0, deaf_to_hold)])
    assert isinstance(one.error, RunFailedError)
    assert "no hold showed" in one.error.render()
    assert one.path.time_s.max() < one.started_s + 3.0 + 2 * 0.25 + 2 * BEAM_OFF_S
    assert one.still_feeding == []
    assert one.records("seal")[0]["state"] == "faulted"


def test_a_hold_at_the_controller_s_own_panel_is_a_hold(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.receive(b"!")), (20.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    one.check_safe()
    assert one.states.count("held") == 1


def test_an_opened_door_holds_the_run_until_it_is_closed(run, large_square_job, undisturbed):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.set_door(True)), (8.0, lambda r: r.resume_refused()),
        (10.0, lambda r: r.bench.motion.set_door(False)), (12.0, lambda r: r.executor.resume()),
    ])
    whole = undisturbed["large"]
    assert one.result.state == "done", one.error
    assert "door is open" in one.refused[0]
    one.check_safe()
    check_all_is_laid(one, whole)


@pytest.mark.parametrize("open_s", [0.003, 0.03, 0.2, 0.45])
def test_a_door_that_is_closed_again_at_once_holds_the_run_too(
    run, large_square_job, undisturbed, open_s
):
    """Its controller then waits for a cycle start, beam off, while powder would run for ever."""
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.set_door(True)),
        (3.0 + open_s, lambda r: r.bench.motion.set_door(False)),
        (12.0, lambda r: r.executor.resume()),
    ])
    assert one.result.state == "done"
    one.check_safe()
    assert one.entered_s("holding") < one.started_s + 3.0 + open_s + 0.5
    (alarm,) = one.records("alarm")
    assert "door" in alarm["what"]
    check_all_is_laid(one, undisturbed["large"])


@pytest.mark.parametrize("left", [b"G92 X-5 Y-3\n", b"G10 L2 P2 X5 Y3\nG55\n", b"G43.1 Z2\n"])
def test_an_offset_that_a_hold_would_lose_keeps_a_run_from_starting(run, square_job, left):
    """Another program has left it; the reset that ends a hold would forget it."""
    one = run(square_job, before=lambda r: r.bench.motion.receive(left))
    assert one.error is not None
    assert "displaced after its first hold" in one.error.what
    assert len(one.path.length_mm) == 0


def test_an_offset_that_has_changed_in_a_hold_ends_the_run(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()),
        (8.0, lambda r: setattr(r.executor._live.sequence._cell, "offset_mm", (0.0, 0.0, 5.0))),
        (9.0, lambda r: r.executor.resume()),
    ])
    assert isinstance(one.error, RunFailedError)
    assert "work offset has changed" in one.error.what
    one.check_safe()
    assert one.path.time_s.max() < one.started_s + 4.0


def test_a_host_that_stood_still_within_the_send_horizon_holds_nothing(run, large_square_job):
    """The machine had lines for longer than that, and answers as soon as it is asked."""
    one = run(large_square_job, acts=[(3.0, lambda r: r.loop._land_on(r.loop.time() + 0.75))])
    assert one.result is not None, one.error
    assert "held" not in one.states
    assert one.records("alarm") == []


@pytest.mark.parametrize("asleep_s", [1.6, 20.0])
def test_a_host_that_slept_holds_the_run_and_keeps_the_position(run, large_square_job, asleep_s):
    """The machine went on as long as it had lines: no report shows that it stopped."""
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.loop._land_on(r.loop.time() + asleep_s)),
        (asleep_s + 15.0, lambda r: r.executor.resume()),
    ])
    assert "reset" not in [alarm["what"] for alarm in one.records("alarm")]
    assert "position" not in {alarm["name"] for alarm in one.records("alarm")}
    assert "held" in one.states
    assert one.result is not None, one.error
    one.check_safe()
