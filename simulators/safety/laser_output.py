"""The laser-enable output of a simulated safety device: one contact and its command."""

from __future__ import annotations


class LaserEnableOutput:
    """The output is off at power-up. is_on : state of the contact itself, stuck or not."""

    def __init__(self) -> None:
        self.is_on = False
        self._level = 0  # the last word
        self._driven = False  # commanded state of the contact
        self._stuck = False

    def command(self, level: int, may_come_on: bool) -> None:
        """Apply the host's word: 0 drops the output; an edge 0 to 1 sets it if may_come_on."""
        if level == 0:
            self._drive(False)
        elif self._level == 0 and may_come_on:
            self._drive(True)
        self._level = level

    def drop(self) -> None:
        """Drop the output, as the watchdog does; a repeated 1 of the host does not set it again."""
        self._drive(False)

    def power_cycle(self) -> None:
        """Switch power off and on."""
        self._level = 0
        self._drive(False)

    def set_stuck(self, stuck: bool) -> None:
        """Hold the contact in its state, or let it follow commands again."""
        self._stuck = stuck
        self._drive(self._driven)

    def weld_closed(self) -> None:
        """Close the contact; it stays closed until `set_stuck(False)`."""
        self._stuck = self.is_on = True

    def _drive(self, on: bool) -> None:
        self._driven = on
        if not self._stuck:
            self.is_on = on
