"""Every cell of the state table, and the orders of starting and stopping it must keep."""

from __future__ import annotations

import itertools

import pytest

from lmctl.run.state.table import FINAL, TRANSITIONS, Do, Event, State, drawn, step

# Next state for each event, written apart from the table: a dot is an event the state does not
# know, which is a fault. Columns in the order of Event.
NEXT = """
             start       achieved    done       hold     resume   stop      interlock fault
ready        connecting  .           .          .        .        stopped   faulted   faulted
connecting   .           checking    .          .        .        stopped   faulted   faulted
checking     .           gas         .          .        .        stopped   faulted   faulted
gas          .           powder      .          .        .        stopping  tripped   tripped
powder       .           armed       .          .        .        stopping  tripped   tripped
armed        .           depositing  .          .        .        stopping  tripped   tripped
depositing   .           .           finishing  holding  .        stopping  holding   tripped
holding      .           held        finishing  .        .        stopping  holding   tripped
held         .           stopping    finishing  .        purging  stopping  held      tripped
purging      .           resuming    finishing  holding  .        stopping  holding   tripped
resuming     .           depositing  finishing  holding  .        stopping  holding   tripped
finishing    .           done        .          .        .        finishing finishing tripped
stopping     .           stopped     stopping   .        .        stopping  stopping  tripped
tripped      .           faulted     tripped    .        .        tripped   tripped   tripped
"""


def cells():
    for row in NEXT.strip().splitlines()[1:]:
        state, *following = row.split()
        for event, then in zip(Event, following, strict=True):
            yield State(state), event, then


@pytest.mark.parametrize(("state", "event", "then"), list(cells()))
def test_every_cell(state, event, then):
    if then == ".":
        assert (state, event) not in TRANSITIONS
        assert step(state, event) == step(state, Event.FAULT)
    else:
        assert step(state, event).state == State(then)


@pytest.mark.parametrize(("state", "event"), list(itertools.product(sorted(FINAL), Event)))
def test_final_states_stay(state, event):
    assert step(state, event) == (state, ())


def test_the_matrix_above_leaves_nothing_out():
    assert len(list(cells())) + len(FINAL) * len(Event) == len(State) * len(Event)


def effects_of(*events: Event, state: State = State.READY) -> list[Do]:
    done = []
    for event in events:
        state, effects = step(state, event)
        done += effects
    return done


TO_DEPOSITING = (Event.START, *[Event.ACHIEVED] * 5)


def test_start_is_gas_then_stable_powder_then_beam_at_zero_then_motion():
    assert effects_of(*TO_DEPOSITING) == [
        Do.CONNECT, Do.CHECK_MACHINE, Do.MOVE_TO_PURGE, Do.GAS_ON, Do.POWDER_ON, Do.AWAIT_STABLE,
        Do.ARM_BEAM, Do.LEAD_POWDER, Do.START_MOTION,
    ]


def test_the_end_is_beam_then_powder_then_gas():
    assert effects_of(Event.PROGRAM_DONE, Event.ACHIEVED, state=State.DEPOSITING) == [
        Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF
    ]


@pytest.mark.parametrize("event", [Event.STOP, Event.FAULT])
@pytest.mark.parametrize("state", [s for s in State if s not in FINAL])
def test_from_everywhere_beam_and_motion_go_first_then_powder_then_gas(state, event):
    effects = effects_of(event, state=state)
    if state in (State.READY, State.CONNECTING, State.CHECKING):
        assert effects == []
    elif state is State.TRIPPED and event is Event.FAULT:
        assert effects == []  # its stop is under way already
    elif state is State.FINISHING and event is Event.STOP:
        assert effects == [Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF_NOW]
    else:
        assert effects[:2] == [Do.STOP_MOTION, Do.POWDER_OFF]
        assert effects[2:] in ([Do.GAS_OFF], [Do.GAS_OFF_NOW])


@pytest.mark.parametrize("event", [Event.HOLD, Event.INTERLOCK])
def test_the_beam_returns_after_a_hold_only_off_the_part_and_through_fresh_powder(event):
    effects = effects_of(
        event, Event.ACHIEVED, Event.RESUME, Event.ACHIEVED, Event.ACHIEVED,
        state=State.DEPOSITING,
    )
    assert effects == [
        Do.FEED_HOLD, Do.CLEAR_MOTION, Do.POWDER_OFF, Do.AWAIT_OPERATOR,
        Do.ACKNOWLEDGE, Do.LEAVE_PART, Do.GAS_ON, Do.POWDER_ON, Do.AWAIT_STABLE,
        Do.ARM_BEAM, Do.LEAD_POWDER, Do.START_MOTION,
    ]


def test_no_row_starts_motion_or_powder_out_of_order():
    for (state, _), (_, effects) in TRANSITIONS.items():
        if Do.START_MOTION in effects:
            assert state in (State.ARMED, State.PURGING)
            assert state is State.ARMED or effects[0] is Do.ARM_BEAM
        if Do.POWDER_ON in effects:
            assert state in (State.GAS, State.HELD)
            assert effects[effects.index(Do.POWDER_ON) + 1] is Do.AWAIT_STABLE
        if Do.ARM_BEAM in effects:
            assert state in (State.POWDER, State.PURGING)


def test_an_interlock_never_waits_where_a_beam_may_be_on():
    """From each state with motion a hold is the very first thing, and it empties the controller."""
    for state in (State.DEPOSITING, State.PURGING, State.RESUMING):
        assert effects_of(Event.INTERLOCK, state=state)[:2] == [Do.FEED_HOLD, Do.CLEAR_MOTION]


def test_every_state_is_reached_and_every_live_one_can_be_left():
    reached = {State.READY}
    for _ in State:
        reached |= {then for (state, _), (then, _) in TRANSITIONS.items() if state in reached}
    assert reached == set(State)
    for state in set(State) - FINAL:
        ends = {state}
        for _ in State:
            ends |= {then for (s, _), (then, _) in TRANSITIONS.items() if s in ends}
        assert ends & FINAL


def test_the_drawing_has_a_row_for_each_transition():
    rows = drawn().splitlines()
    assert len(rows) == 2 + len(TRANSITIONS)
    assert "| armed | achieved | depositing | start motion |" in rows
    assert "| resuming | achieved | depositing | – |" in rows
