"""Every cell of the state table, and the orders of starting and stopping it must keep."""

from __future__ import annotations

import itertools

import pytest

from lmctl.run.state.transitions import (
    FINAL_STATES,
    TRANSITIONS,
    Effect,
    RunEvent,
    RunState,
    next_transition,
    table_as_markdown,
)

# Next state for each event, written apart from the table: a dot is an event the state does not
# know, which is a fault. Columns in the order of Event.
NEXT = """
-          start      achieved   done      hold    resume  stop      refill  refilled interlock fault
ready      connecting .          .         .       .       stopped   .       .        faulted   faulted
connecting .          checking   .         .       .       stopped   .       .        faulted   faulted
checking   .          gas        .         .       .       stopped   .       .        faulted   faulted
gas        .          powder     .         .       .       stopping  .       .        tripped   tripped
powder     .          armed      .         .       .       stopping  .       .        tripped   tripped
armed      .          depositing .         .       .       stopping  .       .        tripped   tripped
depositing .          .          finishing holding .       stopping  .       .        holding   tripped
holding    .          held       finishing .       .       stopping  .       .        holding   tripped
held       .          stopping   finishing .       purging stopping  opening .        held      tripped
opening    .          refilling  finishing .       .       stopping  .       .        held      tripped
refilling  .          stopping   finishing .       .       stopping  .       weighing refilling tripped
weighing   .          held       finishing .       .       stopping  .       .        refilling tripped
purging    .          resuming   finishing holding .       stopping  .       .        holding   tripped
resuming   .          depositing finishing holding .       stopping  .       .        holding   tripped
finishing  .          done       .         .       .       finishing .       .        finishing tripped
stopping   .          stopped    stopping  .       .       stopping  .       .        stopping  tripped
tripped    .          faulted    tripped   .       .       tripped   .       .        tripped   tripped
"""  # noqa: E501


def cells():
    for row in NEXT.strip().splitlines()[1:]:
        state, *following = row.split()
        for event, then in zip(RunEvent, following, strict=True):
            yield RunState(state), event, then


@pytest.mark.parametrize(("state", "event", "then"), list(cells()))
def test_every_cell(state, event, then):
    if then == ".":
        assert (state, event) not in TRANSITIONS
        assert next_transition(state, event) == next_transition(state, RunEvent.FAULT)
    else:
        assert next_transition(state, event).state == RunState(then)


@pytest.mark.parametrize(("state", "event"),
                         list(itertools.product(sorted(FINAL_STATES), RunEvent)))
def test_final_states_stay(state, event):
    assert next_transition(state, event) == (state, ())


def test_the_matrix_above_leaves_nothing_out():
    assert len(list(cells())) + len(FINAL_STATES) * len(RunEvent) == len(RunState) * len(RunEvent)


def effects_of(*events: RunEvent, state: RunState = RunState.READY) -> list[Effect]:
    done = []
    for event in events:
        state, effects = next_transition(state, event)
        done += effects
    return done


TO_DEPOSITING = (RunEvent.START, *[RunEvent.ACHIEVED] * 5)


def test_start_is_gas_then_stable_powder_then_beam_at_zero_then_motion():
    assert effects_of(*TO_DEPOSITING) == [
        Effect.CONNECT, Effect.CHECK_MACHINE, Effect.MOVE_TO_PURGE, Effect.GAS_ON, Effect.POWDER_ON,
        Effect.AWAIT_STABLE,
        Effect.ARM_BEAM, Effect.LEAD_POWDER, Effect.START_MOTION,
    ]


def test_the_end_is_beam_then_powder_then_gas():
    assert effects_of(RunEvent.PROGRAM_DONE, RunEvent.ACHIEVED, state=RunState.DEPOSITING) == [
        Effect.REST_BEAM, Effect.POWDER_OFF, Effect.GAS_OFF
    ]


