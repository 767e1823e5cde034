"""What the journal of a run proves of how far the part has been made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lmctl.errors import JournalError
from lmctl.run.journal import run_folders
from lmctl.run.journal.format import read_records, verify_journal
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.journal.writer import is_owned
from lmctl.run.program.reentry import JOB_START, ProgramPlace
from lmctl.run.state.transitions import Effect, RunState


@dataclass(frozen=True)
class RunReplay:
    """A run that did not get done.

    ended : its last state, or "broken off" where its process died
    proven_place : executed for certain; more may have been
    is_place_exact : whether `proven` is the very place where motion came to rest
    is_position_kept : nothing is known by which the machine would have lost its position
    last_line : no line after this one can have been sent
    beam_on_line : the line with which the part was entered last; what lies before it was not run
    then
    """

    run: RunFolder
    ended: str
    header: dict[str, Any]
    proven_place: ProgramPlace
    is_place_exact: bool
    is_position_kept: bool
    last_line: int
    beam_on_line: int

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
        made, so_far.state if so_far.sealed else "broken off", so_far.header, so_far.proven,
        so_far.exact, so_far.position_kept, so_far.last_line, so_far.lit_line,
    )


def continued_by(made: RunFolder) -> tuple[str, list[str]]:
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
    """Raises JournalError where nothing is left to lay, or it is not known from where."""
    log = f"`{made.command('log')}` prints its log"
    if found.state == RunState.DONE:
        raise JournalError(f"{made.run} is done: there is nothing to recover", hint=log)
    began = found.last_line >= 0
    if found.finished or (began and found.proven.line >= found.header["lines"]):
        raise JournalError(f"{made.run} has laid the whole of its part: nothing is left to lay",
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
    """Record by record, what has been proven."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {}
        self.state = ""
        self.sealed = False
        self.recoverable = False
        self.fault = ""
        self.finished = False
        self.proven = JOB_START
        self.exact = True
        self.position_kept = True
        self.last_line = -1
        self.lit_line = 0
        self._ends: dict[int, int] = {}  # last line of each path begun

    def take(self, record: dict[str, Any]) -> None:
        kind = record["kind"]
        if kind == "header":
            self.header = record
            if begins_at := record.get("begins_at"):
                self._go_on(ProgramPlace(begins_at["line"], begins_at["share"]))
                self.position_kept = record["position_kept"]
        elif kind == "state":
            self.state = record["to"]
            self.finished = self.finished or self.state == RunState.FINISHING
        elif kind == "act":
            self.exact = self.exact and record["do"] != Effect.START_MOTION
        elif kind == "path":
            self._ends[record["path"]] = record["lines"][1]
            self.last_line = max(self.last_line, record["lines"][1])
        elif kind == "executed":
            self._prove(ProgramPlace(self._ends.get(record["path"], -1) + 1))
        elif kind == "samples":
            self._prove(ProgramPlace(max(record["line"])))
        elif kind == "place":
            self._prove(ProgramPlace(record["line"], record["share"]))
            self.exact = True
        elif kind == "entry":
            self.lit_line = record["lit_line"]
            self._go_on(ProgramPlace(record["line"], record["share"]))
        elif kind == "fault":
            self.fault = self.fault or record["what"]
        elif kind == "seal":
            self.sealed = True
            self.recoverable = bool(record.get("recoverable"))
            self.position_kept = bool(record.get("position_trusted"))

    def _go_on(self, place: ProgramPlace) -> None:
        self._prove(place)
        if place != JOB_START:
            self.last_line = max(self.last_line, place.line)

    def _prove(self, place: ProgramPlace) -> None:
        self.proven = max(self.proven, place)
