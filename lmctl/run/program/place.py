"""How far a job has been executed, and how that is known."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, order=True)
class ProgramPlace:
    """A place in a job: all lines before `line`, and this share of its length."""

    line: int = 0
    line_fraction: float = 0.0


JOB_START = ProgramPlace()


class Known(StrEnum):
    """How a place is known. The value is what people and journals read."""

    REPORTED = "reported"  # by the controller, at rest, its position being trusted
    INFERRED = "inferred"  # from what was sent and the clock
    STATED = "stated"      # by the operator, who has looked at the part
    UNKNOWN = "unknown"    # anywhere in a stretch of what was sent


@dataclass(frozen=True)
class PlaceReached:
    """Where deposition ended, as far as it is known.

    place : where it ended; where that is unknown, the place it has certainly reached
    known : how that is known
    at_least : place certainly reached, though motion may have ended before `place`
    until : nothing can have been deposited after it; the place itself unless it is unknown
    reported_s : machine time of the last report on the path that this rests on, None for none
    beam_off_motion_s : how much longer the nozzle moved with the beam off, unreported
    """

    place: ProgramPlace = JOB_START
    known: Known = Known.REPORTED
    at_least: ProgramPlace = JOB_START
    until: ProgramPlace = JOB_START
    reported_s: float | None = None
    beam_off_motion_s: float = 0.0

    @property
    def is_doubtful(self) -> bool:
        """Whether it may have ended anywhere from `place` to `until`."""
        return self.known is Known.UNKNOWN and self.until > self.place

    @property
    def is_assumed(self) -> bool:
        """Whether it ended there only if the machine has not stopped before."""
        return self.known is Known.INFERRED and self.at_least < self.place


#: Of a job that has not been begun.
NOTHING_REACHED = PlaceReached()


def known_place(place: ProgramPlace, known: Known, reported_s: float | None = None) -> PlaceReached:
    """A place without doubt."""
    return PlaceReached(place, known, place, place, reported_s)


def unknown_place(at_least: ProgramPlace, until: ProgramPlace,
                  reported_s: float | None = None) -> PlaceReached:
    """A place anywhere from one to another."""
    return PlaceReached(at_least, Known.UNKNOWN, at_least, max(at_least, until), reported_s)
