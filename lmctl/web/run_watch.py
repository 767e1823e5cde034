"""Watches one run for all viewers of it: queries its status, follows its journal, publishes both.

However many viewers there are, the run answers one query in `STATUS_PERIOD_S`. Nothing here can
stop or delay a run: its process takes requests when it has time, and its journal is only read.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from contextlib import suppress
from typing import Any

from lmctl.errors import LmctlError
from lmctl.run.journal.format import last_record
from lmctl.run.journal.run_folders import RunFolder, run_summary
from lmctl.web.control_link import ControlLink
from lmctl.web.job_layers import JobLayers
from lmctl.web.journal_points import JournalPoints, Points
from lmctl.web.journal_tail import JournalTail, TailBatch, first_record
from lmctl.web.run_snapshot import Snapshot, ended_snapshot, latest_mixture, live_snapshot
from lmctl.web.viewer_queue import ViewerQueue, sse_message

#: Between two queries of a run's status, and two looks at its journal [s].
STATUS_PERIOD_S, JOURNAL_PERIOD_S = 0.2, 0.05

#: Between two tries to reach a run that does not answer [s].
_RETRY_S = 1.0

#: Points and events that a new viewer is shown: ten minutes at five reports a second.
_POINTS_KEPT, _EVENTS_KEPT = 3000, 200

#: Records that people read as they come.
_EVENTS = frozenset({
    "state", "operator", "alarm", "alarm_cleared", "warning", "fault", "override", "refill",
    "entry", "place", "layer_opened", "seal", "slope_correction", "height", "hose_response",
})
_LEFT_OUT = frozenset({"prev", "sha256"})


class RunWatch:
    """One watched run. `start` it on the running loop, and `close` it.

    job : its layers, None before the journal has a header or where the job cannot be read
    """

    def __init__(self, folder: RunFolder) -> None:
        self.folder = folder
        self.job: JobLayers | None = None
        self._tail = JournalTail(folder.journal)
        self._header: dict[str, Any] = {}
        self._curves: JournalPoints | None = None
        self._points: deque[Points] = deque()
        self._events: deque[dict[str, Any]] = deque(maxlen=_EVENTS_KEPT)
        self._status: dict[str, Any] | None = None
        self._answered_t = 0.0
        self._ended: Snapshot | None = None
        self._viewers: set[ViewerQueue] = set()
        self._all: bytes | None = None  # what a new viewer starts with, until something is new
        self._tasks: list[asyncio.Task[None]] = []
        self.caught_up = asyncio.Event()

    @property
    def is_live(self) -> bool:
        """Whether a process drives the run."""
        return self._status is not None

    @property
    def has_viewers(self) -> bool:
        return bool(self._viewers)

    def start(self) -> None:
        self._tasks = [asyncio.create_task(self._follow_journal(), name="journal tail"),
                       asyncio.create_task(self._query_status(), name="run status")]

    async def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self.job is not None:
            self.job.close()

    def snapshot(self) -> Snapshot:
        """The run now."""
        if self._status is not None:
            age_s = time.monotonic() - self._answered_t
            return live_snapshot(self._status, self._mixture(self._status.get("now_s")), age_s)
        if self._ended is None:
            summary = run_summary(self.folder)  # first: its end then is the last record, too
            last: dict[str, Any] = {}
            with suppress(LmctlError):  # it has no journal, or none that can be read
                last = last_record(self.folder.journal) or {}
            self._ended = ended_snapshot(
                self.folder, summary, self._header, last, self._mixture(None))
        return self._ended

    def add_viewer(self) -> ViewerQueue:
        """A viewer's queue; it starts with everything there is."""
        viewer = ViewerQueue(self._everything)
        self._viewers.add(viewer)
        return viewer

    def remove_viewer(self, viewer: ViewerQueue) -> None:
        self._viewers.discard(viewer)

    def _everything(self) -> bytes:
        if self._all is not None:
            return self._all
        joined: Points = {}
        for points in self._points:
            for name, column in points.items():
                joined.setdefault(name, []).extend(column)
        self._all = sse_message("everything", {
            "snapshot": self.snapshot(), "points": joined, "events": list(self._events)})
        return self._all

    def _mixture(self, now_s: float | None) -> dict[str, Any] | None:
        if self.job is None or not self._points:
            return None
        return latest_mixture(self._points[-1], self.job.materials, now_s)

    # --- status -------------------------------------------------------------------------------

    async def _query_status(self) -> None:
        while True:
            try:
                async with ControlLink(self.folder.path) as link:
                    while True:
                        self._status = await link.request("status")
                        self._answered_t, self._ended = time.monotonic(), None
                        self._publish_snapshot()
                        await asyncio.sleep(STATUS_PERIOD_S)
            except LmctlError:
                pass
            if self._status is not None:
                self._status = None
                self._publish_snapshot()
            await asyncio.sleep(_RETRY_S)

    def _publish_snapshot(self) -> None:
        self._all = None
        if self._viewers:
            message = sse_message("snapshot", self.snapshot())
            for viewer in self._viewers:
                viewer.offer_snapshot(message)

    # --- journal ------------------------------------------------------------------------------

    async def _follow_journal(self) -> None:
        while True:
            if self._tail.has_grown():
                batch, points, events = await asyncio.to_thread(self._read_journal)
                self._take(batch, points, events)
                if batch.more:
                    continue
            self.caught_up.set()
            await asyncio.sleep(JOURNAL_PERIOD_S)

    def _read_journal(self) -> tuple[TailBatch, list[Points], list[dict[str, Any]]]:
        """In a thread: read, and work out points."""
        if not self._header:
            self._header = first_record(self.folder.journal)
            if self._header:
                self._open_job()
        batch = self._tail.read_new()
        if batch.skipped and self._curves is not None:
            self._curves.restart()
        curves, events = [], []
        for record in batch.records:
            if found := self._points_of(record):
                curves.append(found)
            if record["kind"] in _EVENTS:
                events.append({k: v for k, v in record.items() if k not in _LEFT_OUT})
        return batch, curves, events

    def _open_job(self) -> None:
        try:
            self.job = JobLayers(self.folder.job, self._header)
            self._curves = JournalPoints(self._header, self.job)
        except (LmctlError, KeyError, TypeError, ValueError, AttributeError):
            self._curves = None  # a damaged header

    def _points_of(self, record: dict[str, Any]) -> Points | None:
        """A damaged record ends the curves of a run, but neither its status nor its events."""
        if self._curves is None:
            return None
        try:
            return self._curves.take(record)
        except (LmctlError, KeyError, TypeError, ValueError, AttributeError, IndexError):
            self._curves = None
            return None

    def _take(
        self, batch: TailBatch, points: list[Points], events: list[dict[str, Any]]
    ) -> None:
        if batch.records:
            self._all = None
            self._ended = None
        self._points.extend(points)
        self._events.extend(events)
        kept = sum(len(one["at_s"]) for one in self._points)
        while kept > _POINTS_KEPT and len(self._points) > 1:
            kept -= len(self._points.popleft()["at_s"])
        messages = [sse_message("points", one) for one in points]
        if events:
            messages.append(sse_message("events", events))
        for viewer in self._viewers:
            if batch.skipped:
                viewer.start_anew()
            elif messages:
                viewer.offer(b"".join(messages))
        if not self.is_live and batch.records:
            self._publish_snapshot()


def encoded(value: Any) -> bytes:
    """A value as JSON for an answer."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode("utf-8")
