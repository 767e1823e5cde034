"""Events in, transitions by the table, effects out: the loop at the centre of a run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import NamedTuple, Protocol

from lmctl.errors import LmctlError
from lmctl.run.interlocks.alarms import InterlockError
from lmctl.run.state.transitions import (
    FINAL_STATES,
    GOES_ON_AFTER_INTERLOCK,
    STATES_THAT_FINISH_ALL_EFFECTS,
    TRANSITIONS,
    Effect,
    RunEvent,
    RunState,
    next_transition,
)

#: States in which nothing has been switched on yet.
_UNTOUCHED = (RunState.READY, RunState.CONNECTING, RunState.CHECKING)

#: States with the beam on, and requests that end it: those do not wait for the disk.
_BEAM_ON = (RunState.DEPOSITING, RunState.RESUMING)
_ENDS_BEAM = (RunEvent.HOLD, RunEvent.STOP)


class _Said(NamedTuple):
    """An event on its way to the table.

    is_request : dropped, instead of a fault, if the state does not accept it when its turn comes
    by : whose effects have been achieved; it counts only for as long as none have begun since
    """

    event: RunEvent
    is_request: bool = False
    by: asyncio.Task[None] | None = None


class TransitionLog(Protocol):
    """Where transitions and faults are written before anything follows from them."""

    def record_state(self, event: RunEvent, before: RunState, after: RunState) -> None: ...
    def record_fault(self, error: Exception) -> None: ...


class RunStateMachine:
    """One run's state.

    carry_out : achieves one effect, or raises why it cannot
    halt : stops beam and motion at once; called first, with what went wrong (None: nothing did)

    fault : the first reason the run went wrong, or None
    touched : whether anything may have been switched on or moved
    finished : whether the program was done, so that nothing is left to deposit
    undone : effects that were not achieved when last tried
    """

    def __init__(
        self, carry_out: Callable[[Effect], Awaitable[None]],
        halt: Callable[[Exception | None], None],
        logbook: TransitionLog,
    ) -> None:
        self.state = RunState.READY
        self.fault: Exception | None = None
        self.touched = self.finished = False
        self.undone: set[Effect] = set()
        self._carry_out = carry_out
        self._halt = halt
        self._logbook = logbook
        self._events: asyncio.Queue[_Said] = asyncio.Queue()
        self._activity: asyncio.Task[None] | None = None
        self._under_way: set[asyncio.Task[None]] = set()  # also those broken off, until they end

    def post_event(self, event: RunEvent) -> None:
        """Report an event that has happened. It is a fault if the state does not accept it."""
        self._events.put_nowait(_Said(event))

    def request_event(self, event: RunEvent) -> bool:
        """Request an event. Returns whether the present state accepts it.

        It is dropped if the state no longer accepts it when its turn comes (requested twice, say).
        What ends beam and motion does so before this returns: the transition that follows, and
        the act of the operator, are journaled durably, and a disk may take its time.
        """
        if not self._knows(event):
            return False
        if event in _ENDS_BEAM and self.state in _BEAM_ON:
            self._break_off()  # or it may start motion again before the event's turn has come
            self._halt(None)
        self._events.put_nowait(_Said(event, is_request=True))
        return True

    def _knows(self, event: RunEvent) -> bool:
        return (self.state, event) in TRANSITIONS

    def trip(self, error: Exception) -> None:
        """Take an error: hold at once, then follow the table.

        An `InterlockError` holds the run; anything else ends it.
        """
        self._trip(error,
                   RunEvent.INTERLOCK if isinstance(error, InterlockError) else RunEvent.FAULT)

    def _effect_failed(self, error: Exception) -> None:
        """An effect has failed: it is a fault where no transition handles that."""
        answered = next_transition(self.state, RunEvent.INTERLOCK) != (self.state, ())
        held = isinstance(error, InterlockError) and answered
        self._trip(error, RunEvent.INTERLOCK if held else RunEvent.FAULT)

    def _trip(self, error: Exception, event: RunEvent) -> None:
        goes_on = next_transition(self.state, event) == (self.state, ())
        if self.state not in _UNTOUCHED and not goes_on:
            self._break_off()  # or it may start motion again before its turn has come
            self._halt(error)
        self._note(error, final=not self._is_held_by(event))
        self.post_event(event)

    def _is_held_by(self, event: RunEvent) -> bool:
        return next_transition(self.state, event).state not in (RunState.TRIPPED, RunState.FAULTED)

    async def run(self) -> RunState:
        """From READY to a final state, which is returned.

        Being cancelled is an operator's stop: it does not end the loop, the machine is brought to
        rest first. Any other exception here is a bug; then the machine is held before it leaves.
        """
        self.post_event(RunEvent.START)
        try:
            while self.state not in FINAL_STATES:
                said = await self._next()
                if self._counts(said):
                    self._take(said.event)
        except BaseException:
            self._halt(None)
            raise
        finally:
            self._break_off()
            await self._all_ended()
        return self.state

    async def _next(self) -> _Said:
        try:
            return await self._events.get()
        except asyncio.CancelledError:
            _stay()
            return _Said(RunEvent.STOP, is_request=True)

    def _counts(self, said: _Said) -> bool:
        """Whether an event is still valid, now that its turn has come."""
        if said.by is not None:
            return said.by is self._activity
        return not said.is_request or self._knows(said.event)

    async def _all_ended(self) -> None:
        """Return when every effect has ended and released its resources."""
        while self._under_way:
            try:
                await asyncio.wait(self._under_way)
            except asyncio.CancelledError:
                _stay()

    def _take(self, event: RunEvent) -> None:
        """One transition: journal it, then begin its effects; cancel those still under way."""
        before = self.state
        if not self._knows(event):
            self._note(RuntimeError(f"{event!r} came while the run was {before}"), final=True)
        self.state, effects = next_transition(before, event)
        self.touched = self.touched or self.state not in (*_UNTOUCHED, *FINAL_STATES)
        self.finished = self.finished or self.state is RunState.FINISHING
        try:
            self._logbook.record_state(event, before, self.state)
        except LmctlError as error:
            self.trip(error)
        if effects:
            self._break_off()
            earlier = frozenset(self._under_way)
            self._activity = asyncio.create_task(self._achieve(effects, earlier))
            self._under_way.add(self._activity)
            self._activity.add_done_callback(self._under_way.discard)

    def _break_off(self) -> None:
        """From now on no further effect begins, and a completed effect no longer counts.

        Effects may end in the same turn of the loop in which others are to begin.
        """
        if self._activity is not None:
            self._activity.cancel()
            self._activity = None

    async def _achieve(
        self, effects: tuple[Effect, ...], earlier: frozenset[asyncio.Task[None]]
    ) -> None:
        """The effects of a transition, in order, then the event that they are achieved."""
        me = asyncio.current_task()
        if earlier:
            await asyncio.wait(earlier)
        for do in effects:
            if me is not self._activity:  # broken off, and the effect before did not let that out
                return
            try:
                await self._carry_out(do)
                self.undone.discard(do)
            except Exception as error:
                self.undone.add(do)
                if me is not self._activity:
                    self._note(error, final=False)
                    return
                states = GOES_ON_AFTER_INTERLOCK if isinstance(
                    error, InterlockError) else STATES_THAT_FINISH_ALL_EFFECTS
                if self.state not in states:
                    self._effect_failed(error)
                    return
                self._note(error, final=self.state is RunState.TRIPPED)
        if me is self._activity and self._knows(RunEvent.ACHIEVED):
            self._events.put_nowait(_Said(RunEvent.ACHIEVED, by=me))

    def _note(self, error: Exception, *, final: bool) -> None:
        """Journal an error; the first that ends the run is its fault."""
        if final and self.fault is None:
            self.fault = error
        try:
            self._logbook.record_fault(error)
        except LmctlError as unwritten:
            # The journal itself has failed: the error cannot be journaled.
            self.fault = self.fault or unwritten


def _stay() -> None:
    """Being cancelled does not end a run at once: clear the cancellation and continue."""
    task = asyncio.current_task()
    if task is not None:
        task.uncancel()
