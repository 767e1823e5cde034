"""The state of an earlier run that a new run continues from."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.run.program.place import PlaceReached


@dataclass(frozen=True)
class EarlierRun:
    """What an earlier run has made of the part.

    reached : how far the job has been executed; not doubtful
    is_position_trusted : the machine position has been verified or restored
    standstill_mm : machine position at rest, in program coordinates; None where it is not known
    """

    run: str
    reached: PlaceReached
    is_position_trusted: bool
    standstill_mm: tuple[float, ...] | None = None
