"""When a feed override takes effect: where powder can follow it; the last request counts.

The powder in the hoses was sent for the override planned before. So a new one is set in a travel
that powder sent from now on can still reach; where none comes soon, it is set in the bead, when
that powder arrives. Until powder has begun to follow, a later request replaces it; from then on it
is completed first, and the later request follows.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from firmware_protocol.realtime import RealtimeCommand
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.override_limits import override_bytes
from lmctl.run.program.program_clock import ProgramClock

#: An override waits so long for a travel in which it can be set [s].
_WITHIN_S = 60.0

#: The travel must begin so much later than powder sent now arrives [s]: a report and two ticks.
_NOTICE_S = 0.3

#: In a bead, powder changes over so much program time [s].
_IN_BEAD_S = 0.3

#: At the latest this long after its program time it is due [s].
_DUE_S = 1e-3


class FeedOverride:
    """The feed override of one run, from where it is entered to the next hold.

    lead_s : answers the transport time of the powder, which a purge may measure anew
    status_period_s : how often `look` is called while one is planned
    realtime : sends a byte to the controller at once
    """

    def __init__(
        self, clock: ProgramClock, window: JobWindow, lead_s: Callable[[], float],
        status_period_s: float, realtime: Callable[[RealtimeCommand], None],
    ) -> None:
        self._clock = clock
        self._window = window
        self._lead_s = lead_s
        self._period_s = status_period_s
        self._realtime = realtime
        self._asked = 100  # percent
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def request(self, percent: int) -> None:
        """It is to be `percent`: when `plan` is called."""
        self._asked = percent

    def apply_now(self, t: float, percent: int) -> None:
        """Set it at once."""
        self._asked = percent
        self._clock.cancel_scheduled_override()
        self._set(t, percent)

    def schedule(self, t: float) -> None:
        """Find the place at which to set the requested override."""
        clock, rate = self._clock, self._asked / 100.0
        powder_s = clock.program_time_ahead_s(t, self._lead_s() + _NOTICE_S)
        if clock.is_override_pending_before(powder_s):
            return  # powder is on its way for that one: `look` comes back to this
        clock.cancel_scheduled_override()
        if rate == clock.rate:
            return
        span_s = self._window.next_beam_off_span_s(
            powder_s, clock.program_time_ahead_s(t, _WITHIN_S))
        clock.schedule_override(*(span_s or (powder_s, powder_s + _IN_BEAD_S)), rate)

    def cancel(self) -> None:
        """Cancel the planned override."""
        if self._timer is not None:
            self._timer.cancel()

    def apply_if_due(self, t: float) -> None:
        """Set what was planned if it is time for it, or when it will be before the next report."""
        due = self._clock.due_override(t)
        if due is None:
            due_s = self._clock.override_due_in_s(t) + _DUE_S
            if _DUE_S < due_s < self._period_s:
                self.cancel()
                self._timer = self._loop.call_at(t + due_s, self._look_again)
        else:
            percent = round(due * 100.0)
            self._set(t, percent)
            if self._asked != percent:
                self.schedule(t)

    def _look_again(self) -> None:
        self.apply_if_due(self._loop.time())

    def _set(self, t: float, percent: int) -> None:
        for byte in override_bytes(percent):
            self._realtime(byte)
        self._clock.set_override(t, percent / 100.0)
