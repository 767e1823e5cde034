"""Events in, transitions by the table, effects out: the loop at the centre of a run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Protocol

from lmctl.errors import LmctlError
from lmctl.run.states import FINAL, TRANSITIONS, Do, Event, State, step

#: States in which nothing has been switched on yet.
_UNTOUCHED = (State.READY, State.CONNECTING, State.CHECKING)


class Logbook(Protocol):
    """Where transitions and faults are written before anything follows from them."""

    def state(self, event: Event, before: State, after: State) -> None: ...
    def fault(self, error: Exception) -> None: ...


class StateMachine:
    """One run's state.

    carry_out : achieves one effect, or raises why it cannot
    halt : feed hold, at once; called at a fault before anything else

    fault : the first reason the run went wrong, or None
    """

    def __init__(
        self, carry_out: Callable[[Do], Awaitable[None]], halt: Callable[[], None],
        logbook: Logbook,
    ) -> None:
        self.state = State.READY
        self.fault: Exception | None = None
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
        """A reason to end the run: hold at once, then go by the table."""
        if self.state not in _UNTOUCHED and self.state not in FINAL:
            self._halt()
        self._note(error)
        self.post(Event.FAULT)

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
            self._halt()
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
            self._note(RuntimeError(f"{event!r} came while the run was {before}"))
        self.state, effects = step(before, event)
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
            except Exception as error:
                if self.state is not State.TRIPPED:
                    self.trip(error)
                    return
                # Stopping after a fault already: what fails now must not keep the rest from it.
                self._note(error)
        if self._knows(Event.ACHIEVED):
            self.post(Event.ACHIEVED)

    def _note(self, error: Exception) -> None:
        """Write a fault down; the first one is the run's."""
        if self.fault is None:
            self.fault = error
        try:
            self._logbook.fault(error)
        except LmctlError as unwritten:
            # The journal itself is what fails: there is nothing to write that into.
            self.fault = self.fault or unwritten
