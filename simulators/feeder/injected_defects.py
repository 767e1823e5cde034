"""Injected defects of a simulated feeder: false register values, ignored recipes, alarm causes."""

from __future__ import annotations

from collections.abc import Callable

from firmware_protocol.registers import RegisterValue

Change = Callable[[RegisterValue], RegisterValue]


class InjectedDefects:
    """Defects of one feeder, none at first. Every read of the device applies them.

    ignores_recipes : a change of SEQ commits no recipe
    causes : codes of alarms that cannot be reset
    """

    def __init__(self) -> None:
        self.ignores_recipes = False
        self.causes: list[int] = []
        self._changes: list[tuple[int, str, Change]] = []

    def override_register(self, channel: int, name: str, change: Change) -> Callable[[], None]:
        """Change the reported value of a register (channel 0: device); returns the undo."""
        entry = (channel, name, change)
        self._changes.append(entry)
        return lambda: self._changes.remove(entry)

    def apply_overrides(self, channel: int,
                        values: dict[str, RegisterValue]) -> dict[str, RegisterValue]:
        """Replace actual register values by the overridden ones."""
        for place, name, change in self._changes:
            if place == channel:
                values[name] = change(values[name])
        return values
