"""A hopper refilled in the middle of a run: held at the end of a path, without gas, weighed."""

from __future__ import annotations

import pytest

from lmctl.errors import UsageError
from lmctl.run.state.transitions import Effect, RunState


def fill(one, grams, feeder="F1", channel=1):
    """An operator pours powder into a hopper."""
    process = one.bench.feeders[feeder].hoppers[channel].process
    now_s = one.loop.time()
    process.set_remaining_g(now_s, process.remaining_g(now_s) + grams)


def refill(name, lot="", mass_g=0.0):
    return lambda one: one.executor.refill(name, lot, mass_g)


def note_gas(one):
    one.gas_while_open = one.bench.feeders["F1"].is_gas_flowing(one.loop.time())
    one.state_while_open = one.executor.state
    one.status_while_open = one.executor.snapshot()


def name_of(one):
    return one.records("header")[0]["hoppers"][0]["name"]


REFILL = [
    (2.0, refill("A")),
    (40.0, note_gas), (41.0, lambda one: fill(one, 1500.0)),
    (45.0, lambda one: one.resume_refused()),
    (50.0, refill("A", "HEAT-7", 1500.0)),
    (60.0, lambda one: one.executor.resume()),
]


@pytest.fixture
def refilled(run, large_square_job):
    return run(large_square_job, acts=REFILL)


def test_a_refilled_run_is_completed_and_its_refill_journaled(refilled):
    assert refilled.error is None
    assert refilled.result.state == "done"
    (record,) = refilled.records("refill")
    assert record["hopper"] == "A"
    assert (record["lot"], record["mass_g"]) == ("HEAT-7", 1500.0)
    assert record["weighed_g"] == pytest.approx(1500.0, abs=0.3)
    assert record["after_g"] - record["before_g"] == pytest.approx(record["weighed_g"], abs=0.11)
    assert any("lot HEAT-7, 1500 g by the operator, 1500 g weighed" in line
               for line in refilled.notices)
    refilled.check_safe()


def test_it_is_held_at_the_end_of_a_path_and_nothing_is_deposited_twice(refilled):
    places = refilled.records("place")
    executed = [record["path"] for record in refilled.records("executed")]
    begun = [record["path"] for record in refilled.records("path")]
    assert executed == sorted(set(executed))  # no path twice: it was held between two
    assert set(begun) == set(executed)
    (entry,) = refilled.records("entry")
    assert entry["repeated_mm"] == 0.0
    assert len(places) >= 1
    laid_mm = 2 * 3 * 4 * 12.0
    assert refilled.path.length_mm.sum() == pytest.approx(laid_mm, abs=0.01)


def test_the_hopper_is_open_only_without_gas_and_the_run_cannot_go_on_meanwhile(refilled):
    assert refilled.state_while_open is RunState.REFILLING
    assert not refilled.gas_while_open
    assert refilled.status_while_open["refill_hopper"] == "A"
    assert refilled.status_while_open["next"][0]["command"].startswith("lmctl refill A --lot")
    (refused,) = refilled.refused
    assert "cannot resume now: the run is refilling" in refused
    assert "fill and close it" in refused
    states = refilled.states
    at = states.index("held")
    assert states[at:at + 5] == ["held", "opening", "refilling", "weighing", "held"]
    acts = [record["do"] for record in refilled.records("act")]
    assert acts.index(Effect.OPEN_HOPPER) < acts.index(Effect.CLOSE_HOPPER)


def test_powder_runs_steadily_by_weight_before_the_beam_returns(refilled):
    purging, resuming = refilled.entered_s("purging"), refilled.entered_s("resuming")
    settling_s = 3.0 + 4.0
    assert resuming - purging >= settling_s + 5.0
    assert refilled.flow_error().max() < 0.02


def test_a_refilled_hopper_that_does_not_feed_is_not_deposited_with(run, large_square_job):
    def jam(one):
        one.bench.feeders["F1"].hoppers[1].process.disturb(one.loop.time(), speed=0.5)

    one = run(large_square_job, acts=[
        *REFILL[:-1], (59.0, jam), (60.0, lambda r: r.executor.resume()),
        (200.0, lambda r: r.executor.stop()),
    ])
    assert one.error is not None
    troubles = [record["what"] for record in one.records("alarm")] + [
        record["what"] for record in one.records("fault")]
    assert any("hopper A" in what for what in troubles)
    assert one.path.time_s.max() < one.started_s + 60.0
    one.check_safe()


def test_what_cannot_be_refilled_is_refused_in_words(run, large_square_job):
    refused = []

    def try_to(*request):
        def act(one):
            with pytest.raises(UsageError) as caught:
                one.executor.refill(*request)
            refused.append(caught.value.render())
        return act

    run(large_square_job, before=try_to("A"), acts=[
        (1.0, try_to("Z")), (1.0, try_to("A", "L1", 100.0)),
        (2.0, lambda r: r.executor.hold()), (8.0, refill("A")),
        (9.0, try_to("A")), (40.0, try_to("B", "L1", 100.0)), (41.0, try_to("B")),
        (42.0, lambda r: r.executor.stop()),
    ])
    assert [text.splitlines()[0].removeprefix("error: ") for text in refused] == [
        "cannot refill now: the run has not begun",
        "this run uses no hopper 'Z'",
        "hopper A is not open for refilling: the run is depositing",
        "cannot refill now: the run is opening",
        "hopper B is not open for refilling",
        "cannot refill now: the run is refilling",
    ]


def test_a_refill_is_announced_before_the_hopper_is_empty_and_no_longer_after_it(
    run, large_square_job
):
    """A hopper with three grams to spare; the job of 35 s needs more than that."""
    def leave(one):
        process = one.bench.feeders["F1"].hoppers[1].process
        process.set_remaining_g(one.loop.time(), 51.0)  # five percent of a full one are kept

    one = run(large_square_job, before=leave, acts=REFILL)
    assert one.result.state == "done"
    warnings = [r for r in one.records("warning") if r["number"] == 50]
    assert [(record["hopper"], record["active"]) for record in warnings] == [
        ("A", True), ("A", False)]
    first, over = warnings
    assert "of 51 g left 0 g can be counted on" in first["what"]
    assert "until layer" in first["what"]
    assert "`lmctl refill A`" in first["hint"]
    (refill_record,) = one.records("refill")
    assert first["t"] < over["t"] < refill_record["t"]  # its weight tells as it is filled
    assert first["t"] < one.entered_s("held")
    assert one.records("alarm") == []


def test_a_hopper_that_lasts_for_the_job_is_not_announced(run, large_square_job):
    one = run(large_square_job)
    assert [r for r in one.records("warning") if r["number"] == 50] == []


@pytest.mark.parametrize("at_s", [0.05, 3.7, 4.95, 6.2, 14.4, 29.9])
def test_whenever_it_is_asked_for_every_path_is_deposited_once_and_whole(
    run, large_square_job, at_s
):
    """In a lead-in, a bead, a travel, between two layers, and in the last path, which just ends."""
    one = run(large_square_job, acts=[
        (at_s, refill("A")), (at_s + 40.0, lambda r: r.executor.state is RunState.REFILLING
                              and r.executor.refill("A", "L", 1.0)),
        (at_s + 60.0, lambda r: r.executor.state is RunState.HELD and r.executor.resume()),
    ])
    assert one.result.state == "done"
    assert all(record["repeated_mm"] == 0.0 for record in one.records("entry"))
    assert one.path.length_mm.sum() == pytest.approx(2 * 3 * 4 * 12.0, abs=0.01)
    one.check_safe()
