"""The states of a run and what happens between them, as a table.

The order of start and stop stands here and nowhere else: gas, then powder until it is stable,
then the beam armed at zero, then motion; and back in reverse (beam and motion first).
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """Where a run is. The value is what people and journals read."""

    READY = "ready"            # nothing touched yet
    CONNECTING = "connecting"
    CHECKING = "checking"      # is this the machine the job was planned for?
    GAS = "gas"                # to the purge position; carrier gas and its pre-flow
    POWDER = "powder"          # powder runs into the catcher until it is stable
    ARMED = "armed"            # beam ready at zero; powder led up to the first line
    DEPOSITING = "depositing"
    HOLDING = "holding"        # slowing down on the path; then motion and powder off
    HELD = "held"              # at rest, beam and powder off, position kept, nothing planned
    PURGING = "purging"        # off the part; fresh powder through the hose at the purge position
    RESUMING = "resuming"      # beam armed, powder led up to the place where the path is entered
    FINISHING = "finishing"    # program done; powder off, then gas after its post-flow
    STOPPING = "stopping"      # by the operator
    TRIPPED = "tripped"        # by a fault
    DONE = "done"
    STOPPED = "stopped"
    FAULTED = "faulted"


FINAL = frozenset({State.DONE, State.STOPPED, State.FAULTED})


class Event(StrEnum):
    """What may happen to a run."""

    START = "start"
    ACHIEVED = "achieved"          # every effect of the last transition has been carried out
    PROGRAM_DONE = "program done"  # the last line has been executed
    HOLD = "hold"                  # operator
    RESUME = "resume"              # operator
    STOP = "stop"                  # operator
    INTERLOCK = "interlock"        # something is not as it must be, and a hold is the answer
    FAULT = "fault"                # a device, a link, or our own mistake


class Do(StrEnum):
    """Effects. Those of one transition are carried out in order, each when the one before is done.

    A new transition that has effects breaks off those still under way; one without lets them run.
    """

    CONNECT = "connect"
    CHECK_MACHINE = "check machine"
    MOVE_TO_PURGE = "move to purge position"
    GAS_ON = "gas on, pre-flow"
    POWDER_ON = "powder on"
    AWAIT_STABLE = "await stable powder"
    ARM_BEAM = "arm beam at zero"
    LEAD_POWDER = "lead powder up to the first line"
    START_MOTION = "start motion"
    FEED_HOLD = "feed hold"
    CLEAR_MOTION = "clear the controller of motion"
    AWAIT_OPERATOR = "wait for the operator"
    ACKNOWLEDGE = "acknowledge alarms"
    LEAVE_PART = "leave the part for the purge position"
    REST_BEAM = "see beam and motion at rest"
    STOP_MOTION = "beam and motion off"
    POWDER_OFF = "powder off"
    GAS_OFF = "post-flow, gas off"
    GAS_OFF_NOW = "gas off"


class Transition(NamedTuple):
    state: State
    effects: tuple[Do, ...]


_STOP = (Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF)
_STOP_NOW = (Do.STOP_MOTION, Do.POWDER_OFF, Do.GAS_OFF_NOW)
_FINISH = (Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF)
#: Once it stands, the controller is emptied: a cycle start at its panel then starts nothing.
_HOLD = Transition(State.HOLDING, (Do.FEED_HOLD, Do.CLEAR_MOTION, Do.POWDER_OFF))

#: States in which a device may be on, so that ending them takes the whole order of stopping.
_LIVE = (
    State.GAS, State.POWDER, State.ARMED, State.DEPOSITING, State.HOLDING, State.HELD,
    State.PURGING, State.RESUMING,
)

TRANSITIONS: dict[tuple[State, Event], Transition] = {
    (State.READY, Event.START): Transition(State.CONNECTING, (Do.CONNECT,)),
    (State.CONNECTING, Event.ACHIEVED): Transition(State.CHECKING, (Do.CHECK_MACHINE,)),
    (State.CHECKING, Event.ACHIEVED): Transition(State.GAS, (Do.MOVE_TO_PURGE, Do.GAS_ON)),
    (State.GAS, Event.ACHIEVED): Transition(State.POWDER, (Do.POWDER_ON, Do.AWAIT_STABLE)),
    (State.POWDER, Event.ACHIEVED): Transition(State.ARMED, (Do.ARM_BEAM, Do.LEAD_POWDER)),
    (State.ARMED, Event.ACHIEVED): Transition(State.DEPOSITING, (Do.START_MOTION,)),
    (State.DEPOSITING, Event.HOLD): _HOLD,
    (State.DEPOSITING, Event.INTERLOCK): _HOLD,
    (State.DEPOSITING, Event.PROGRAM_DONE): Transition(State.FINISHING, _FINISH),
    (State.HOLDING, Event.ACHIEVED): Transition(State.HELD, (Do.AWAIT_OPERATOR,)),
    (State.HOLDING, Event.INTERLOCK): Transition(State.HOLDING, ()),
    (State.HOLDING, Event.PROGRAM_DONE): Transition(State.FINISHING, _FINISH),
    (State.HELD, Event.RESUME): Transition(
        State.PURGING,
        (Do.ACKNOWLEDGE, Do.LEAVE_PART, Do.GAS_ON, Do.POWDER_ON, Do.AWAIT_STABLE),
    ),
    # Nobody has come: gas is not kept for ever, and the run can be recovered later.
    (State.HELD, Event.ACHIEVED): Transition(State.STOPPING, _STOP),
    (State.HELD, Event.INTERLOCK): Transition(State.HELD, ()),
    (State.HELD, Event.PROGRAM_DONE): Transition(State.FINISHING, _FINISH),
    (State.PURGING, Event.ACHIEVED): Transition(
        State.RESUMING, (Do.ARM_BEAM, Do.LEAD_POWDER, Do.START_MOTION)
    ),
    (State.PURGING, Event.HOLD): _HOLD,
    (State.PURGING, Event.INTERLOCK): _HOLD,
    (State.PURGING, Event.PROGRAM_DONE): Transition(State.FINISHING, _FINISH),
    (State.RESUMING, Event.ACHIEVED): Transition(State.DEPOSITING, ()),
    (State.RESUMING, Event.HOLD): _HOLD,
    (State.RESUMING, Event.INTERLOCK): _HOLD,
    (State.RESUMING, Event.PROGRAM_DONE): Transition(State.FINISHING, _FINISH),
    (State.FINISHING, Event.ACHIEVED): Transition(State.DONE, ()),
    # The part is made: what interlocks say now is written down, a stop only cuts the post-flow.
    (State.FINISHING, Event.INTERLOCK): Transition(State.FINISHING, ()),
    (State.FINISHING, Event.STOP): Transition(
        State.FINISHING, (Do.REST_BEAM, Do.POWDER_OFF, Do.GAS_OFF_NOW)
    ),
    (State.FINISHING, Event.FAULT): Transition(State.TRIPPED, _STOP),
    # Nothing has been touched yet, so nothing is stopped.
    (State.READY, Event.STOP): Transition(State.STOPPED, ()),
    (State.CONNECTING, Event.STOP): Transition(State.STOPPED, ()),
    (State.CHECKING, Event.STOP): Transition(State.STOPPED, ()),
    **{
        (untouched, event): Transition(State.FAULTED, ())
        for untouched in (State.READY, State.CONNECTING, State.CHECKING)
        for event in (Event.INTERLOCK, Event.FAULT)
    },
    # Nothing has been laid yet: there is nothing to hold for.
    **{
        (starting, Event.INTERLOCK): Transition(State.TRIPPED, _STOP)
        for starting in (State.GAS, State.POWDER, State.ARMED)
    },
    **{(live, Event.STOP): Transition(State.STOPPING, _STOP) for live in _LIVE},
    **{(live, Event.FAULT): Transition(State.TRIPPED, _STOP) for live in _LIVE},
    (State.STOPPING, Event.ACHIEVED): Transition(State.STOPPED, ()),
    (State.STOPPING, Event.STOP): Transition(State.STOPPING, _STOP_NOW),
    (State.STOPPING, Event.INTERLOCK): Transition(State.STOPPING, ()),
    (State.STOPPING, Event.FAULT): Transition(State.TRIPPED, _STOP),
    (State.STOPPING, Event.PROGRAM_DONE): Transition(State.STOPPING, ()),
    (State.TRIPPED, Event.ACHIEVED): Transition(State.FAULTED, ()),
    (State.TRIPPED, Event.STOP): Transition(State.TRIPPED, _STOP_NOW),
    # One fault brings others (a lost link, then silence): the first one's stop goes on.
    (State.TRIPPED, Event.INTERLOCK): Transition(State.TRIPPED, ()),
    (State.TRIPPED, Event.FAULT): Transition(State.TRIPPED, ()),
    (State.TRIPPED, Event.PROGRAM_DONE): Transition(State.TRIPPED, ()),
}

#: States whose effects go on when one of them fails: each takes something off the machine, and a
#: dead device must not keep the others from it. In HOLDING that is so for feeders only.
GOES_ON = frozenset({State.TRIPPED})
GOES_ON_AFTER_INTERLOCK = frozenset({State.TRIPPED, State.HOLDING})


def step(state: State, event: Event) -> Transition:
    """What follows from an event. One the table does not know is a fault.

    Final states stay as they are, whatever comes.
    """
    if state in FINAL:
        return Transition(state, ())
    return TRANSITIONS.get((state, event)) or TRANSITIONS[state, Event.FAULT]


def drawn() -> str:
    """The table as Markdown, for the manual: one row a transition."""
    rows = ["| state | event | next state | effects, in order |", "| --- | --- | --- | --- |"]
    order = list(State), list(Event)
    for (state, event), (then, effects) in sorted(
        TRANSITIONS.items(), key=lambda row: (order[0].index(row[0][0]), order[1].index(row[0][1]))
    ):
        rows.append(f"| {state} | {event} | {then} | {'; '.join(effects) or '–'} |")
    return "\n".join(rows)
