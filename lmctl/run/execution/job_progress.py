"""How far a run is with its job: from the place it begins at, through each hold, to the last line.

Between one hold and the next there is one `RunSegment`; the next one enters at the place where the
hold left off. The feed override, requested for the whole run, is kept here and passed to each.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from lmctl.run.cell.devices import Cell
from lmctl.run.execution.run_segment import RunSegment, RunSegmentFactory
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.program.override_limits import NO_OTHER_OVERRIDE
from lmctl.run.program.place import JOB_START, NOTHING_REACHED, PlaceReached
from lmctl.run.program.reentry import ReentryPreview

_OVERRIDE_PATIENCE_S = 5.0


class JobProgress:
    """The progress of one run through its job.

    begins_at : how far an earlier run has come with it
    override_percent : the requested feed override
    """

    def __init__(self, recorder: RunRecorder, begins_at: PlaceReached = NOTHING_REACHED) -> None:
        self.override_percent = 100
        self._recorder = recorder
        self._begins_at = begins_at
        self._loop = asyncio.get_running_loop()
        self._segments: RunSegmentFactory | None = None
        self._work: RunSegment | None = None
        self._resumed = False
        self._preview: tuple[PlaceReached, ReentryPreview | None] | None = None

    # --- how far ------------------------------------------------------------------------------

    @property
    def is_entered(self) -> bool:
        """Whether the machine was accepted, so that something of it may have been switched on."""
        return self._work is not None

    @property
    def has_begun(self) -> bool:
        """Whether a line of the job may have been executed, by this run or before it."""
        started = self._work is not None and self._work.deposition.started
        return started or self._begins_at.place != JOB_START or self._resumed

    @property
    def lines_executed(self) -> int:
        """Lines of the job known to be executed, by this run or before it."""
        if self._work is None:
            return self._begins_at.place.line
        return self._work.deposition.lines_executed

    @property
    def place_text(self) -> str:
        """Where in the job the run is, for people."""
        if self._work is None or not self._work.deposition.started:
            return "the purge position, before the first line"
        return self._work.deposition.place_text

    @property
    def designed_fractions(self) -> dict[str, float] | None:
        """Volume fractions that the part file has at the line under way; None where unknown."""
        return None if self._work is None else self._work.deposition.designed_fractions

    @property
    def lines_sent(self) -> int:
        """Lines of the job executed, and those that the controller holds; at rest it holds none."""
        if self._work is None or not self._work.deposition.is_in_progress:
            return self.lines_executed
        return max(self._work.deposition.lines_sent, self.lines_executed)

    def reentry_preview(self) -> ReentryPreview | None:
        """Where the job would go on from the place at rest; None where no bead is left.

        Planned once for each hold: it reads a layer.
        """
        if self._segments is None:
            raise AttributeError("the machine has not been accepted")
        reached = self.segment.deposition.reached
        if self._preview is None or self._preview[0] != reached:
            self._preview = reached, self._segments.preview(reached)
        return self._preview[1]

    @property
    def segment(self) -> RunSegment:
        """The run segment since the last hold."""
        if self._work is None:
            raise AttributeError("the machine has not been accepted")
        return self._work

    # --- on and off ---------------------------------------------------------------------------

    def begin(self, segments: RunSegmentFactory) -> None:
        """A machine has been accepted: make ready for the first line to be run on it."""
        self._segments = segments
        self._work = segments.create(self._begins_at, None, self.override_percent)
        assert self._work is not None, "recovery refuses a run that has deposited every bead"

    def continue_after_hold(self) -> bool:
        """A hold ends: prepare to resume from the place reached; False where no bead is left."""
        if self._segments is None:
            raise AttributeError("the machine has not been accepted")
        work = self._segments.create(self.record_place(), self.segment, self.override_percent)
        self._resumed = True
        if work is not None:
            self._work = work
        return work is not None

    def stop_sending(self) -> None:
        """Motion is to end: no more lines, and the program clock stops."""
        self.segment.deposition.stop()
        self.segment.clock.stop_at(self._loop.time())

    def finish_path(self, path_done: Callable[[], None]) -> None:
        """Begin no further path; `path_done` is called at the end of the one under way."""
        self.segment.deposition.finish_path(path_done)

    def record_place(self) -> PlaceReached:
        """How far the job has been executed, now that motion has been stopped; journaled."""
        reached = self.segment.deposition.place_at_rest()
        self._recorder.record_place(reached, self.segment.deposition.standstill_mm)
        return reached

    def set_override(self, percent: int) -> None:
        """Set the feed override where powder can follow; before the beam is armed, for all."""
        self.override_percent = percent
        self._recorder.record_override(percent, "operator")
        if self._work is not None:
            self._work.deposition.schedule_override(percent)

    async def restore_requested_override(self, cell: Cell) -> None:
        """Restore the requested feed override: any override left set at the panel is undone.

        Sent whatever was reported, which may be some reports old. Raises MachineError.
        """
        motion, percent = cell.motion, self.override_percent
        wanted = (percent, 100, 100)
        for byte in NO_OTHER_OVERRIDE:
            motion.send_realtime(byte)
        self.segment.deposition.set_override_now(percent)
        await cell.wait_until(
            lambda: motion.overrides == wanted, _OVERRIDE_PATIENCE_S,
            f"a feed override of {percent} %",
            hint="reports must carry Ov: for grblHAL add 64 to $10",
        )
