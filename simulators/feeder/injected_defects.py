"""What is wrong with a simulated feeder beside its process: what it tells, ignores and minds."""

from __future__ import annotations

from collections.abc import Callable

from firmware_protocol.registers import RegisterValue

Change = Callable[[RegisterValue], RegisterValue]


class InjectedDefects:
    """Nothing, as made. It is looked at whenever the device is read.

    ignores_recipes : SEQ commits nothing
    causes : codes of alarms that cannot be reset
    """

    def __init__(self) -> None:
        self.ignores_recipes = False
        self.causes: list[int] = []
        self._changes: list[tuple[int, str, Change]] = []

    def override_register(self, channel: int, name: str, change: Change) -> Callable[[], None]:
        """Change what a register of a hopper tells (0: of the device); what undoes that."""
        entry = (channel, name, change)
        self._changes.append(entry)
        return lambda: self._changes.remove(entry)

    def apply_overrides(self, channel: int,
                        values: dict[str, RegisterValue]) -> dict[str, RegisterValue]:
        """What is told in place of what is so."""
        for place, name, change in self._changes:
            if place == channel:
                values[name] = change(values[name])
        return values
