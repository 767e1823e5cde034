"""The runs of a folder, and the watches of those that are under way or looked at."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from lmctl.errors import LmctlError
from lmctl.run.control.socket_path import SOCKET_NAME
from lmctl.run.journal.run_folders import RunFolder, find_run_folder, run_names, run_summary
from lmctl.web.run_snapshot import Snapshot
from lmctl.web.run_watch import RunWatch

#: Between two looks for runs that have begun; how long a watch of an ended run is kept [s].
_LOOK_S, _KEEP_S = 1.0, 60.0

#: Most runs watched at a time, and listed.
MAX_WATCHED, MAX_LISTED = 16, 500


class RunCatalogue:
    """The runs in a folder. Use as an async context manager."""

    def __init__(self, runs_dir: Path) -> None:
        self.runs_dir = runs_dir
        self._watches: dict[str, tuple[RunWatch, float]] = {}
        self._ended: dict[str, tuple[tuple[int, int], dict[str, Any]]] = {}
        self._listed: tuple[float, list[dict[str, Any]]] | None = None
        self._looking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> RunCatalogue:
        self._looking = asyncio.create_task(self._look_for_runs(), name="look for runs")
        return self

    async def __aexit__(self, *exception: object) -> None:
        assert self._looking is not None
        self._looking.cancel()
        await asyncio.gather(self._looking, return_exceptions=True)
        for watch, _ in self._watches.values():
            await watch.close()
        self._watches.clear()

    async def watch(self, run: str) -> RunWatch:
        """The watch of a run, once it has read what its journal holds.

        Raises MissingFileError where there is no such run.
        """
        if run in self._watches:
            watch = self._watches[run][0]
        else:
            watch = await self._begin(find_run_folder(self.runs_dir, run))
        self._watches[run] = (watch, time.monotonic())
        with suppress(TimeoutError):
            async with asyncio.timeout(5.0):
                await watch.caught_up.wait()
        return watch

    def live_watches(self) -> list[RunWatch]:
        """Of the runs that a process drives, oldest first."""
        return [watch for name, (watch, _) in sorted(
            self._watches.items(), key=lambda one: int(one[0][4:])) if watch.is_live]

    def live_snapshots(self) -> list[Snapshot]:
        """Of the runs that a process drives, oldest first."""
        return [watch.snapshot() for watch in self.live_watches()]

    async def listed_runs(self) -> list[dict[str, Any]]:
        """The last runs of the folder, newest first, each in a row. Raises JournalError."""
        now_s = time.monotonic()
        if self._listed is None or now_s - self._listed[0] > _LOOK_S:
            self._listed = now_s, await asyncio.to_thread(self._listed_runs)
        return self._listed[1]

    def _listed_runs(self) -> list[dict[str, Any]]:
        rows = []
        for name in run_names(self.runs_dir)[: -MAX_LISTED - 1 : -1]:
            folder = RunFolder(self.runs_dir / name)
            as_it_is = _size_and_time(folder.journal)
            known = self._ended.get(name)
            if known is None or known[0] != as_it_is:
                row = asdict(run_summary(folder))
                known = as_it_is, row
                if row["state"] != "running":  # a process that dies leaves the file as it is
                    self._ended[name] = known
            rows.append(known[1])
        return rows

    async def _begin(self, folder: RunFolder) -> RunWatch:
        await self._make_room()
        watch = RunWatch(folder)
        self._watches[folder.run] = (watch, time.monotonic())
        watch.start()
        return watch

    async def _make_room(self) -> None:
        """Close watches without viewers, the longest unused one first."""
        now = time.monotonic()
        idle = sorted((used_t, name) for name, (watch, used_t) in self._watches.items()
                      if not watch.has_viewers and not watch.is_live)
        too_many = len(self._watches) + 1 - MAX_WATCHED
        for at, (used_t, name) in enumerate(idle):
            if at < too_many or now - used_t > _KEEP_S:
                await self._watches.pop(name)[0].close()

    async def _look_for_runs(self) -> None:
        while True:
            for path in await asyncio.to_thread(self._with_socket):
                if path.name not in self._watches and len(self._watches) < MAX_WATCHED:
                    with suppress(LmctlError):
                        await self._begin(find_run_folder(self.runs_dir, path.name))
            await self._make_room()
            await asyncio.sleep(_LOOK_S)

    def _with_socket(self) -> list[Path]:
        with suppress(OSError):
            return [path.parent for path in self.runs_dir.glob(f"run-*/{SOCKET_NAME}")]
        return []


def _size_and_time(path: Path) -> tuple[int, int]:
    """Size and time of the last change of a file, zeros where there is none."""
    try:
        found = path.stat()
    except OSError:
        return 0, 0
    return found.st_size, found.st_mtime_ns
