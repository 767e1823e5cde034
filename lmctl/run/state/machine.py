"""Events in, transitions by the table, effects out: the loop at the centre of a run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

from lmctl.errors import LmctlError
from lmctl.run.interlocks.alarms import Interlock
from lmctl.run.state.table import (
    FINAL,
    GOES_ON,
    GOES_ON_AFTER_INTERLOCK,
    TRANSITIONS,
    Do,
    Event,
    State,
    step,
)

#: States in which nothing has been switched on yet.
_UNTOUCHED = (State.READY, State.CONNECTING, State.CHECKING)


class Logbook(Protocol):
    """Where transitions and faults are written before anything follows from them."""

    def state(self, event: Event, before: State, after: State) -> None: ...
    def fault(self, error: Exception) -> None: ...


class StateMachine:
    """One run's state.

    carry_out : achieves one effect, or raises why it cannot
    halt : beam and motion down, at once; called with what went wrong before anything else

    fault : the first reason the run went wrong, or None
    touched : whether anything may have been switched on or moved
    undone : effects that were not achieved when last tried
    """

    def __init__(
        self, carry_out: Callable[[Do], Awaitable[None]], halt: Callable[[Exception | None], None],
        logbook: Logbook,
    ) -> None:
        self.state = State.READY
        self.fault: Exception | None = None
        self.touched = False
        self.undone: set[Do] = set()
        self._carry_out = carry_out
        self._halt = halt
        self._logbook = logbook
        self._events: asyncio.Queue[tuple[Event, bool]] = asyncio.Queue()
        self._activity: asyncio.Task[None] | None = None

    def post(self, event: Event) -> None:
        """Something has happened. Where the state does not know it, that is a fault."""
        self._events.put_nowait((event, False))

    def wish(self, event: Event) -> bool:
        """Somebody would like something to happen. Returns whether the present state knows it.

        Where the state no longer does when its turn comes (asked twice, say), it is dropped.
        """
        if not self._knows(event):
            return False
        self._events.put_nowait((event, True))
        return True

    def _knows(self, event: Event) -> bool:
        return (self.state, event) in TRANSITIONS

    def trip(self, error: Exception) -> None:
        """Something is wrong: hold at once, then go by the table.

        An `Interlock` holds the run; anything else ends it.
        """
        self._trip(error, Event.INTERLOCK if isinstance(error, Interlock) else Event.FAULT)

    def _effect_failed(self, error: Exception) -> None:
        """What had to be done was not: where no transition answers that, it is a fault."""
        answered = step(self.state, Event.INTERLOCK) != (self.state, ())
        held = isinstance(error, Interlock) and answered
        self._trip(error, Event.INTERLOCK if held else Event.FAULT)

    def _trip(self, error: Exception, event: Event) -> None:
        goes_on = step(self.state, event) == (self.state, ())
        if self.state not in _UNTOUCHED and not goes_on:
            self._halt(error)
        self._note(error, final=not self._is_held_by(event))
        self.post(event)

    def _is_held_by(self, event: Event) -> bool:
        return step(self.state, event).state not in (State.TRIPPED, State.FAULTED)

    async def run(self) -> State:
        """From READY to a final state, which is returned.

        Being cancelled is an operator's stop: it does not end the loop, the machine is brought to
        rest first. Any other exception here is a bug; then the machine is held before it leaves.
        """
        self.post(Event.START)
        try:
            while self.state not in FINAL:
                event, wished = await self._next()
                if not wished or self._knows(event):
                    self._take(event)
        except BaseException:
            self._halt(None)
            raise
        finally:
            if self._activity is not None:
                self._activity.cancel()
        return self.state

    async def _next(self) -> tuple[Event, bool]:
        try:
            return await self._events.get()
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is not None:
                task.uncancel()
            return Event.STOP, True

    def _take(self, event: Event) -> None:
        """One transition: written down, then its effects begin; those still under way break off."""
        before = self.state
        if not self._knows(event):
            self._note(RuntimeError(f"{event!r} came while the run was {before}"), final=True)
        self.state, effects = step(before, event)
        self.touched = self.touched or self.state not in (*_UNTOUCHED, *FINAL)
        try:
            self._logbook.state(event, before, self.state)
        except LmctlError as error:
            self.trip(error)
        if effects:
            self._activity = asyncio.create_task(self._achieve(effects, self._activity))

    async def _achieve(
        self, effects: tuple[Do, ...], earlier: asyncio.Task[None] | None
    ) -> None:
        """The effects of a transition, in order, then the event that they are achieved."""
        if earlier is not None:
            earlier.cancel()
            await asyncio.wait([earlier])
        for do in effects:
            try:
                await self._carry_out(do)
                self.undone.discard(do)
            except Exception as error:
                self.undone.add(do)
                going_on = GOES_ON_AFTER_INTERLOCK if isinstance(error, Interlock) else GOES_ON
                if self.state not in going_on:
                    self._effect_failed(error)
                    return
                self._note(error, final=self.state is State.TRIPPED)
        if self._knows(Event.ACHIEVED):
            self.post(Event.ACHIEVED)

    def _note(self, error: Exception, *, final: bool) -> None:
        """Write down what went wrong; the first that ends the run is its fault."""
        if final and self.fault is None:
            self.fault = error
        try:
            self._logbook.fault(error)
        except LmctlError as unwritten:
            # The journal itself is what fails: there is nothing to write that into.
            self.fault = self.fault or unwritten
