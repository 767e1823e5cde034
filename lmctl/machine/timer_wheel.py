"""A common beat for what is done again and again: timers that fall due together wake the loop once.

A turn of the loop for each of a status question, two feeders' heartbeats and a set-point is a fifth
of what a machine second of a dry run costs.
"""

from __future__ import annotations

import math

_BEATS_PER_S = 10
_EARLY = 1e-6  # of a beat, that rounding may have taken


def align_to_tick(at_s: float, after_s: float) -> float:
    """The last beat up to at_s [s, of the loop's clock]; at_s itself where that is not after_s."""
    beat_s = math.floor(at_s * _BEATS_PER_S + _EARLY) / _BEATS_PER_S
    return beat_s if beat_s > after_s else at_s
