"""The laser-enable output as the host knows it: wanted, commanded and read back.

This module does no communication. The output goes on only by an edge from 0 to 1, so a 1 is sent
only after a 0 that was read back. Once the output is off although commanded on, only a new request
switches it on again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

#: A contact follows its command within this time [s]: a laser's safe-off takes less than 50 ms.
CONTACT_SETTLE_S = 0.05

#: Delay from the command at the output, or from an opened laser circuit, to beam off [s].
LASER_OFF_DELAY_S = 0.02

_CHECK = "check the laser-enable output, its relay and the wiring of its read-back"


@dataclass(frozen=True)
class LaserEnableFault:
    """A fault in words, and its remedy. commanded : on or off, which the output did not follow"""

    commanded: bool
    reason: str
    hint: str


class LaserEnable:
    """One output, initially off.

    wanted : on or off, as last requested; off once it reads back other than commanded
    fault : why it cannot be relied on, while that is so
    """

    def __init__(self) -> None:
        self.wanted = False
        self.fault: LaserEnableFault | None = None
        self._commanded = False  # the command in the last request
        self._agrees = False  # it was read back as commanded
        self._answered_s = math.inf  # when a request with that command was first answered

    def request(self, on: bool) -> None:
        """Request on or off; on is ignored while the output cannot be relied on."""
        self.wanted = on and self.fault is None

    @property
    def is_pending(self) -> bool:
        """Whether a command is still to be confirmed, and there is no fault."""
        return self.fault is None and not self.is_confirmed(self.wanted)

    def is_confirmed(self, on: bool) -> bool:
        """Whether the output is wanted, commanded and read back in this state."""
        return self.wanted == self._commanded == on and self._agrees

    @property
    def has_unsent_change(self) -> bool:
        """Whether the next command differs from the last."""
        return self.wanted != self._commanded and (self._commanded or self._agrees)

    def fault_against(self, on: bool) -> LaserEnableFault | None:
        """The fault that keeps the output from being confirmed on, or off."""
        return self.fault if self.fault is not None and (on or not self.fault.commanded) else None

    def output_word(self) -> int:
        """The command word of the next request."""
        if self.has_unsent_change:
            self._commanded, self._agrees, self._answered_s = self.wanted, False, math.inf
        return int(self._commanded)

    def on_read_back(self, is_on: bool, now_s: float) -> LaserEnableFault | None:
        """A good answer to the last request; returns what is newly wrong."""
        if is_on == self._commanded:
            self._agrees, self.fault = True, None
            self._answered_s = min(self._answered_s, now_s - CONTACT_SETTLE_S)
            return None
        self._agrees = False
        self._answered_s = min(self._answered_s, now_s)
        known = self.fault is not None and self.fault.commanded == self._commanded
        if known or now_s < self._answered_s + CONTACT_SETTLE_S:
            return None
        seen, commanded_text = ("off", "on") if self._commanded else ("on", "off")
        reason = f"its laser-enable output is {seen} and was commanded to be {commanded_text}"
        self.fault = LaserEnableFault(self._commanded, reason, _CHECK)
        self.wanted = False
        return self.fault

    def on_restart(self) -> None:
        """The device has restarted and lost its last command."""
        self.wanted = self._commanded = self._agrees = False
        self.fault = None
