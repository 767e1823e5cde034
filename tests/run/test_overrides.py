"""Real-time bytes that set a feed override."""

from __future__ import annotations

import pytest

from firmware_protocol.realtime import Realtime
from lmctl.run.program.overrides import LEAST_PERCENT, MOST_PERCENT, override_bytes

STEP = {
    Realtime.FEED_PLUS_10: 10, Realtime.FEED_MINUS_10: -10, Realtime.FEED_PLUS_1: 1,
    Realtime.FEED_MINUS_1: -1,
}


def test_every_override_is_reached_from_any_other():
    for percent in range(LEAST_PERCENT, MOST_PERCENT + 1):
        first, *steps = override_bytes(percent)
        assert first is Realtime.FEED_100
        assert 100 + sum(STEP[byte] for byte in steps) == percent


@pytest.mark.parametrize("percent", [0, 49, 201, -60])
def test_others_are_refused(percent):
    with pytest.raises(ValueError, match="is not from 50 to 200"):
        override_bytes(percent)
