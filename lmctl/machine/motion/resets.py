"""Decide whether a banner answers a reset that was sent, or the controller started by itself."""

from __future__ import annotations

from collections import deque

#: From a reset to the banner of a controller that has power [s].
_TAKES_S = 0.3

#: A board's boot included [s]; a reset whose banner has not come by then was lost.
_LONGEST_S = 5.0


class ResetTracker:
    """The resets sent to one controller. Times are the loop's [s]."""

    def __init__(self) -> None:
        self._sent_s: deque[float] = deque()  # whose banners have not come
        self._to_silent = False  # the first of them went to a controller that did not answer

    def on_reset_sent(self, now_s: float, unanswered_s: float) -> None:
        """A reset was sent. unanswered_s : for how long the controller has not answered `?`"""
        if not self._sent_s:
            self._to_silent = unanswered_s > _TAKES_S
        self._sent_s.append(now_s)

    def on_report(self) -> None:
        """A report came: the controller has power."""
        self._to_silent = False

    def banner_answers_reset(self, now_s: float) -> bool:
        """Whether the banner that has come answers a reset.

        One that comes late, from a controller that had been silent, is that of a start: the reset
        went to a controller without power.
        """
        while self._sent_s and now_s - self._sent_s[0] > _LONGEST_S:  # two may earn one banner
            self._sent_s.popleft()
        if not self._sent_s:
            return False
        took_s = now_s - self._sent_s.popleft()
        return took_s <= _TAKES_S or not self._to_silent
