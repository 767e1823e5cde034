"""The work offset that a part is made with: one that a reset leaves as it is.

A hold ends with a reset. It goes back to G54 and forgets G92 and tool length; what another sender
has left of these would hold for the first half of the part only.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from lmctl.errors import MachineError
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.motion.identity import parse_work_offset
from lmctl.run.cell.condition import StartCondition

_MAX_OFF_MM = 0.002  # values are reported to 0.001

_SYSTEM = re.compile(r"\bG5[4-9](?:\.[1-3])?\b")
_FORGOTTEN = {"G92": "an offset by G92 is in force", "TLO": "a tool length offset is in force"}

_LOST = "; a reset forgets it, so the part would be displaced after its first hold"
_HINT = ("`lmctl machine offset --clear`, then see that the work offset is the one you want: "
         "`lmctl machine offset`")


def work_offset_conditions(
    parser_state: Sequence[str], offsets: Sequence[str]
) -> Iterator[StartCondition]:
    """What the work offset must not rest on. parser_state, offsets : lines of `$G` and `$#`."""
    active = _SYSTEM.search(" ".join(parser_state))
    if active is not None and active[0] != "G54":
        yield StartCondition(False, f"work coordinates are those of {active[0]}{_LOST}", _HINT,
                             refuses_run=True)
    for name, what in _FORGOTTEN.items():
        for line in offsets:
            stated = re.fullmatch(rf"\[{name}:(.*)\]", line)
            if stated is not None and re.search("[1-9]", stated[1]):
                yield StartCondition(False, f"{what} ({stated[1]} mm){_LOST}", _HINT,
                                     refuses_run=True)


async def persistent_work_offset(motion: MotionDriver) -> tuple[float, ...]:
    """The work offset in force [mm], as the controller reports it; it must be idle.

    Raises MachineError, all reasons at once, where a reset would change it.
    """
    state, offsets = await motion.send_command("$G"), await motion.send_command("$#")
    wrong = list(work_offset_conditions(state, offsets))
    if wrong:
        raise MachineError(wrong[0].text, where=[condition.text for condition in wrong[1:]],
                           hint=_HINT)
    return parse_work_offset(state, offsets)


async def refuse_changed_offset(motion: MotionDriver, offset_mm: tuple[float, ...]) -> None:
    """Raise MachineError where work coordinates are not those at `offset_mm` any more."""
    now_mm = await persistent_work_offset(motion)
    if any(abs(now - then) > _MAX_OFF_MM for now, then in zip(now_mm, offset_mm, strict=True)):
        raise MachineError(
            "the work offset has changed since the run began: the rest of the part would be "
            "displaced",
            where=f"it is {_text(now_mm)} mm, and was {_text(offset_mm)} mm",
            hint="look at the controller's startup lines ($N), and set it as it was; then "
                 "`lmctl recover` goes on with the part",
        )


def _text(offset_mm: tuple[float, ...]) -> str:
    return ", ".join(f"{axis:g}" for axis in offset_mm)