@pytest.mark.parametrize("event", [RunEvent.STOP, RunEvent.FAULT])
@pytest.mark.parametrize("state", [s for s in RunState if s not in FINAL_STATES])
def test_from_everywhere_beam_and_motion_go_first_then_powder_then_gas(state, event):
    effects = effects_of(event, state=state)
    if state in (RunState.READY, RunState.CONNECTING, RunState.CHECKING):
        assert effects == []
    elif state is RunState.TRIPPED and event is RunEvent.FAULT:
        assert effects == []  # its stop is under way already
    elif state is RunState.FINISHING and event is RunEvent.STOP:
        assert effects == [Effect.REST_BEAM, Effect.POWDER_OFF, Effect.GAS_OFF_NOW]
    else:
        assert effects[:2] == [Effect.STOP_MOTION, Effect.POWDER_OFF]
        assert effects[2:] in ([Effect.GAS_OFF], [Effect.GAS_OFF_NOW])


@pytest.mark.parametrize("event", [RunEvent.HOLD, RunEvent.INTERLOCK])
def test_the_beam_returns_after_a_hold_only_off_the_part_and_through_fresh_powder(event):
    effects = effects_of(
        event, RunEvent.ACHIEVED, RunEvent.RESUME, RunEvent.ACHIEVED, RunEvent.ACHIEVED,
        state=RunState.DEPOSITING,
    )
    assert effects == [
        Effect.FEED_HOLD, Effect.CLEAR_MOTION, Effect.POWDER_OFF, Effect.AWAIT_OPERATOR,
        Effect.ACKNOWLEDGE, Effect.LEAVE_PART, Effect.GAS_ON, Effect.POWDER_ON, Effect.AWAIT_STABLE,
        Effect.ARM_BEAM, Effect.LEAD_POWDER, Effect.START_MOTION,
    ]


def test_a_hopper_is_opened_without_gas_and_closed_before_the_run_can_go_on():
    assert effects_of(RunEvent.REFILL, RunEvent.ACHIEVED, RunEvent.REFILLED, RunEvent.ACHIEVED,
                      state=RunState.HELD) == [
        Effect.OPEN_HOPPER, Effect.AWAIT_OPERATOR, Effect.CLOSE_HOPPER, Effect.AWAIT_OPERATOR,
    ]
    for state in (RunState.OPENING, RunState.REFILLING, RunState.WEIGHING):
        assert (state, RunEvent.RESUME) not in TRANSITIONS


def test_no_row_starts_motion_or_powder_out_of_order():
    for (state, _), (_, effects) in TRANSITIONS.items():
        if Effect.START_MOTION in effects:
            assert state in (RunState.ARMED, RunState.PURGING)
            assert state is RunState.ARMED or effects[0] is Effect.ARM_BEAM
        if Effect.POWDER_ON in effects:
            assert state in (RunState.GAS, RunState.HELD)
            assert effects[effects.index(Effect.POWDER_ON) + 1] is Effect.AWAIT_STABLE
        if Effect.ARM_BEAM in effects:
            assert state in (RunState.POWDER, RunState.PURGING)


def test_an_interlock_never_waits_where_a_beam_may_be_on():
    """From each state with motion a hold is the very first thing, and it empties the controller."""
    for state in (RunState.DEPOSITING, RunState.PURGING, RunState.RESUMING):
        assert effects_of(RunEvent.INTERLOCK, state=state)[:2] == [Effect.FEED_HOLD,
                                                                   Effect.CLEAR_MOTION]


def test_every_state_is_reached_and_every_live_one_can_be_left():
    reached = {RunState.READY}
    for _ in RunState:
        reached |= {then for (state, _), (then, _) in TRANSITIONS.items() if state in reached}
    assert reached == set(RunState)
    for state in set(RunState) - FINAL_STATES:
        ends = {state}
        for _ in RunState:
            ends |= {then for (s, _), (then, _) in TRANSITIONS.items() if s in ends}
        assert ends & FINAL_STATES


def test_the_drawing_has_a_row_for_each_transition():
    rows = table_as_markdown().splitlines()
    assert len(rows) == 2 + len(TRANSITIONS)
    assert "| armed | achieved | depositing | start motion |" in rows
    assert "| resuming | achieved | depositing | – |" in rows
