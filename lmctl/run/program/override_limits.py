"""Feed override: how far it may go, and the real-time bytes for it.

The bytes set 100 %, then steps of ten and of one.
Source: docs/explanation/motion-link.md, Real-time bytes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_protocol.realtime import RealtimeCommand
from lmctl.config.machine import MachineProfile
from lmctl.errors import UsageError
from lmctl.job.schema import JobManifest

#: Below half speed the send horizon could not be kept: two planned lines would already exceed it.
LEAST_PERCENT, MOST_PERCENT = 50, 200

#: Rapids and power as programmed.
NO_OTHER_OVERRIDE = (RealtimeCommand.RAPID_100, RealtimeCommand.SPINDLE_100)

_SLACK = 1e-6  # of peaks, which may be rounded up to what the machine has


@dataclass(frozen=True)
class OverrideRange:
    """Range of a feed override. limit : what allows no more than most_percent, in words"""

    most_percent: int = MOST_PERCENT
    limit: str = ""

    def check(self, percent: int) -> None:
        """Raise UsageError for an override that is out of range."""
        if not LEAST_PERCENT <= percent <= self.most_percent:
            raise UsageError(f"a feed override of {percent} % is not possible",
                             where=[self.limit] if percent > self.most_percent else [],
                             hint=f"give {LEAST_PERCENT} to {self.most_percent}")


def override_range(manifest: JobManifest, profile: MachineProfile) -> OverrideRange:
    """How far a job's beam and powder can follow its speed, by the peaks in the manifest.

    Beyond that a millimetre would get less energy, or less of one powder, than was planned for it.
    """
    flows: dict[str, float] = manifest.totals.get("peak_flow_g_min", {})
    limits = [
        (profile.laser.max_power_W, float(manifest.totals.get("peak_power_W", 0.0)),
         "the job asks for {1:g} W, and the laser has {0:g}"),
        *(
            (hopper.max_flow_g_min, flows.get(hopper.name, 0.0),
             f"the job asks for {{1:.1f}} g/min of hopper {hopper.name}, which delivers {{0:g}}")
            for hopper in profile.hopper
        ),
    ]
    found = OverrideRange()
    for most, peak, words in limits:
        percent = math.floor(100.0 * most / peak * (1.0 + _SLACK)) if peak > 0.0 else MOST_PERCENT
        if percent < found.most_percent:
            found = OverrideRange(max(percent, 100), words.format(most, peak))
    return found


def override_bytes(percent: int) -> list[RealtimeCommand]:
    """The bytes that set the feed override, from whatever it is. percent : 50 to 200."""
    if not LEAST_PERCENT <= percent <= MOST_PERCENT:
        raise ValueError(f"{percent} % is not from {LEAST_PERCENT} to {MOST_PERCENT}")
    difference = percent - 100
    coarse, fine = divmod(abs(difference), 10)
    up = difference > 0
    return [
        RealtimeCommand.FEED_100,
        *[RealtimeCommand.FEED_PLUS_10 if up else RealtimeCommand.FEED_MINUS_10] * coarse,
        *[RealtimeCommand.FEED_PLUS_1 if up else RealtimeCommand.FEED_MINUS_1] * fine,
    ]
