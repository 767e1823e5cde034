"""When to ask `?`, how old the last answer is, and when a controller counts as silent."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from lmctl.machine.beat import on_beat

SILENT_S = 3.0
_LEAST_RETRY_S = 0.5
_RETRY_PERIODS = 3


class StatusWatch:
    """Asks for a status report every period, on the beat, with at most one question open.

    ask : writes the `?`
    silent : called once when nothing has answered for `SILENT_S`
    """

    def __init__(
        self, period_s: float, ask: Callable[[], None], silent: Callable[[str], None]
    ) -> None:
        self._period_s = period_s
        self._retry_s = max(_LEAST_RETRY_S, _RETRY_PERIODS * period_s)
        self._ask = ask
        self._silent = silent
        self._loop = asyncio.get_running_loop()
        self._asked_s: float | None = None  # when the open question was put last
        self._open_since_s: float | None = None  # when it was first put; silence counts from here
        self._answered_s: float | None = None
        self._timer: asyncio.TimerHandle | None = None

    @property
    def age_s(self) -> float:
        """Seconds since the last report; infinite before the first."""
        return float("inf") if self._answered_s is None else self._loop.time() - self._answered_s

    def start(self) -> None:
        """Ask now and every period from now on."""
        self.stop()
        self._asked_s = self._open_since_s = None
        self._tick()

    def stop(self) -> None:
        """Ask no more, and call nobody silent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def ask_now(self) -> None:
        """Ask outside the schedule, unless a question is open that may yet be answered."""
        now_s = self._loop.time()
        if self._asked_s is None or now_s - self._asked_s >= self._retry_s:
            self._asked_s = now_s
            if self._open_since_s is None:
                self._open_since_s = now_s
            self._ask()

    def given_up(self) -> None:
        """The open question will not be waited for: the next may be put at once."""
        self._asked_s = None

    def answered(self) -> None:
        """A report has arrived."""
        self._asked_s = self._open_since_s = None
        self._answered_s = self._loop.time()

    def _tick(self) -> None:
        now_s = self._loop.time()
        # Only a question can be met with silence: a computer that slept for a while has put none.
        if self._open_since_s is not None and now_s - self._open_since_s >= SILENT_S:
            self._timer = None
            self._silent(f"no answer to '?' for {now_s - self._open_since_s:.1f} s")
            return
        self.ask_now()
        self._timer = self._loop.call_at(on_beat(now_s + self._period_s, now_s), self._tick)
