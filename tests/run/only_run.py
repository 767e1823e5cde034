"""The one run that a test has made, or the reason why there is none."""

from __future__ import annotations

from pathlib import Path

from lmctl.errors import LmctlError
from lmctl.run.journal.run_folders import JOURNAL


def journal_of_only_run(runs_dir: Path, error: LmctlError | None) -> Path:
    """The journal of the only run in a folder of runs.

    error : what the run ended with, if anything
    Raises AssertionError with that error where the run was refused before it had a folder.
    """
    runs = sorted(runs_dir.glob("run-*"))
    if len(runs) != 1:
        why = "no error was raised" if error is None else error.render()
        raise AssertionError(f"{len(runs)} runs in {runs_dir} instead of one: {why}") from error
    return runs[0] / JOURNAL
