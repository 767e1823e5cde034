"""Interruptions of deposition: pauses, trips, dead hosts; and where the part was entered again."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

#: States in which beads are deposited; leaving it for any other than finishing is an interruption.
_DEPOSITING, _FINISHING = "depositing", "finishing"


@dataclass(frozen=True)
class Interruption:
    """Deposition ended before the job did.

    seq : of the record of the state that ended it, None where the host died
    cause : in words; began_s : machine time of the run; began, ended : wall clock (UTC)
    line, share : place of the last bead, known : "reported", "inferred", "stated" or "unknown";
        line None where no record states a place
    duration_s : until beads were deposited again, in the same run by machine time, in a later one
        by the wall clock; None where they never were, or where clocks do not show it
    resumed_in : the run that went on, "" where none did
    entry_line, repeated_mm : where the part was entered again, and bead deposited twice there
    """

    run: str
    seq: int | None
    cause: str
    began_s: float
    began: str
    line: int | None = None
    share: float = 0.0
    known: str = ""
    duration_s: float | None = None
    ended: str = ""
    resumed_in: str = ""
    entry_line: int | None = None
    repeated_mm: float = 0.0


@dataclass(frozen=True)
class FirstEntry:
    """How a run first entered the part.

    record : of kind "entry", {} of a run that began the part; wall : when beads were first
        deposited, "" if never
    """

    record: dict[str, Any]
    wall: str


class InterruptionGatherer:
    """Gathers the interruptions of one run from its records, in order.

    first_entry : how the run entered the part
    """

    def __init__(self) -> None:
        self._entries: list[Interruption] = []
        self._is_open = self._is_depositing = self._is_sealed = False
        self._cause = ""
        self._entry: dict[str, Any] = {}
        self.first_entry = FirstEntry({}, "")
        self._last_s, self._last_wall = 0.0, ""

    def take(self, record: dict[str, Any]) -> None:
        """Any record; those of other kinds change nothing."""
        self._last_s = float(record["t"])
        self._last_wall = _wall(record) or self._last_wall
        match record["kind"]:
            case "operator" if not record.get("refused"):
                who = record["operator"]
                self._cause = f"operator{' ' + who if who else ''}: {record['act']}"
            case "alarm" if not self._is_open:
                self._cause = str(record["what"])
            case "state":
                self._take_state(record)
            case "place" if self._is_open and self._entries[-1].line is None:
                self._entries[-1] = replace(
                    self._entries[-1], line=int(record["line"]), share=float(record["share"]),
                    known=str(record["known"]))
            case "entry":
                self._entry = record
            case "seal":
                self._is_sealed = True

    def entries(self, run: str) -> tuple[Interruption, ...]:
        """All of them, as interruptions of `run`."""
        found = [replace(one, run=run, resumed_in=one.resumed_in and run)
                 for one in self._entries]
        if self._is_depositing and not self._is_sealed:
            found.append(Interruption(run, None, "the journal ends while beads were deposited: "
                                      "the host died, or still runs", self._last_s,
                                      self._last_wall))
        return tuple(found)

    def _take_state(self, record: dict[str, Any]) -> None:
        after = str(record["to"])
        if record["from"] == _DEPOSITING and after not in (_DEPOSITING, _FINISHING):
            self._is_open, self._is_depositing = True, False
            self._entries.append(Interruption(
                "", int(record["seq"]), self._cause or str(record["event"]), float(record["t"]),
                _wall(record)))
            self._entry = {}
        elif after == _DEPOSITING:
            self._is_depositing = True
            if not self.first_entry.wall:
                self.first_entry = FirstEntry(self._entry, _wall(record))
            if self._is_open:
                self._is_open = False
                began = self._entries[-1]
                self._entries[-1] = replace(
                    began, duration_s=float(record["t"]) - began.began_s, ended=_wall(record),
                    resumed_in="this run", **_entry_fields(self._entry))
            self._cause = ""
        elif after == _FINISHING:
            self._is_depositing = False


def joined_interruptions(runs: Iterable[tuple[str, tuple[Interruption, ...], FirstEntry]]) -> tuple[
    Interruption, ...
]:
    """The interruptions of all runs of a part; what ended one run ends where the next goes on."""
    found: list[Interruption] = []
    for run, entries, first in runs:
        if found and first.wall and not found[-1].resumed_in:
            found[-1] = replace(
                found[-1], resumed_in=run, ended=first.wall,
                duration_s=_seconds_between(found[-1].began, first.wall),
                **_entry_fields(first.record))
        found += entries
    return tuple(found)


def _entry_fields(record: dict[str, Any]) -> dict[str, Any]:
    if not record:
        return {}
    return {"entry_line": int(record["beam_on_line"]), "repeated_mm": float(record["repeated_mm"])}


def _seconds_between(began: str, ended: str) -> float | None:
    """By the wall clock; None where it went backwards or a stamp is missing."""
    try:
        lasted_s = (datetime.fromisoformat(ended) - datetime.fromisoformat(began)).total_seconds()
    except (ValueError, TypeError):
        return None
    return lasted_s if lasted_s >= 0.0 else None


def _wall(record: dict[str, Any]) -> str:
    return str(record.get("local", {}).get("wall", ""))
