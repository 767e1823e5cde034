"""What the journal of a run proves about how far the part has been made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from lmctl.errors import JournalError
from lmctl.run.journal import run_folders
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.journal.writer import is_owned
from lmctl.run.program.place import (
    JOB_START,
    NOTHING_REACHED,
    Known,
    PlaceReached,
    ProgramPlace,
    known_place,
    unknown_place,
)
from lmctl.run.state.transitions import Effect, RunState


@dataclass(frozen=True)
class RunReplay:
    """A run that did not get done.

    ended : its last state, or "broken off" where its process died
    reached : where deposition ended, as far as the journal shows
    is_position_kept : no event is known that would have lost the machine position
    last_line : no line after this one can have been sent
    sent_line : the last line journaled as sent; a power cut may have lost a later one
    beam_on_line : the line with which the part was entered last; earlier lines were not run then
    standstill_mm : place where the machine was last reported at rest, program coordinates, or None
    to_purge : whether it has been sent to the purge position since
    moving : whether the program has been started since; the machine may be on any line sent
    proven_place : deposition has not ended before this place: it was reported, or reached before
    entered_at : the place from which it was then entered, None for its first line
    ended_wall : when the journal's last record was made, by the wall clock
    """

    run: RunFolder
    ended: str
    header: dict[str, Any]
    reached: PlaceReached
    is_position_kept: bool
    last_line: int
    sent_line: int
    beam_on_line: int
    standstill_mm: tuple[float, ...] | None
    to_purge: bool
    moving: bool
    proven_place: ProgramPlace
    entered_at: ProgramPlace | None
    ended_wall: datetime | None

    @property
    def has_begun(self) -> bool:
        """Whether any line of the job may have been executed."""
        return self.last_line >= 0


def replay_run(made: RunFolder) -> RunReplay:
    """Read a run's journal.

    Raises JournalError where it is altered, still being written, or of a run that got done.
    """
    if not made.journal.exists():
        raise JournalError(
            f"{made.run} has no journal",
            hint=f"`{run_folders.command_line('jobs', made.path.parent)}` lists runs")
    if is_owned(made.journal):
        raise JournalError(f"{made.run} is still running", where=str(made.journal),
                           hint=f"`{made.command('status')}` shows it, "
                                f"`{made.command('stop')}` stops it")
    found = verify_journal(made.journal)
    if not found.intact:
        raise JournalError(
            f"the journal of {made.run} is not what was written: {found.reason}",
            where=f"{made.journal}, line {found.broken_line}",
            hint="what it says cannot be relied on: begin the part anew",
        )
    so_far = _Reading()
    for record in read_records(made.journal):
        so_far.take(record)
    _refuse_unrecoverable(made, so_far)
    return RunReplay(
        made, so_far.state if so_far.sealed else "broken off", so_far.header, so_far.reached,
        so_far.position_kept, so_far.last_line, so_far.sent_line, so_far.beam_on_line,
        so_far.standstill_mm, so_far.to_purge, so_far.moving, so_far.proven, so_far.entered_at,
        so_far.ended_wall(),
    )


def continuing_runs(made: RunFolder) -> tuple[str, list[str]]:
    """The run that has gone on with this one, or ""; and later runs that do not say whether."""
    names, unread = run_folders.run_names(made.path.parent), []
    for name in names[names.index(made.run) + 1:]:
        other = RunFolder(made.path.parent / name)
        if other.journal.exists():
            try:
                header = next(read_records(other.journal), {})
            except JournalError:
                unread.append(name)
                continue
            if header.get("continues") == made.run:
                return name, unread
    return "", unread


def _refuse_unrecoverable(made: RunFolder, found: _Reading) -> None:
    """Raises JournalError where nothing is left to deposit, or the place is not known."""
    log = f"`{made.command('log')}` prints its log"
    if found.state == RunState.DONE:
        raise JournalError(f"{made.run} is done: there is nothing to recover", hint=log)
    began = found.last_line >= 0
    if found.finished or (began and found.reached.place.line >= found.header["lines"]):
        raise JournalError(f"{made.run} has deposited the whole part: nothing is left",
                           where=found.fault, hint=log)
    if not began and "continues" in found.header and "begins_at" not in found.header:
        raise JournalError(
            f"the journal of {made.run} does not say where that run was to go on with "
            f"{found.header['continues']}", where="an earlier version of lmctl wrote it",
            hint="begin the part anew",
        )
    if found.sealed and not found.recoverable:
        if not began:
            raise JournalError(f"{made.run} ended before it began with its part",
                               where=found.fault, hint="`lmctl run` begins it")
        raise JournalError(
            f"{made.run} ended because of its job, which would go wrong again",
            where=found.fault, hint="plan the part again",
        )


class _Reading:
    """Record by record, what has been executed, and how that is known."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {}
        self.state = ""
        self.sealed = False
        self.recoverable = False
        self.fault = ""
        self.finished = False
        self.position_kept = True
        self.last_line = -1
        self.sent_line = -1
        self.beam_on_line = 0
        self.standstill_mm: tuple[float, ...] | None = None
        self.to_purge = self.moving = False
        self._is_open = False  # motion was started, and no record shows where it ended
        self.entered_at: ProgramPlace | None = None
        self._at_rest = NOTHING_REACHED  # at the last standstill
        self.proven = JOB_START  # by reports, since then too
        self._reported_s: float | None = None
        self._last_s = 0.0
        self._ends: dict[int, int] = {}  # last line of each path begun
        self._handlers: dict[str, Callable[[dict[str, Any]], None]] = {
            "header": self._header, "state": self._state, "act": self._act, "path": self._path,
            "sent": self._sent, "executed": self._executed, "samples": self._samples,
            "place": self._place, "entry": self._entry, "fault": self._fault, "seal": self._seal,
        }

    @property
    def reached(self) -> PlaceReached:
        """Where deposition has ended. A journal that breaks off in motion leaves that open."""
        if not self._is_open:
            return self._at_rest
        return unknown_place(self.proven, ProgramPlace(self.sent_line + 1), self._reported_s)

    def ended_wall(self) -> datetime | None:
        """When the last record was made: the header's wall clock and the machine time since."""
        wall = self.header.get("local", {}).get("wall")
        if not isinstance(wall, str):
            return None
        return datetime.fromisoformat(wall) + timedelta(seconds=self._last_s)

    def take(self, record: dict[str, Any]) -> None:
        self._last_s = record["t"]
        handler = self._handlers.get(record["kind"])
        if handler is not None:
            handler(record)

    def _header(self, record: dict[str, Any]) -> None:
        self.header = record
        if begins_at := record.get("begins_at"):
            place = ProgramPlace(begins_at["line"], begins_at["share"])
            self._go_on(place)
            self._at_rest = known_place(place, Known(begins_at["known"]))
            self.position_kept = record["position_kept"]
            self.standstill_mm = _point(record.get("standstill_mm"))

    def _state(self, record: dict[str, Any]) -> None:
        self.state = record["to"]
        self.finished = self.finished or self.state == RunState.FINISHING

    def _act(self, record: dict[str, Any]) -> None:
        do = record["do"]
        if do == Effect.START_MOTION:
            self.moving = self._is_open = True
        self.to_purge = self.to_purge or do in (Effect.MOVE_TO_PURGE, Effect.LEAVE_PART)

    def _path(self, record: dict[str, Any]) -> None:
        self._ends[record["path"]] = record["lines"][1]
        self.last_line = max(self.last_line, record["lines"][1])

    def _sent(self, record: dict[str, Any]) -> None:
        self.sent_line = record["line"]
        self.last_line = max(self.last_line, self.sent_line)
        self._prove(ProgramPlace(*record["reported"]), record["t"])

    def _executed(self, record: dict[str, Any]) -> None:
        self._prove(ProgramPlace(self._ends.get(record["path"], -1) + 1), record["t"])

    def _samples(self, record: dict[str, Any]) -> None:
        self._prove(ProgramPlace(max(record["line"])), max(record["at"]))

    def _place(self, record: dict[str, Any]) -> None:
        place = ProgramPlace(record["line"], record["share"])
        until = ProgramPlace(*record["until"]) if "until" in record else place
        at_least = ProgramPlace(*record["at_least"]) if "at_least" in record else place
        self._at_rest = PlaceReached(
            place, Known(record["known"]), at_least, until, record.get("reported_at"))
        self._is_open = False
        if (standstill_mm := _point(record.get("standstill_mm"))) is not None:
            self.standstill_mm = standstill_mm
            self.to_purge = self.moving = False
        if self._at_rest.known is Known.REPORTED:
            self._prove(place, record["t"])

    def _entry(self, record: dict[str, Any]) -> None:
        self.beam_on_line = record["beam_on_line"]
        self.entered_at = ProgramPlace(record["line"], record["share"])
        self._go_on(self.entered_at)

    def _fault(self, record: dict[str, Any]) -> None:
        self.fault = self.fault or record["what"]

    def _seal(self, record: dict[str, Any]) -> None:
        self.sealed = True
        self.recoverable = bool(record.get("recoverable"))
        self.position_kept = bool(record.get("position_trusted"))

    def _go_on(self, place: ProgramPlace) -> None:
        self.proven = max(self.proven, place)
        if place != JOB_START:
            self.last_line = max(self.last_line, place.line)

    def _prove(self, place: ProgramPlace, reported_s: float) -> None:
        if place > self.proven:
            self.proven, self._reported_s = place, reported_s


def _point(axes: list[float] | None) -> tuple[float, ...] | None:
    return None if axes is None else tuple(axes)
