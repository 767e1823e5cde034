"""The laser-enable output of a simulated safety-input device: one contact, and what it was told."""

from __future__ import annotations


class LaserEnableOutput:
    """Off at power-up. is_on : the contact itself, stuck or not."""

    def __init__(self) -> None:
        self.is_on = False
        self._level = 0  # the last word
        self._driven = False  # the contact, if it follows
        self._stuck = False

    def command(self, level: int, may_come_on: bool) -> None:
        """A word of the host: 0 drops it, and only an edge to 1 while it may has it come on."""
        if level == 0:
            self._drive(False)
        elif self._level == 0 and may_come_on:
            self._drive(True)
        self._level = level

    def drop(self) -> None:
        """By itself, as with the watchdog: a host that repeats its 1 does not bring it back."""
        self._drive(False)

    def power_cycle(self) -> None:
        """Power off and on."""
        self._level = 0
        self._drive(False)

    def set_stuck(self, stuck: bool) -> None:
        """The contact stays where it is, or follows again."""
        self._stuck = stuck
        self._drive(self._driven)

    def weld_closed(self) -> None:
        """The contact closes, and stays so until it follows again."""
        self._stuck = self.is_on = True

    def _drive(self, on: bool) -> None:
        self._driven = on
        if not self._stuck:
            self.is_on = on
