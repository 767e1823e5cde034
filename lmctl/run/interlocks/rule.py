"""One row of the interlock table: the condition, its duration, and the reaction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

from lmctl.run.interlocks.inputs import InterlockInputs


class Reaction(Enum):
    """What the run does about it."""

    HOLD = "hold: beam and motion down, then powder; gas stays"
    RESET = "reset the controller at once; powder, then gas off"
    PATH_END = "hold as soon as the beam is off by the program"


@dataclass(frozen=True)
class InterlockFinding:
    """What a rule has found.

    source_name : which of several like things, or ""
    reading_time_s : loop time of the reading that shows it, where it is checked more often than
        read
    """

    text: str
    remedy: str
    source_name: str = ""
    reading_time_s: float | None = None


@dataclass(frozen=True)
class InterlockRule:
    """One row of the table.

    min_duration_s : how long it must hold before the run reacts; of readings, the time between the
        first and the last that show it
    is_latched : it stays active until an operator acknowledges it, and so does not prevent that
    needs_safety_device : only the safety-input device reports it; without one the rule is left out
    uses_feeder_readings : it uses `InterlockInputs.feeder_readings` and nothing else
    """

    name: str
    find: Callable[[InterlockInputs], Iterator[InterlockFinding]]
    reaction: Reaction = Reaction.HOLD
    min_duration_s: float = 0.0
    is_latched: bool = False
    needs_safety_device: bool = False
    uses_feeder_readings: bool = False
