"""The work offset that a part is made with: one that a reset leaves as it is.

A hold ends with a reset. It goes back to G54 and forgets G92 and tool length; what another sender
has left of these would hold for the first half of the part only.
"""

from __future__ import annotations

import re

from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identify import read_offset

_MOST_OFF_MM = 0.002  # values are told to 0.001

_SYSTEM = re.compile(r"\bG5[4-9](?:\.[1-3])?\b")
_FORGOTTEN = {
    "G92": ("an offset by G92", "send G92.1 to the controller"),
    "TLO": ("a tool length offset", "send G49 to the controller"),
}


async def lasting_offset(motion: MotionDriver) -> tuple[float, ...]:
    """The work offset in force [mm], by the controller's own word; it must be idle.

    Raises MachineError, all reasons at once, where a reset would change it.
    """
    state, said = await motion.command("$G"), await motion.command("$#")
    wrong = []
    active = _SYSTEM.search(" ".join(state))
    if active is not None and active[0] != "G54":
        wrong.append((f"work coordinates are those of {active[0]}", "send G54 to the controller"))
    for name, reason in _FORGOTTEN.items():
        for line in said:
            stated = re.fullmatch(rf"\[{name}:(.*)\]", line)
            if stated is not None and re.search("[1-9]", stated[1]):
                wrong.append(reason)
    if wrong:
        raise MachineError(
            f"{' and '.join(what for what, _ in wrong)} would be lost at the first hold, and what "
            "is laid after it displaced",
            hint="; ".join(hint for _, hint in wrong)
            + "; then see that `lmctl machine offset` is as you want it",
        )
    return read_offset(state, said)


async def refuse_moved(motion: MotionDriver, offset_mm: tuple[float, ...]) -> None:
    """Raise MachineError where work coordinates are not those at `offset_mm` any more."""
    now_mm = await lasting_offset(motion)
    if any(abs(now - then) > _MOST_OFF_MM for now, then in zip(now_mm, offset_mm, strict=True)):
        raise MachineError(
            "the work offset has changed since the run began: the rest of the part would be "
            "displaced",
            where=f"it is {_text(now_mm)} mm, and was {_text(offset_mm)} mm",
            hint="look at the controller's startup lines ($N), and set it as it was; then "
                 "`lmctl recover` goes on with the part",
        )


def _text(offset_mm: tuple[float, ...]) -> str:
    return ", ".join(f"{axis:g}" for axis in offset_mm)
