"""An event loop whose clock jumps to the next timer as soon as nothing is ready.

Real sockets, ptys and drivers run on it unchanged, and simulated hours pass in seconds, the same
way every time. Three things make that exact:

- The selector is `poll`, asked with a zero timeout. Linux hands the bytes of a pty over in a kernel
  worker: `poll` waits for that worker, epoll (asyncio's default) does not, so with epoll the clock
  would jump over bytes that are on their way.
- A job in a thread (`run_in_executor`, which name resolution uses too) takes real time that the
  clock must not skip: it is stopped until the thread is done.
- A jump lands on the timer's own value, and the clock resolution is one unit in the last place
  there, so exactly the timers due by then fire, however large the clock has grown.

When nothing is ready, no timer is set and no thread works, nothing can ever happen: that raises
`DeadlockError`.
"""

from __future__ import annotations

import asyncio
import math
import selectors
import time
from collections.abc import Callable, Coroutine
from concurrent.futures import Executor
from typing import Any, TypeVar, TypeVarTuple

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

_Ready = list[tuple[selectors.SelectorKey, int]]
_Poll = Callable[[float | None], _Ready]


class DeadlockError(RuntimeError):
    """Every task waits, and no descriptor, timer or thread is left that could wake one."""


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """asyncio loop on a virtual clock that starts at 0.0 s.

    speed : virtual seconds per real second. Infinite (the default) never waits. A finite speed
        paces the clock against real time, for watching; it then waits for outside bytes too, and
        idling is no deadlock.
    """

    def __init__(self, speed: float = math.inf) -> None:
        self._now_s = 0.0
        self._speed = speed
        self._started_s = time.monotonic()  # what a finite speed is paced against
        self._thread_jobs = 0
        super().__init__(_JumpingSelector(self._nothing_ready))
        self._land_on(0.0)
        if not speed > 0.0:
            self.close()
            raise ValueError(f"speed must be above 0, not {speed}")

    def time(self) -> float:
        return self._now_s

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Ts], T], *args: *Ts
    ) -> asyncio.Future[T]:
        future = super().run_in_executor(executor, func, *args)
        self._thread_jobs += 1
        future.add_done_callback(self._thread_job_done)
        return future

    async def shutdown_default_executor(self, *args: Any) -> None:
        # Joins the pool from a thread of its own, which is a thread job like any other.
        self._thread_jobs += 1
        try:
            await super().shutdown_default_executor(*args)
        finally:
            self._thread_jobs -= 1

    def _thread_job_done(self, _: asyncio.Future[Any]) -> None:
        self._thread_jobs -= 1

    def _land_on(self, when_s: float) -> None:
        self._now_s = when_s
        # asyncio fires timers *below* now + resolution.
        self._clock_resolution = math.ulp(when_s)

    def _nothing_ready(self, timeout_s: float | None, poll: _Poll) -> _Ready:
        """Let the clock move on by at most timeout_s (None: no timer is set)."""
        if self._thread_jobs:
            return poll(None)
        if timeout_s is None:
            if self._speed < math.inf:
                return self._wait_in_real_time(math.inf, poll)
            raise DeadlockError(
                "the simulation is stuck: every task is waiting, and no byte, timer or thread job "
                f"is left to wake one (virtual clock at {self._now_s:.6f} s)"
            )
        # The timer's own value, where now + timeout_s may be a rounding error away from it; asyncio
        # has no public way to it.
        due_s: float = self._scheduled[0].when()  # type: ignore[attr-defined]
        if self._speed < math.inf:
            return self._wait_in_real_time(due_s, poll)
        self._land_on(due_s)
        return []

    def _wait_in_real_time(self, due_s: float, poll: _Poll) -> _Ready:
        remaining_s = (due_s - self._paced_s()) / self._speed
        ready = poll(None if remaining_s == math.inf else max(0.0, remaining_s))
        self._land_on(max(self._now_s, min(due_s, self._paced_s())) if ready else due_s)
        return ready

    def _paced_s(self) -> float:
        return (time.monotonic() - self._started_s) * self._speed


class _JumpingSelector(selectors.PollSelector):
    def __init__(self, nothing_ready: Callable[[float | None, _Poll], _Ready]) -> None:
        super().__init__()
        self._nothing_ready = nothing_ready

    def select(self, timeout: float | None = None) -> _Ready:
        ready = super().select(0)
        if ready or (timeout is not None and timeout <= 0.0):
            return ready
        return self._nothing_ready(timeout, super().select)


def run_in_virtual_time(main: Coroutine[Any, Any, T], *, speed: float = math.inf) -> T:
    """Run main to its end on a fresh virtual-time loop, as `asyncio.run` does on a real one.

    Ctrl-C cancels main, lets its cleanup run (in virtual time) and raises KeyboardInterrupt.
    Raises DeadlockError when nothing can wake any task; the tasks are then cancelled.
    """
    try:
        with asyncio.Runner(loop_factory=lambda: VirtualTimeLoop(speed)) as runner:
            return runner.run(main)
    finally:
        main.close()  # without effect unless it never started
