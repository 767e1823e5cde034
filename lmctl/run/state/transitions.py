"""The states of a run and what happens between them, as a table.

The order of start and stop is defined here only: gas, then powder until it is stable,
then the beam armed at zero, then motion; and back in reverse (beam and motion first).
"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple


class RunState(StrEnum):
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
    OPENING = "opening"        # held; gas is going off so that a hopper may be opened
    REFILLING = "refilling"    # held; a hopper may be open
    WEIGHING = "weighing"      # held; a refilled hopper is being weighed
    PURGING = "purging"        # off the part; fresh powder through the hose at the purge position
    RESUMING = "resuming"      # beam armed, powder led up to the place where the path is entered
    FINISHING = "finishing"    # program done; powder off, then gas after its post-flow
    STOPPING = "stopping"      # by the operator
    TRIPPED = "tripped"        # by a fault
    DONE = "done"
    STOPPED = "stopped"
    FAULTED = "faulted"


FINAL_STATES = frozenset({RunState.DONE, RunState.STOPPED, RunState.FAULTED})


class RunEvent(StrEnum):
    """What may happen to a run."""

    START = "start"
    ACHIEVED = "achieved"          # every effect of the last transition has been carried out
    PROGRAM_DONE = "program done"  # the last line has been executed
    HOLD = "hold"                  # operator
    RESUME = "resume"              # operator
    STOP = "stop"                  # operator
    REFILL = "refill"              # operator: a hopper is to be opened
    REFILLED = "refilled"          # operator: it is filled and closed
    INTERLOCK = "interlock"        # something is not as it must be, and a hold is the answer
    FAULT = "fault"                # a device, a link, or our own mistake


class Effect(StrEnum):
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
    OPEN_HOPPER = "gas off, hopper ready to be opened"
    CLOSE_HOPPER = "weigh the refilled hopper"
    ACKNOWLEDGE = "acknowledge alarms"
    LEAVE_PART = "leave the part for the purge position"
    REST_BEAM = "see beam and motion at rest"
    STOP_MOTION = "beam and motion off"
    POWDER_OFF = "powder off"
    GAS_OFF = "post-flow, gas off"
    GAS_OFF_NOW = "gas off"


class Transition(NamedTuple):
    state: RunState
    effects: tuple[Effect, ...]


_STOP = (Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF)
_STOP_NOW = (Effect.STOP_MOTION, Effect.POWDER_OFF, Effect.GAS_OFF_NOW)
_FINISH = (Effect.REST_BEAM, Effect.POWDER_OFF, Effect.GAS_OFF)
#: Once at rest, the controller is emptied: a cycle start at its panel then starts nothing.
_HOLD = Transition(RunState.HOLDING, (Effect.FEED_HOLD, Effect.CLEAR_MOTION, Effect.POWDER_OFF))

#: States in which a device may be on, so that ending them takes the whole order of stopping.
_LIVE = (
    RunState.GAS, RunState.POWDER, RunState.ARMED, RunState.DEPOSITING, RunState.HOLDING,
    RunState.HELD,
    RunState.OPENING, RunState.REFILLING, RunState.WEIGHING, RunState.PURGING, RunState.RESUMING,
)

TRANSITIONS: dict[tuple[RunState, RunEvent], Transition] = {
    (RunState.READY, RunEvent.START): Transition(RunState.CONNECTING, (Effect.CONNECT,)),
    (RunState.CONNECTING, RunEvent.ACHIEVED): Transition(RunState.CHECKING,
                                                         (Effect.CHECK_MACHINE,)),
    (RunState.CHECKING, RunEvent.ACHIEVED): Transition(RunState.GAS,
                                                       (Effect.MOVE_TO_PURGE, Effect.GAS_ON)),
    (RunState.GAS, RunEvent.ACHIEVED): Transition(RunState.POWDER,
                                                  (Effect.POWDER_ON, Effect.AWAIT_STABLE)),
    (RunState.POWDER, RunEvent.ACHIEVED): Transition(RunState.ARMED,
                                                     (Effect.ARM_BEAM, Effect.LEAD_POWDER)),
    (RunState.ARMED, RunEvent.ACHIEVED): Transition(RunState.DEPOSITING, (Effect.START_MOTION,)),
    (RunState.DEPOSITING, RunEvent.HOLD): _HOLD,
    (RunState.DEPOSITING, RunEvent.INTERLOCK): _HOLD,
    (RunState.DEPOSITING, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH),
    (RunState.HOLDING, RunEvent.ACHIEVED): Transition(RunState.HELD, (Effect.AWAIT_OPERATOR,)),
    (RunState.HOLDING, RunEvent.INTERLOCK): Transition(RunState.HOLDING, ()),
    (RunState.HOLDING, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH),
    (RunState.HELD, RunEvent.RESUME): Transition(
        RunState.PURGING,
        (Effect.ACKNOWLEDGE, Effect.LEAVE_PART, Effect.GAS_ON, Effect.POWDER_ON,
         Effect.AWAIT_STABLE),
    ),
    (RunState.HELD, RunEvent.REFILL): Transition(RunState.OPENING, (Effect.OPEN_HOPPER,)),
    # No operator has come: gas is not kept on for ever, and the run can be recovered later.
    (RunState.HELD, RunEvent.ACHIEVED): Transition(RunState.STOPPING, _STOP),
    (RunState.HELD, RunEvent.INTERLOCK): Transition(RunState.HELD, ()),
    (RunState.HELD, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH),
    # A hopper that could not be made ready, or weighed, is requested again. An open one does not
    # prevent a stop; resuming needs it closed first, since only HELD can be resumed.
    (RunState.OPENING, RunEvent.ACHIEVED): Transition(RunState.REFILLING, (Effect.AWAIT_OPERATOR,)),
    (RunState.OPENING, RunEvent.INTERLOCK): Transition(RunState.HELD, (Effect.AWAIT_OPERATOR,)),
    (RunState.REFILLING, RunEvent.REFILLED): Transition(RunState.WEIGHING, (Effect.CLOSE_HOPPER,)),
    (RunState.REFILLING, RunEvent.ACHIEVED): Transition(RunState.STOPPING, _STOP),
    (RunState.REFILLING, RunEvent.INTERLOCK): Transition(RunState.REFILLING, ()),
    (RunState.WEIGHING, RunEvent.ACHIEVED): Transition(RunState.HELD, (Effect.AWAIT_OPERATOR,)),
    (RunState.WEIGHING, RunEvent.INTERLOCK): Transition(RunState.REFILLING,
                                                        (Effect.AWAIT_OPERATOR,)),
    **{
        (waiting, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH)
        for waiting in (RunState.OPENING, RunState.REFILLING, RunState.WEIGHING)
    },
    (RunState.PURGING, RunEvent.ACHIEVED): Transition(
        RunState.RESUMING, (Effect.ARM_BEAM, Effect.LEAD_POWDER, Effect.START_MOTION)
    ),
    (RunState.PURGING, RunEvent.HOLD): _HOLD,
    (RunState.PURGING, RunEvent.INTERLOCK): _HOLD,
    (RunState.PURGING, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH),
    (RunState.RESUMING, RunEvent.ACHIEVED): Transition(RunState.DEPOSITING, ()),
    (RunState.RESUMING, RunEvent.HOLD): _HOLD,
    (RunState.RESUMING, RunEvent.INTERLOCK): _HOLD,
    (RunState.RESUMING, RunEvent.PROGRAM_DONE): Transition(RunState.FINISHING, _FINISH),
    (RunState.FINISHING, RunEvent.ACHIEVED): Transition(RunState.DONE, ()),
    # The part is made: interlocks are only journaled now, a stop only cuts the post-flow.
    (RunState.FINISHING, RunEvent.INTERLOCK): Transition(RunState.FINISHING, ()),
    (RunState.FINISHING, RunEvent.STOP): Transition(
        RunState.FINISHING, (Effect.REST_BEAM, Effect.POWDER_OFF, Effect.GAS_OFF_NOW)
    ),
    (RunState.FINISHING, RunEvent.FAULT): Transition(RunState.TRIPPED, _STOP),
    # Nothing has been touched yet, so nothing is stopped.
    (RunState.READY, RunEvent.STOP): Transition(RunState.STOPPED, ()),
    (RunState.CONNECTING, RunEvent.STOP): Transition(RunState.STOPPED, ()),
    (RunState.CHECKING, RunEvent.STOP): Transition(RunState.STOPPED, ()),
    **{
        (untouched, event): Transition(RunState.FAULTED, ())
        for untouched in (RunState.READY, RunState.CONNECTING, RunState.CHECKING)
        for event in (RunEvent.INTERLOCK, RunEvent.FAULT)
    },
    # Nothing has been deposited yet: there is nothing to hold for.
    **{
        (starting, RunEvent.INTERLOCK): Transition(RunState.TRIPPED, _STOP)
        for starting in (RunState.GAS, RunState.POWDER, RunState.ARMED)
    },
    **{(live, RunEvent.STOP): Transition(RunState.STOPPING, _STOP) for live in _LIVE},
    **{(live, RunEvent.FAULT): Transition(RunState.TRIPPED, _STOP) for live in _LIVE},
    (RunState.STOPPING, RunEvent.ACHIEVED): Transition(RunState.STOPPED, ()),
    (RunState.STOPPING, RunEvent.STOP): Transition(RunState.STOPPING, _STOP_NOW),
    (RunState.STOPPING, RunEvent.INTERLOCK): Transition(RunState.STOPPING, ()),
    (RunState.STOPPING, RunEvent.FAULT): Transition(RunState.TRIPPED, _STOP),
    (RunState.STOPPING, RunEvent.PROGRAM_DONE): Transition(RunState.STOPPING, ()),
    (RunState.TRIPPED, RunEvent.ACHIEVED): Transition(RunState.FAULTED, ()),
    (RunState.TRIPPED, RunEvent.STOP): Transition(RunState.TRIPPED, _STOP_NOW),
    # One fault brings others (a lost link, then silence): the stop for the first one continues.
    (RunState.TRIPPED, RunEvent.INTERLOCK): Transition(RunState.TRIPPED, ()),
    (RunState.TRIPPED, RunEvent.FAULT): Transition(RunState.TRIPPED, ()),
    (RunState.TRIPPED, RunEvent.PROGRAM_DONE): Transition(RunState.TRIPPED, ()),
}

#: States whose effects continue when one of them fails: each switches something off, and a dead
#: device must not prevent that for the others. In HOLDING this applies to feeders only.
STATES_THAT_FINISH_ALL_EFFECTS = frozenset({RunState.TRIPPED})
GOES_ON_AFTER_INTERLOCK = frozenset({RunState.TRIPPED, RunState.HOLDING})


def next_transition(state: RunState, event: RunEvent) -> Transition:
    """What follows from an event. One the table does not know is a fault.

    Final states stay as they are, whatever comes.
    """
    if state in FINAL_STATES:
        return Transition(state, ())
    return TRANSITIONS.get((state, event)) or TRANSITIONS[state, RunEvent.FAULT]


def table_as_markdown() -> str:
    """The table as Markdown, for the manual: one row a transition."""
    rows = ["| state | event | next state | effects, in order |", "| --- | --- | --- | --- |"]
    order = list(RunState), list(RunEvent)
    for (state, event), (then, effects) in sorted(
        TRANSITIONS.items(), key=lambda row: (order[0].index(row[0][0]), order[1].index(row[0][1]))
    ):
        rows.append(f"| {state} | {event} | {then} | {'; '.join(effects) or '–'} |")
    return "\n".join(rows)
