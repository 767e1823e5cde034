"""One job on one accepted cell, from where it is entered: clock, powder and deposition together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from lmctl.config.machine import Hopper, MachineProfile
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer
from lmctl.run.cell.devices import Cell
from lmctl.run.deposition import Deposition, Progress
from lmctl.run.journal.recorder import Recorder
from lmctl.run.layers import LayerTally
from lmctl.run.powder.feed import PowderFeed
from lmctl.run.powder.lead import Hose, PowderPlan
from lmctl.run.program.clock import ProgramClock
from lmctl.run.program.reentry import START, Entry, Place, enter
from lmctl.run.program.window import JobWindow


@dataclass(frozen=True)
class Work:
    """What a run works with between one hold and the next."""

    clock: ProgramClock
    feed: PowderFeed
    deposition: Deposition


@dataclass(frozen=True)
class Workshop:
    """Makes `Work` for a job.

    beam_off : every power is sent as zero
    done, failed : as `Deposition` and `PowderFeed` have them
    """

    job: JobReader
    profile: MachineProfile
    hoppers: Sequence[Hopper]
    cell: Cell
    recorder: Recorder
    beam_off: bool
    done: Callable[[], None]
    failed: Callable[[Exception], None]
    progress: Progress | None

    def make(self, place: Place, before: Work | None, override_percent: int) -> Work | None:
        """Work that goes on from a place; None where no bead is left to lay.

        before : the work that was broken off there
        override_percent : the feed override it is to run at
        """
        entry: Entry | None = None
        if place != START:
            entry = enter(self.job.manifest, self.job.layer, place, self.profile.motion)
            if entry is None:
                return None
            self.recorder.entry(entry)
        window = self._window(entry)
        self._announce(window, override_percent)
        clock = ProgramClock(window)
        hoses = [
            Hose(h.dead_time_s, h.lag_s, h.max_flow_g_min, h.min_flow_g_min)
            for h in self.hoppers
        ]
        plan = PowderPlan(self.job.manifest.powder_mode, hoses, window, clock)
        feed = PowderFeed(self.cell, plan, clock, self.recorder, self.failed)
        return Work(clock, feed, Deposition(
            self.cell, window, clock, feed, self.recorder, self.profile.motion,
            entry=entry, tally=self._tally(entry, before), done=self.done, failed=self.failed,
            progress=self.progress,
        ))

    def _announce(self, window: JobWindow, override_percent: int) -> None:
        """What lies ahead, by the plan, until the deposition can tell."""
        if self.progress is not None:
            begin = window.begin()
            left_s = window.end_s - begin.starts_s[0]
            self.progress(begin.starts_s[0], window.end_s, begin.index,
                          left_s * 100.0 / override_percent)

    def _window(self, entry: Entry | None) -> JobWindow:
        def layer(index: int) -> JobLayer:
            entered = entry is not None and index == entry.layer.index
            return entry.layer if entry is not None and entered else self.job.layer(index)

        first = 0 if entry is None else entry.layer.index
        return JobWindow(self.job.manifest, layer, self.profile.motion.purge_mm,
                         beam_off=self.beam_off, first_layer=first)

    def _tally(self, entry: Entry | None, before: Work | None) -> LayerTally | None:
        """What the layer entered has taken before the hold."""
        if before is None or entry is None:
            return None
        self.recorder.purged(before.feed.take_fed_g())
        layers = before.deposition.layers
        layers.done_before(entry.layer.index)
        return layers.tally
