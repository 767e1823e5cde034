"""A common tick for periodic work: timers that fall due together wake the loop once.

Separate turns of the loop for a status query, two feeders' heartbeats and a set-point are a fifth
of the cost of a machine second in a dry run.
"""

from __future__ import annotations

import math

_TICKS_PER_S = 10
_EARLY = 1e-6  # of a beat, that rounding may have taken


def align_to_tick(at_s: float, after_s: float) -> float:
    """The last tick up to at_s [s, of the loop's clock]; at_s itself where that is not after_s."""
    tick_s = math.floor(at_s * _TICKS_PER_S + _EARLY) / _TICKS_PER_S
    return tick_s if tick_s > after_s else at_s
