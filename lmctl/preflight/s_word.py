"""Resolution of the beam power in S words."""

from __future__ import annotations

#: Least number of S-word steps to full power.
_STEPS = 10_000


def s_word_decimals(s_max: int) -> int:
    """Decimals of S words where `s_max` (1 or more) means full power: one for the usual 1000."""
    decimals = 0
    while s_max * 10**decimals < _STEPS:
        decimals += 1
    return decimals
