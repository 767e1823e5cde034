"""One job on one accepted cell, from where it is entered: clock, powder and deposition together."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.errors import MachineError
from lmctl.job.reader import JobReader
from lmctl.job.schema import JobLayer
from lmctl.run.cell.devices import Cell
from lmctl.run.execution.deposition import Deposition, Progress
from lmctl.run.execution.layer_accounts import LayerAccounts
from lmctl.run.execution.layer_plan import LayerPlan, layer_plan
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.height_control import HeightControl
from lmctl.run.powder.hose_calibration import HoseCalibration
from lmctl.run.powder.layer_purge import LayerPurges
from lmctl.run.powder.lead import PowderPlan
from lmctl.run.powder.setpoint_sender import SetpointSender
from lmctl.run.program.job_window import JobWindow
from lmctl.run.program.layer_program import LayerProgram, layer_program_of
from lmctl.run.program.place import JOB_START, PlaceReached
from lmctl.run.program.program_clock import ProgramClock
from lmctl.run.program.reentry import Reentry, ReentryPreview, plan_reentry, preview_of


@dataclass(frozen=True)
class RunSegment:
    """What a run works with between one hold and the next."""

    clock: ProgramClock
    feed: SetpointSender
    deposition: Deposition


@dataclass(frozen=True)
class RunSegmentFactory:
    """Makes `RunSegment` for a job.

    accounts : of the layers, for the whole run
    beam_off : every power is sent as zero
    done, failed : as `Deposition` and `SetpointSender` have them
    hoses : dead times and lags in use
    heights, purges : height checks, where the job asks for them, and purges between layers, where
        the profile does
    stop_due : called at the end of a layer where the run is to be held for either
    """

    job: JobReader
    profile: MachineProfile
    hoppers: Sequence[HopperSettings]
    cell: Cell
    recorder: RunRecorder
    accounts: LayerAccounts
    beam_off: bool
    hoses: HoseCalibration
    done: Callable[[], None]
    failed: Callable[[Exception], None]
    progress: Progress | None
    heights: HeightControl | None = None
    purges: LayerPurges | None = None
    stop_due: Callable[[], None] = lambda: None

    def create(
        self, reached: PlaceReached, before: RunSegment | None, override_percent: int
    ) -> RunSegment | None:
        """Work that goes on from a place, which must be known; None where no bead is left.

        before : the work that was broken off there
        override_percent : the feed override it is to run at
        """
        entry: Reentry | None = None
        if reached.is_doubtful:
            raise MachineError(
                "where deposition ended is not known",
                hint="stop the run; `lmctl recover` asks what is on the part, and goes on")
        if reached.place != JOB_START:
            entry = plan_reentry(
                self.job.manifest, self.job.read_layer, reached.place, self.profile.motion)
            if entry is None:
                return None
            self.recorder.record_entry(entry)
        if before is not None:
            self.recorder.record_purge(before.feed.fed.take_remaining_fed_g(asyncio.get_running_loop().time()))
        window = self._window(entry)
        self._announce(window, override_percent)
        clock = ProgramClock(window)
        factor = 1.0 if self.heights is None else self.heights.volume_factor
        plan = PowderPlan(self.job.manifest.powder_mode, self.hoses.dynamics(), window,
                          clock, factor)
        self.accounts.plan_of = lambda layer: self._plan_of(layer, entry, window)
        feed = SetpointSender(self.cell, plan, clock, self.recorder, self.failed)
        return RunSegment(clock, feed, Deposition(
            self.cell, window, clock, feed, self.recorder, self.accounts, self.profile.motion,
            entry=entry, reached=reached,
            stop_before=self._layer_stop(window.first_layer().index), done=self.done,
            failed=self.failed, progress=self.progress,
        ))

    def preview(self, reached: PlaceReached) -> ReentryPreview | None:
        """Where the job would go on from a place; None where that is not known, or no bead is left.
        """
        if reached.is_doubtful:
            return None
        entry = plan_reentry(
            self.job.manifest, self.job.read_layer, reached.place, self.profile.motion)
        return None if entry is None else preview_of(entry)

    def _layer_stop(self, layer: int) -> tuple[int, Callable[[], None]] | None:
        """The line before which the run is held next between layers, and what announces it."""
        asking = [(found, one.on_boundary) for one in (self.heights, self.purges)
                  if one is not None and (found := one.next_boundary(layer)) is not None]
        if not asking:
            return None
        line = min(boundary.line for boundary, _ in asking)

        def reached() -> None:
            for boundary, announce in asking:
                if boundary.line == line:
                    announce(boundary)
            self.stop_due()

        return line, reached

    def _announce(self, window: JobWindow, override_percent: int) -> None:
        """Time left by the plan, until the deposition reports it."""
        if self.progress is not None:
            begin = window.first_layer()
            left_s = window.end_s - begin.starts_s[0]
            self.progress(begin.starts_s[0], window.end_s, begin.index,
                          left_s * 100.0 / override_percent)

    def _window(self, entry: Reentry | None) -> JobWindow:
        def layer(index: int) -> JobLayer:
            entered = entry is not None and index == entry.layer.index
            return entry.layer if entry is not None and entered else self.job.read_layer(index)

        first = 0 if entry is None else entry.layer.index
        return JobWindow(self.job.manifest, layer, self.profile.motion.purge_mm,
                         beam_off=self.beam_off, first_layer=first)

    def _plan_of(self, index: int, entry: Reentry | None, window: JobWindow) -> LayerPlan:
        """What the job plans for a layer, also where its head was replaced by a way in."""
        layer = window.layer_program(index)
        if entry is not None and index == entry.layer.index:
            layer = self._complete_layer(index)
        following = None
        if index + 1 < len(self.job.manifest.layers):
            following = window.layer_program(index + 1)
        leads = self.job.manifest.powder_mode == "lead"
        return layer_plan(layer, following, {
            hopper.name: hose.dead_time_s + hose.lag_s if leads else 0.0
            for hopper, hose in zip(self.hoppers, self.hoses.dynamics(), strict=True)
        })

    def _complete_layer(self, index: int) -> LayerProgram:
        behind = self.job.read_layer(index - 1).lines[-1] if index else None
        behind_mm = self.profile.motion.purge_mm if behind is None else (
            behind["x_mm"], behind["y_mm"], behind["z_mm"])
        return layer_program_of(self.job.read_layer(index), np.array(behind_mm, dtype=np.float64),
                                0.0,
                                beam_off=self.beam_off)
