"""The client side of a run's control socket: finds, queries and watches runs under way."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lmctl.errors import JournalError, UsageError
from lmctl.run.control import socket_path as control_path
from lmctl.run.journal import run_folders

_ANSWER_S = 10.0
_MAX_ANSWER_BYTES = 1_000_000


def runs_in_progress(runs_dir: Path) -> list[Path]:
    """Folders of the runs that a living process drives, oldest first.

    Sockets of dead ones are removed on the way. Raises JournalError where the folder cannot be
    read.
    """
    folders = sorted(
        (path.parent for path in runs_dir.glob(f"run-*/{control_path.SOCKET_NAME}")),
        key=lambda folder: (len(folder.name), folder.name),
    )
    return [folder for folder in folders if _answers(folder)]


def find_run(runs_dir: Path, run: str | None) -> Path:
    """The folder of the selected run: the named one, or the only one under way.

    Raises JournalError where there is none, UsageError where there are several.
    """
    if run is not None:
        return run_folders.find_run_folder(runs_dir, run).path
    folders = runs_in_progress(runs_dir)
    if len(folders) > 1:
        names = [folder.name for folder in folders]
        raise UsageError(f"{len(folders)} runs are under way in {runs_dir}",
                         where=", ".join(names), hint=f"name the one you mean, e.g. {names[-1]}")
    if not folders:
        raise JournalError(f"no run is under way in {runs_dir}",
                           hint="`lmctl jobs` lists runs; --runs names another folder")
    return folders[0]


def send_request(folder: Path, do: str, **values: Any) -> dict[str, Any]:
    """The answer of the run in a folder to one request; values : as in `lmctl.run.control.server`.

    Raises JournalError where no process drives the run or it does not answer, UsageError with
    its reason where it refuses.
    """
    with _connected(folder) as connection:
        return next(_answers_to(folder, connection, do, values))


def watch_status(folder: Path, every_s: float) -> Iterator[dict[str, Any]]:
    """The run's status every `every_s` seconds, until it ends. Raises as `send_request` does."""
    with _connected(folder) as connection:
        connection.settimeout(every_s + _ANSWER_S)
        yield from _answers_to(folder, connection, "watch", {"every_s": every_s})


def _answers(folder: Path) -> bool:
    try:
        connection = control_path.connect_to_run(folder)
    except JournalError:  # another user's run: it is under way
        return True
    if connection is not None:
        connection.close()
    return connection is not None


def _connected(folder: Path) -> socket.socket:
    connection = control_path.connect_to_run(folder)
    if connection is None:
        raise run_not_in_progress(folder)
    connection.settimeout(_ANSWER_S)
    return connection


def run_not_in_progress(folder: Path) -> JournalError:
    """The error that no process drives the run in a folder, and how the run ended."""
    made = run_folders.RunFolder(folder)
    state = run_folders.run_summary(made).state
    ended = "it was broken off" if state == "broken off" else f"it is {state}"
    return JournalError(f"{folder.name} is not under way: {ended}",
                        hint=f"`{made.command('log')}` shows how far it came")


def _answers_to(
    folder: Path, connection: socket.socket, do: str, values: dict[str, Any]
) -> Iterator[dict[str, Any]]:
    answered = False
    try:
        connection.sendall(json.dumps({"do": do, **values}).encode("ascii") + b"\n")
        with connection.makefile("rb") as lines:
            while line := lines.readline(_MAX_ANSWER_BYTES):
                answered = True
                yield _understood(folder, line)
    except TimeoutError:
        raise JournalError(f"{folder.name} does not answer", where="its process may be stopped",
                           hint="look at it where it was started") from None
    except OSError:
        pass  # it ended in this moment
    if not answered:
        raise run_not_in_progress(folder)


def _understood(folder: Path, line: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(line)
        ok = answer["ok"]
    except (ValueError, TypeError, KeyError):
        raise JournalError(f"what {folder.name} answers makes no sense",
                           hint="is it driven by another version of lmctl?") from None
    if not ok:
        raise UsageError(str(answer.get("error", "refused")), where=answer.get("where", ()),
                         hint=str(answer.get("hint", "")))
    found: dict[str, Any] = answer
    return found
