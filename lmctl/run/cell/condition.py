"""Conditions of a cell: one list of them, asked by `lmctl machine doctor` and by every run's start.

Both get them from the same functions (`motion_conditions`, `feeder_conditions`,
`safety_conditions`), so a run is refused for nothing that doctor does not show.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lmctl.errors import MachineError


@dataclass(frozen=True)
class StartCondition:
    """One thing looked at.

    is_met : it is as it should be
    text : what was found, in words; hint : what to do where it is not met
    refuses_run : no run starts while it is not met; otherwise it is only worse than planned
    """

    is_met: bool
    text: str
    hint: str = ""
    refuses_run: bool = False


def refuse_unmet(conditions: Mapping[str, Iterable[StartCondition]]) -> None:
    """Raise MachineError where a run must not start, with all reasons at once.

    conditions : by device, as it is to be named
    """
    wrong = [(device, condition) for device, of_device in conditions.items()
             for condition in of_device if condition.refuses_run and not condition.is_met]
    if not wrong:
        return
    (device, first), *others = wrong
    hints = dict.fromkeys(condition.hint for _, condition in wrong if condition.hint)
    raise MachineError(
        first.text,
        where=[device, *(f"also: {condition.text}" if other == device
                         else f"also: {other}: {condition.text}" for other, condition in others)],
        hint="; ".join(hints),
    )
