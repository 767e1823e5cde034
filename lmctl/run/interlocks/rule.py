"""One row of the interlock table: what is looked at, for how long, and the answer."""

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
    reading_time_s : loop time of the reading that shows it, where it is looked at more often than
    read
    """

    text: str
    remedy: str
    source_name: str = ""
    reading_time_s: float | None = None


@dataclass(frozen=True)
class InterlockRule:
    """One row of the table.

    min_duration_s : how long it must be so before anything is done; of readings, how far the first
    and the
        last that show it must be apart
    is_latched : it stands until an operator acknowledges it, and so does not keep one from that
    needs_safety_device : only the safety-input device says so; without one there is nothing to
    look at
    uses_feeder_readings : it looks at `InterlockInputs.answers` and at nothing else
    """

    name: str
    find: Callable[[InterlockInputs], Iterator[InterlockFinding]]
    reaction: Reaction = Reaction.HOLD
    min_duration_s: float = 0.0
    is_latched: bool = False
    needs_safety_device: bool = False
    uses_feeder_readings: bool = False
