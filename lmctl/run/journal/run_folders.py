"""Folders of runs: runs/run-0001/{journal.jsonl, job.lmj}; making, finding and listing them."""

from __future__ import annotations

import os
import re
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lmctl.errors import JobError, JournalError, MissingFileError
from lmctl.run.journal.format import UnsupportedFormatError, last_record, read_records
from lmctl.run.journal.writer import is_owned
from lmctl.run.state.transitions import RunState

JOURNAL, JOB, VOXEL_MAP = "journal.jsonl", "job.lmj", "voxel-map.npz"
_NAME = re.compile(r"run-[0-9]{4,9}")

#: Default folder of the runs.
_USUAL = Path("runs")


@dataclass(frozen=True)
class RunFolder:
    """One run's folder."""

    path: Path

    @property
    def run(self) -> str:
        return self.path.name

    @property
    def journal(self) -> Path:
        return self.path / JOURNAL

    @property
    def job(self) -> Path:
        return self.path / JOB

    @property
    def voxel_map(self) -> Path:
        """What was built, where the run was simulated with its process."""
        return self.path / VOXEL_MAP

    def command(self, do: str) -> str:
        """`lmctl DO` of this run, as it can be typed into a shell."""
        return command_line(do, self.path.parent, self.run)


@dataclass(frozen=True)
class RunSummary:
    """A run in one row.

    state : how it ended; "running" while a process writes its journal, "broken off" where one
        died and left it unsealed
    part, operator, started : as in the header; started is a wall clock stamp
    lines, machine_s : executed lines and machine time, None unless it was sealed
    """

    run: str
    state: str
    part: str
    operator: str
    started: str
    lines: int | None
    machine_s: float | None


def command_line(do: str, runs_dir: Path, *words: str) -> str:
    """`lmctl DO WORDS` with the folder of runs it is about, as it can be typed into a shell."""
    where = () if runs_dir == _USUAL else ("--runs", str(runs_dir))
    return shlex.join(["lmctl", do, *words, *where])


def create_run_folder(runs_dir: Path, job: Path) -> RunFolder:
    """Make the next free run folder, with a copy of the job in it.

    The copy is what the run reads: the job it began with, whatever becomes of the original.
    Both are on the disk when this returns. Two processes never get the same folder. Raises
    JobError, JournalError.
    """
    number = max((int(name[4:]) for name in run_names(runs_dir)), default=0) + 1
    try:
        runs_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise JournalError.cannot_write(runs_dir, error) from None
    while True:
        path = runs_dir / f"run-{number:04d}"
        try:
            path.mkdir()
        except FileExistsError:
            number += 1
            continue
        except OSError as error:
            raise JournalError.cannot_write(path, error) from None
        break
    made = RunFolder(path)
    try:
        shutil.copyfile(job, made.job)
        # After a power cut `recover` needs the job as much as the journal.
        _make_durable(made.job)
        _make_durable(runs_dir)
    except OSError as error:
        discard_run_folder(made)
        raise JobError(f"cannot copy the job {job}", where=str(error.strerror),
                       hint="check that it is there, and that there is room for it beside the "
                            "journal") from None
    return made


def _make_durable(path: Path) -> None:
    """A file's content, or the names in a folder."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def discard_run_folder(made: RunFolder) -> None:
    """Remove the folder of a run that never began to write its journal."""
    made.job.unlink(missing_ok=True)
    made.path.rmdir()


def find_run_folder(runs_dir: Path, run: str) -> RunFolder:
    """The folder of a run, by its name. Raises MissingFileError where there is none."""
    if not _NAME.fullmatch(run) or not (runs_dir / run).is_dir():
        known = run_names(runs_dir)
        raise MissingFileError(
            f"there is no run {run!r} in {runs_dir}",
            where=f"the last one is {known[-1]}" if known else "it holds no run",
            hint=f"`{command_line('jobs', runs_dir)}` lists runs",
        )
    return RunFolder(runs_dir / run)


def list_runs(runs_dir: Path) -> list[RunSummary]:
    """Every run in a folder, oldest first; empty where the folder is missing.

    Reads only the first and the last record of each journal.
    """
    return [run_summary(RunFolder(runs_dir / name)) for name in run_names(runs_dir)]


def run_summary(run: RunFolder) -> RunSummary:
    """A run in one row; reads only the first and the last record of its journal."""
    header: dict[str, Any] = {}
    end: dict[str, Any] = {}
    try:
        owned = is_owned(run.journal)
        header = next(read_records(run.journal), {})
        end = last_record(run.journal) or {}
    except UnsupportedFormatError as error:
        return RunSummary(run.run, f"format {error.version}", "", "", "", None, None)
    except (JournalError, MissingFileError, OSError):
        return RunSummary(run.run, "no journal", "", "", "", None, None)
    sealed = end.get("kind") == "seal"
    state = str(end.get("state", "")) if sealed else "running" if owned else "broken off"
    local = header.get("local")
    return RunSummary(
        run.run,
        state if not sealed or state in set(RunState) else "unknown",
        str(header.get("part", "")),
        str(header.get("operator", "")),
        str(local.get("wall", "")) if isinstance(local, dict) else "",
        end.get("lines") if sealed else None,
        end.get("t") if sealed else None,
    )


def run_names(runs_dir: Path) -> list[str]:
    """Names of the runs in a folder, oldest first. Raises JournalError."""
    try:
        return sorted(
            (path.name for path in runs_dir.iterdir() if _NAME.fullmatch(path.name)),
            key=lambda name: int(name[4:]),
        )
    except FileNotFoundError:
        return []
    except NotADirectoryError:
        raise JournalError(f"{runs_dir} is not a folder",
                           hint="--runs names a folder of runs") from None
    except OSError as error:
        raise JournalError.cannot_read(runs_dir, error) from None
