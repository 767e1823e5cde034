"""What went wrong, where, and what to do next: the errors that reach a person.

Every expected failure is an `LmctlError`; the command line renders it without a traceback and
exits with its `exit_code`. Anything else that escapes is a bug and keeps its traceback.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Self


class LmctlError(Exception):
    """An expected failure, in three parts.

    what : one line, the fault in the reader's own terms
    where : zero or more lines: the file, the key, the layer, the hopper it concerns
    hint : what to do next, or "" where nothing sensible can be said
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str | Sequence[str] = (), hint: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.where: tuple[str, ...] = (where,) if isinstance(where, str) else tuple(where)
        self.hint = hint

    @classmethod
    def cannot_read(cls, path: object, error: OSError) -> Self:
        """That a file or folder cannot be read, in the system's own words."""
        return cls(f"cannot read {path}", where=error.strerror or str(error),
                   hint="check that it is there, and that you may read it")

    @classmethod
    def cannot_write(cls, path: object, error: OSError) -> Self:
        """That a file cannot be written, or not into a folder, in the system's own words."""
        return cls(f"cannot write {path}", where=error.strerror or str(error),
                   hint="check that the folder is there, that you may write to it, and that there "
                        "is room")

    def render(self) -> str:
        """The error as text for a terminal, without a trailing newline."""
        lines = [f"error: {self.what}"]
        lines += [f"  {place}" for place in self.where]
        if self.hint:
            lines.append(f"hint: {self.hint}")
        return "\n".join(lines)


class UsageError(LmctlError):
    """The command was called in a way that cannot be meant."""

    exit_code = 2


class MissingFileError(LmctlError):
    """A file, or a run, that was named is not there."""

    exit_code = 2

    @classmethod
    def for_path(cls, path: Path, hint: str = "") -> MissingFileError:
        """That there is no such file, and which of its folder's files may have been meant.

        hint : what else the reader should look at
        """
        here = path.parent
        try:
            near = get_close_matches(path.name, sorted(os.listdir(here)), n=1)
        except OSError:
            return cls(f"there is no file {path}", where=f"there is no folder {here}",
                       hint=hint or "check the name")
        guess = f"did you mean {here / near[0]}?" if near else "check the name"
        return cls(f"there is no file {path}", hint="; ".join(filter(None, (guess, hint))))


@dataclass(frozen=True)
class Finding:
    """One thing wrong with a configuration: the path of the key (or "") and the reason."""

    path: str
    reason: str


class ConfigError(LmctlError):
    """A file of ours (part, profile, bench) is wrong; all its findings at once.

    unlisted : how many more there are than `findings`
    """

    exit_code = 3

    def __init__(
        self, what: str, *, findings: Iterable[Finding] = (), where: str | Sequence[str] = (),
        hint: str = "", unlisted: int = 0,
    ) -> None:
        self.findings = tuple(findings)
        self.unlisted = unlisted
        places = [where] if isinstance(where, str) else list(where)
        places += [f"{f.path}: {f.reason}" if f.path else f.reason for f in self.findings]
        if unlisted:
            places.append(f"and {unlisted:,} more")
        super().__init__(what, where=places, hint=hint)

    @classmethod
    def of_findings(
        cls, name: object, findings: Sequence[Finding], *, unlisted: int = 0, hint: str = ""
    ) -> ConfigError:
        """That something has so many mistakes. name : of the file, or what else it is called"""
        number = len(findings) + unlisted
        count = "1 mistake" if number == 1 else f"{number:,} mistakes"
        return cls(f"{name} has {count}", findings=findings, unlisted=unlisted, hint=hint)


class InputError(LmctlError):
    """Data given to planning (a mesh, a cloud, a table) cannot be used."""


class PlanError(LmctlError):
    """The part cannot be planned as asked."""


class JobError(LmctlError):
    """A job file is truncated, altered, or not made for this machine."""


class JournalError(LmctlError):
    """A run journal is broken, owned by another process, or not there."""


class RunFailedError(LmctlError):
    """The run ended before the part was finished and cannot simply be resumed."""


class RunInterruptedError(RunFailedError):
    """The run ended before the part was finished; `lmctl recover` can go on with it."""

    exit_code = 5


class MachineError(LmctlError):
    """A device is unreachable, silent, refused, or in alarm."""

    exit_code = 4


class RunStoppedError(LmctlError):
    """The run was stopped on purpose or by a fault that leaves it resumable."""

    exit_code = 5
