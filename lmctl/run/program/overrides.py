"""Feed override by real-time bytes (protocol 4): 100 %, then steps of ten and of one."""

from __future__ import annotations

from firmware_protocol.realtime import Realtime

#: Below half speed the send horizon could not be kept: two planned lines would already exceed it.
LEAST_PERCENT, MOST_PERCENT = 50, 200

#: Rapids and power as programmed.
NO_OTHER_OVERRIDE = (Realtime.RAPID_100, Realtime.SPINDLE_100)


def override_bytes(percent: int) -> list[Realtime]:
    """The bytes that set the feed override, from whatever it is. percent : 50 to 200."""
    if not LEAST_PERCENT <= percent <= MOST_PERCENT:
        raise ValueError(f"{percent} % is not from {LEAST_PERCENT} to {MOST_PERCENT}")
    difference = percent - 100
    coarse, fine = divmod(abs(difference), 10)
    up = difference > 0
    return [
        Realtime.FEED_100,
        *[Realtime.FEED_PLUS_10 if up else Realtime.FEED_MINUS_10] * coarse,
        *[Realtime.FEED_PLUS_1 if up else Realtime.FEED_MINUS_1] * fine,
    ]
