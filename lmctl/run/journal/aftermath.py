"""What the journal of a run proves of how far the part has been made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lmctl.errors import JournalError
from lmctl.run.journal import rundir
from lmctl.run.journal.file import read, verify
from lmctl.run.journal.rundir import RunDir
from lmctl.run.journal.writer import is_owned
from lmctl.run.program.reentry import START, Place
from lmctl.run.state.table import Do, State


@dataclass(frozen=True)
class Aftermath:
    """A run that did not get done.

    ended : its last state, or "broken off" where its process died
    proven : executed for certain; more may have been
    exact : whether `proven` is the very place where motion came to rest
    position_kept : nothing is known by which the machine would have lost its position
    last_line : no line after this one can have been sent
    lit_line : the line with which the part was entered last; what lies before it was not run then
    """

    run: RunDir
    ended: str
    header: dict[str, Any]
    proven: Place
    exact: bool
    position_kept: bool
    last_line: int
    lit_line: int

    @property
    def began(self) -> bool:
        """Whether any line of the job may have been executed."""
        return self.last_line >= 0


def aftermath(made: RunDir) -> Aftermath:
    """Read a run's journal.

    Raises JournalError where it is altered, still being written, or of a run that got done.
    """
    if not made.journal.exists():
        raise JournalError(f"{made.run} has no journal",
                           hint=f"`{rundir.command('jobs', made.path.parent)}` lists runs")
    if is_owned(made.journal):
        raise JournalError(f"{made.run} is still running", where=str(made.journal),
                           hint=f"`{made.command('status')}` shows it, "
                                f"`{made.command('stop')}` stops it")
    found = verify(made.journal)
    if not found.whole:
        raise JournalError(
            f"the journal of {made.run} is not what was written: {found.reason}",
            where=f"{made.journal}, line {found.broken_line}",
            hint="what it says cannot be relied on: begin the part anew",
        )
    so_far = _Reading()
    for record in read(made.journal):
        so_far.take(record)
    if so_far.state == State.DONE:
        raise JournalError(f"{made.run} is done: there is nothing to recover",
                           hint=f"`{made.command('log')}` prints its log")
    if so_far.sealed and not so_far.recoverable:
        raise JournalError(
            f"{made.run} ended because of its job, which would go wrong again",
            where=so_far.fault, hint="plan the part again",
        )
    return Aftermath(
        made, so_far.state if so_far.sealed else "broken off", so_far.header, so_far.proven,
        so_far.exact, so_far.position_kept, so_far.last_line, so_far.lit_line,
    )


def continued_by(made: RunDir) -> str:
    """The run that has gone on with this one, or ""."""
    for name in rundir.names(made.path.parent):
        other = RunDir(made.path.parent / name)
        if other.run != made.run and other.journal.exists():
            header = next(read(other.journal), {})
            if header.get("continues") == made.run:
                return other.run
    return ""


class _Reading:
    """Record by record, what has been proven."""

    def __init__(self) -> None:
        self.header: dict[str, Any] = {}
        self.state = ""
        self.sealed = False
        self.recoverable = False
        self.fault = ""
        self.proven = START
        self.exact = True
        self.position_kept = True
        self.last_line = -1
        self.lit_line = 0
        self._ends: dict[int, int] = {}  # last line of each path begun

    def take(self, record: dict[str, Any]) -> None:
        kind = record["kind"]
        if kind == "header":
            self.header = record
        elif kind == "state":
            self.state = record["to"]
        elif kind == "act":
            self.exact = self.exact and record["do"] != Do.START_MOTION
        elif kind == "path":
            self._ends[record["path"]] = record["lines"][1]
            self.last_line = max(self.last_line, record["lines"][1])
        elif kind == "executed":
            self._prove(Place(self._ends.get(record["path"], -1) + 1))
        elif kind == "samples":
            self._prove(Place(max(record["line"])))
        elif kind == "place":
            self._prove(Place(record["line"], record["share"]))
            self.exact = True
        elif kind == "entry":
            self.lit_line = record["lit_line"]
            self._prove(Place(record["line"], record["share"]))
            self.last_line = max(self.last_line, record["line"])
        elif kind == "fault":
            self.fault = self.fault or record["what"]
        elif kind == "seal":
            self.sealed = True
            self.recoverable = bool(record.get("recoverable"))
            self.position_kept = bool(record.get("position_trusted"))

    def _prove(self, place: Place) -> None:
        self.proven = max(self.proven, place)
