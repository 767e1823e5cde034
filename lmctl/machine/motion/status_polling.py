"""When to ask `?`, how old the last answer is, and when a controller counts as silent.

A status report has no checksum and `?` no acknowledgement, so either may be lost or damaged, and a
reset swallows a question that is open (both firmwares clear the flag that `?` sets). So a question
is asked again: as soon as its answer is late, once per restart, and within 20 ms of an answer that
cannot be read or believed. Several questions at once do no harm: `?` is a flag in the firmware.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from lmctl.machine.timer_wheel import align_to_tick

SILENCE_TIMEOUT_S = 3.0

#: From an answer that cannot be read or believed to the next question [s]; the first of a period
#: is put at once.
REPEAT_DELAY_S = 0.005

#: An answer is late after twice the time that answers took lately and this, and not sooner than
#: this; after a period in any case [s].
_LATE_S = 0.04

#: How fast an answer that took long is forgotten, an answer.
_FORGETS = 0.8

#: Most quick queries in one period: on a line that garbles everything they must not go on for ever.
_QUICK_MOST = 12

#: How many queries must stay unanswered before a controller counts as silent: a computer that slept
#: for a while has sent only one.
_SILENT_QUESTIONS = 3


class StatusPolling:
    """Asks for a status report every period, on the tick, and again where none comes.

    ask : writes the `?`
    silent : called once when nothing believable has come for `SILENT_S`
    unreadable : answers since the last believable report that could not be read or believed
    times_put : how often the open question has been put; 0 without one
    """

    def __init__(
        self, period_s: float, ask: Callable[[], None], silent: Callable[[str], None]
    ) -> None:
        self.unreadable = 0
        self._period_s = period_s
        self._ask = ask
        self._silent = silent
        self._loop = asyncio.get_running_loop()
        self._asked_s: float | None = None  # when the open question was put last
        self._open_since_s: float | None = None  # when it was first put; silence counts from here
        self._answered_s: float | None = None
        self._takes_s = 0.0  # what an answer takes, the slow ones of late
        self.times_put = 0
        self._quick_left = _QUICK_MOST
        self._quick_since_s = self._loop.time()
        self._timer: asyncio.TimerHandle | None = None
        self._retry: asyncio.TimerHandle | None = None

    @property
    def age_s(self) -> float:
        """Seconds since the last believable report; infinite before the first."""
        return float("inf") if self._answered_s is None else self._loop.time() - self._answered_s

    @property
    def unanswered_s(self) -> float:
        """For how long the open question has been put without a believable answer; 0 without."""
        opened_s = self._open_since_s
        return 0.0 if opened_s is None else self._loop.time() - opened_s

    @property
    def repeat_timeout_s(self) -> float:
        """How long an answer is waited for before the question is put again."""
        return min(self._period_s, 2.0 * self._takes_s + _LATE_S)

    @property
    def is_query_open(self) -> bool:
        """Whether a query is unanswered."""
        return self._asked_s is not None

    @property
    def is_query_repeated(self) -> bool:
        """Whether the open question has been put more than once."""
        return self.times_put > 1

    def start(self) -> None:
        """Ask now and every period from now on."""
        self.stop()
        self._tick()

    def stop(self) -> None:
        """Stop asking, and no longer report the controller as silent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._close_question()

    def query_now(self) -> None:
        """Ask outside the schedule, unless a question is open: that is put again by itself."""
        if self._asked_s is None:
            self._put_question()

    def abandon_query(self) -> None:
        """The open question will not be waited for: the next may be put at once."""
        self._asked_s = None
        self._wait_no_more()

    def on_report(self) -> None:
        """A report has arrived, and is believed."""
        now_s = self._loop.time()
        if self._open_since_s is not None:
            self._takes_s = max(now_s - self._open_since_s, _FORGETS * self._takes_s)
        self._answered_s = now_s
        self.unreadable = 0
        self._close_question()

    def on_unreadable_report(self) -> None:
        """Something has arrived that cannot be read or believed: ask again within 20 ms."""
        self.unreadable += 1
        self.query_next_tick()

    def query_next_tick(self) -> None:
        """A report is to be confirmed by another: ask within 20 ms.

        Not more often than `_QUICK_MOST` times a period; the next question then comes in its time.
        """
        now_s = self._loop.time()
        if now_s - self._quick_since_s >= self._period_s:
            self._quick_since_s, self._quick_left = now_s, _QUICK_MOST
        if self._quick_left > 0:
            self._put_in(0.0 if self._quick_left == _QUICK_MOST else REPEAT_DELAY_S)
            self._quick_left -= 1

    def on_restart(self) -> None:
        """The controller restarted, and an open query was lost with its receive buffer."""
        if self._open_since_s is not None or self._timer is not None:
            self._close_question()
            self._put_question()

    def _close_question(self) -> None:
        """Nothing is waited for, and silence counts anew from the next question."""
        self._open_since_s = None
        self.times_put = 0
        self.abandon_query()

    def _put_question(self) -> None:
        self._asked_s = self._loop.time()
        self.times_put += 1
        if self._open_since_s is None:
            self._open_since_s = self._asked_s
            self._put_in(self.repeat_timeout_s)
        else:
            self._put_in(min(self._period_s, _LATE_S))
        self._ask()

    def _put_in(self, seconds: float) -> None:
        self._wait_no_more()
        self._retry = self._loop.call_later(seconds, self._put_again)

    def _put_again(self) -> None:
        self._retry = None
        if not self._is_silent():
            self._put_question()

    def _wait_no_more(self) -> None:
        if self._retry is not None:
            self._retry.cancel()
            self._retry = None

    def _is_silent(self) -> bool:
        """Whether the controller counts as silent from now on; reported once."""
        if self._timer is None or self._open_since_s is None:
            return False
        if self.times_put < _SILENT_QUESTIONS:
            return False
        silent_s = self._loop.time() - self._open_since_s
        if silent_s < SILENCE_TIMEOUT_S:
            return False
        disturbed = self.unreadable
        self.stop()
        self._silent(
            f"nothing readable in answer to '?' for {silent_s:.1f} s" if disturbed
            else f"no answer to '?' for {silent_s:.1f} s"
        )
        return True

    def _tick(self) -> None:
        now_s = self._loop.time()
        if self._is_silent():
            return
        self._timer = self._loop.call_at(align_to_tick(now_s + self._period_s, now_s), self._tick)
        self.query_now()
