"""An operator's stop, Ctrl-C and a cancel: orderly, and they say where the part stands."""

from __future__ import annotations

import signal

import pytest

from lmctl.errors import RunStoppedError
from lmctl.run.sequence import CellSequence
from lmctl.run.state.transitions import RunState
from tests.run.whole.deposited import BEAM_OFF_S, acts


def interrupt(one):
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("how", [
    lambda r: r.executor.stop(), lambda r: r.task.cancel(), interrupt,
    lambda r: signal.raise_signal(signal.SIGTERM),
], ids=["stop", "cancel", "ctrl-c", "terminate"])
def test_a_stop_is_orderly_and_says_where(run, large_square_job, how):
    one = run(large_square_job, acts=[(3.0, how)])
    assert isinstance(one.error, RunStoppedError)
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
    assert isinstance(one.error, RunStoppedError)
    one.check_safe()
    assert acts(one)[-3:] == ["beam and motion off", "powder off", "gas off"]
    assert one.ended_s - one.entered_s("stopping") < 5.0


def test_a_stop_in_a_hold_is_a_stop(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.executor.hold()), (10.0, lambda r: r.executor.stop()),
    ])
    assert isinstance(one.error, RunStoppedError)
    one.check_safe()


def test_a_stop_while_the_beam_is_taken_leaves_the_part_done(run, square_job):
    """The controller takes its time to answer M5, and the operator does not."""
    def slow(one):
        receive = one.bench.motion.receive

        def later(data):
            if one.executor.state is not RunState.FINISHING or b"M5\n" not in data:
                receive(data)
                return
            one.loop.call_later(0.03, receive, data)
            if not one.asked:
                one.executor.stop()
            one.asked += 1

        one.asked, one.bench.motion.receive = 0, later

    one = run(square_job, acts=[(1.0, slow)])
    assert one.asked == 2
    assert one.result.state == "done", one.error
    assert one.records("fault") == []
    assert acts(one)[-3:] == ["see beam and motion at rest", "powder off", "gas off"]
    one.check_safe()


def test_a_third_ctrl_c_does_not_keep_the_journal_from_its_seal(
    run, large_square_job, monkeypatch
):
    close = CellSequence.close

    async def impatient(sequence):
        interrupt(sequence)
        await close(sequence)

    monkeypatch.setattr(CellSequence, "close", impatient)
    slipped_through = []
    before = signal.signal(signal.SIGINT, lambda *_: slipped_through.append("SIGINT"))
    try:
        one = run(large_square_job, acts=[(3.0, interrupt), (4.0, interrupt)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert slipped_through == []
    assert isinstance(one.error, RunStoppedError)
    one.check_safe()
