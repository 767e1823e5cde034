"""Events that come in the very turn of the loop in which an effect ends.

Whatever the two race for, what follows must be what one of their orders would have brought: no
effect of a transition that another has broken off begins, and what it achieved is not taken for
an achievement of the next.
"""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import MachineError
from lmctl.run.interlocks.alarms import InterlockError
from lmctl.run.state.state_machine import RunStateMachine
from lmctl.run.state.transitions import (
    FINAL_STATES,
    TRANSITIONS,
    Effect,
    RunEvent,
    RunState,
    next_transition,
)

LAYING = (RunEvent.ACHIEVED,) * 5
TO = {
    RunState.CONNECTING: (),
    RunState.CHECKING: LAYING[:1],
    RunState.GAS: LAYING[:2],
    RunState.POWDER: LAYING[:3],
    RunState.ARMED: LAYING[:4],
    RunState.DEPOSITING: LAYING,
    RunState.HOLDING: (*LAYING, RunEvent.HOLD),
    RunState.HELD: (*LAYING, RunEvent.HOLD, RunEvent.ACHIEVED),
    RunState.PURGING: (*LAYING, RunEvent.HOLD, RunEvent.ACHIEVED, RunEvent.RESUME),
    RunState.RESUMING: (*LAYING, RunEvent.HOLD, RunEvent.ACHIEVED, RunEvent.RESUME,
                        RunEvent.ACHIEVED),
    RunState.FINISHING: (*LAYING, RunEvent.PROGRAM_DONE),
    RunState.STOPPING: (*LAYING, RunEvent.STOP),
    RunState.TRIPPED: (*LAYING, RunEvent.FAULT),
}
HAPPENS = [event for event in RunEvent if event not in (RunEvent.START, RunEvent.ACHIEVED)]
REQUESTS = (RunEvent.HOLD, RunEvent.RESUME, RunEvent.STOP)
#: Done without letting go of the loop, as they are on the cell.
AT_ONCE = (Effect.START_MOTION,)


def effects_in(state: RunState) -> tuple[Effect, ...]:
    before, effects = RunState.READY, ()
    for event in (RunEvent.START, *TO[state]):
        before, effects = next_transition(before, event)
    assert before is state
    return effects


class Rig:
    """A machine whose effects end when they are let; its log of states entered, effects begun."""

    def __init__(self) -> None:
        self.log: list[RunState | Effect | str] = []
        self.ending: asyncio.Future[None] | None = None
        self.machine = RunStateMachine(self.carry_out, lambda _: self.log.append("halt"), self)

    async def carry_out(self, do: Effect) -> None:
        self.log.append(do)
        if do in AT_ONCE:
            return
        self.ending = ending = asyncio.get_running_loop().create_future()
        try:
            await ending
        finally:
            if self.ending is ending:
                self.ending = None

    def record_state(self, event: RunEvent, before: RunState, after: RunState) -> None:
        self.log.append(after)

    def record_fault(self, error: Exception) -> None:
        pass

    def end(self) -> None:
        """The effect under way ends."""
        if self.ending is not None and not self.ending.done():
            self.ending.set_result(None)

    def happen(self, event: RunEvent) -> None:
        if event in REQUESTS:
            self.machine.request_event(event)
        elif event is RunEvent.FAULT:
            self.machine.trip(MachineError("broken"))
        elif event is RunEvent.INTERLOCK:
            self.machine.trip(InterlockError("gas", "gas is low"))
        else:
            self.machine.post_event(event)

    async def settle(self) -> None:
        for _ in range(12):
            await asyncio.sleep(0)

    async def go_to(self, state: RunState, effect: Effect) -> None:
        for event in TO[state]:
            if event is RunEvent.ACHIEVED:
                before = self.machine.state
                while self.machine.state is before:
                    self.end()
                    await self.settle()
            else:
                self.happen(event)
                await self.settle()
        while self.log[-1] is not effect:
            self.end()
            await self.settle()

    async def to_the_end(self) -> None:
        while self.machine.state not in FINAL_STATES:
            if self.ending is None:
                self.happen(RunEvent.STOP)
            self.end()
            await self.settle()


class Reference:
    """The table, one happening at a time."""

    def __init__(self, state: RunState, effects: tuple[Effect, ...]) -> None:
        self.state, self.left = state, list(effects)
        self.log: list[RunState | Effect | str] = []

    def take(self, event: RunEvent) -> None:
        if event in REQUESTS and (self.state, event) not in TRANSITIONS:
            return
        if self.state in FINAL_STATES:
            return
        self.state, effects = next_transition(self.state, event)
        self.log.append(self.state)
        if effects:
            self.left = list(effects)
            self.begin()

    def begin(self) -> None:
        self.log.append(self.left[0])
        if self.left[0] in AT_ONCE:
            self.end()

    def end(self, then: tuple[RunEvent, ...] = ()) -> None:
        """The effect under way ends; `then` comes before it is known that all is achieved."""
        self.left.pop(0)
        if self.left:
            self.begin()
        for event in then:
            self.take(event)
        if not self.left and (self.state, RunEvent.ACHIEVED) in TRANSITIONS:
            self.take(RunEvent.ACHIEVED)

    def to_the_end(self) -> list[RunState | Effect | str]:
        while self.state not in FINAL_STATES:
            if self.left:
                self.end()
            else:
                self.take(RunEvent.STOP)
        return self.log


def orders(state: RunState, left: tuple[Effect, ...],
           event: RunEvent) -> list[list[RunState | Effect | str]]:
    """What may follow: the event first; the end first; or the end, but known only after it."""
    event_first = Reference(state, left)
    event_first.take(event)
    if event_first.left == list(left):
        event_first.end()
    end_first = Reference(state, left)
    end_first.end()
    end_first.take(event)
    known_later = Reference(state, left)
    if len(left) == 1 or left[1] in AT_ONCE:
        known_later.left = []
        known_later.log += left[1:]
        before = known_later.left
        known_later.take(event)
        if known_later.left is before and known_later.state not in FINAL_STATES:
            known_later.take(RunEvent.ACHIEVED)
    return [one.to_the_end() for one in (event_first, end_first, known_later)]


CASES = [(state, effect, event) for state in TO for effect in effects_in(state)
         for event in HAPPENS if effect not in AT_ONCE]


@pytest.mark.parametrize("event_first", [True, False], ids=["event first", "end first"])
@pytest.mark.parametrize(("state", "effect", "event"), CASES)
def test_what_follows_is_what_one_order_of_the_two_would_bring(state, effect, event, event_first):
    effects = effects_in(state)
    rig = Rig()

    async def main() -> None:
        running = asyncio.create_task(rig.machine.run())
        await rig.settle()
        await rig.go_to(state, effect)
        del rig.log[:]
        both = [lambda: rig.happen(event), rig.end]
        for act in both if event_first else reversed(both):
            act()
        await rig.settle()
        await rig.to_the_end()
        await running

    asyncio.run(main())
    followed = [one for one in rig.log if one != "halt"]
    assert followed in orders(state, effects[effects.index(effect):], event)
    for at, one in enumerate(rig.log[:-1]):
        if one == "halt":  # beam and motion are down: no effect begins before the table is asked
            assert not isinstance(rig.log[at + 1], Effect), rig.log
