"""Remaining machine time: the pace of the run so far, applied to the rest of the program."""

from __future__ import annotations

#: Shortest time between two progress reports [s].
_EVERY_S = 1.0

#: The pace is measured over at least this program time; before that the plan counts [s].
_MIN_S = 5.0


class RemainingTime:
    """Machine time left, from how long program time has taken since the feed override changed.

    end_s : program time at the end of the job
    """

    def __init__(self, end_s: float) -> None:
        self._end_s = end_s
        self._rate = 0.0
        self._since = (0.0, 0.0)  # machine and program time from which the pace is measured
        self._reported_t = -_EVERY_S

    def remaining_s(self, t: float, s: float, rate: float) -> float | None:
        """Machine time left at t, when program time is s; None where it was just reported."""
        if rate != self._rate:
            self._rate = rate
            self._since = (t, s)
        if t - self._reported_t < _EVERY_S:
            return None
        self._reported_t = t
        taken_s, done_s = t - self._since[0], s - self._since[1]
        pace = taken_s / done_s if done_s >= _MIN_S else 1.0 / rate
        return (self._end_s - s) * pace
