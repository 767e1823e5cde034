"""How each effect of the state table is carried out on the cell."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.errors import JournalError, MachineError
from lmctl.job.reader import JobReader
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.run.cell import acceptance
from lmctl.run.cell.beam_control import BeamControl
from lmctl.run.cell.devices import Cell, ReportAges
from lmctl.run.cell.work_offset import refuse_changed_offset
from lmctl.run.execution.deposition import Progress
from lmctl.run.execution.device_monitor import DeviceMonitor
from lmctl.run.execution.job_progress import JobProgress
from lmctl.run.execution.layer_accounts import LayerAccounts
from lmctl.run.execution.run_segment import RunSegmentFactory
from lmctl.run.interlocks.alarms import InterlockError, RunAlarms
from lmctl.run.interlocks.board import InterlockRow
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.journal.last_known_position import LastKnownPosition
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.height_control import HeightControl
from lmctl.run.powder.purge_procedure import PurgeProcedure
from lmctl.run.powder.refill import RefillProcedure
from lmctl.run.powder.slope_watch import SlopeWatch
from lmctl.run.powder.supply import SupplyWatch
from lmctl.run.program.reentry import ReentryPreview
from lmctl.run.state.transitions import Effect
from lmctl.run.status.phase import PhaseClock

#: A held run waits so long for its operator; then it is stopped, and can be recovered [s].
HELD_AT_MOST_S = 1800.0

#: Effects that only feeders can fail.
_BY_FEEDERS = frozenset({
    Effect.ACKNOWLEDGE, Effect.GAS_ON, Effect.POWDER_ON, Effect.AWAIT_STABLE, Effect.POWDER_OFF,
    Effect.GAS_OFF,
    Effect.GAS_OFF_NOW, Effect.OPEN_HOPPER, Effect.CLOSE_HOPPER,
})


class CellSequence:
    """Carries out effects on one cell for one job.

    course : how far the run is with the job
    program_done : called when the last line has been executed
    held : whether a hold that the machine reports is this run's own
    tripped : called with each reason to hold (Interlock) or to end the run
    whereabouts, run : what is known of the machine's position, and who will move it
    continues : what an earlier run has made of the part; None for a new one
    refilling : the hoppers that are refilled in this run
    refill_due : called when the run is held and a hopper is to be opened
    heights : of the part, where the job asks for them; height_asked : called when the run is held
        for one
    purge : every purge of the run; resume_due : called when it is held for one between layers
    layer_stop_due : called at the end of a layer where the run is to be held for either
    alarms : what is wrong, or was when the run was last held
    accounts : of the layers
    phase : what is under way, and for how long
    beam_off : whether every power is sent as zero: no safety-input device, and not the bench
    """

    def __init__(
        self, job: JobReader, profile: MachineProfile, hoppers: Sequence[HopperSettings],
        recorder: RunRecorder, course: JobProgress, *, program_done: Callable[[], None],
        held: Callable[[], bool], tripped: Callable[[Exception], None],
        refill_due: Callable[[], None], layer_stop_due: Callable[[], None],
        height_asked: Callable[[], None], resume_due: Callable[[], None],
        progress: Progress | None, whereabouts: LastKnownPosition, run: str,
        continues: EarlierRun | None = None, heights: HeightControl | None = None,
    ) -> None:
        self.alarms = RunAlarms()
        self.accounts = LayerAccounts(recorder)
        self.phase = PhaseClock(
            profile, hoppers, job.manifest.powder_mode, held_at_most_s=HELD_AT_MOST_S)
        self.beam_off = True
        self._job = job
        self._profile = profile
        self._hoppers = tuple(hoppers)
        self._recorder = recorder
        self._course = course
        self._whereabouts = whereabouts
        self._run = run
        self._program_done = program_done
        self._held = held
        self._tripped = tripped
        self._refill_due = refill_due
        self.heights = heights
        self._layer_stop_due = layer_stop_due
        self._height_asked = height_asked
        self._resume_due = resume_due
        self.purge = PurgeProcedure(job.manifest, profile, hoppers, self.alarms, recorder)
        self.refilling = RefillProcedure(hoppers, recorder)
        self._progress = progress
        self._continues = continues
        self._loop = asyncio.get_running_loop()
        self._cell: Cell | None = None
        self._watch: DeviceMonitor | None = None
        self._supply: SupplyWatch | None = None
        self._slopes: SlopeWatch | None = None
        self._acts = {
            Effect.CONNECT: self._connect,
            Effect.CHECK_MACHINE: self._check_machine,
            Effect.MOVE_TO_PURGE: self._move_to_purge,
            Effect.GAS_ON: self._gas_on,
            Effect.POWDER_ON: self._powder_on,
            Effect.AWAIT_STABLE: self._await_stable,
            Effect.ARM_BEAM: self._arm_beam,
            Effect.LEAD_POWDER: self._lead_powder,
            Effect.START_MOTION: self._start_motion,
            Effect.FEED_HOLD: self._feed_hold,
            Effect.CLEAR_MOTION: self._clear_motion,
            Effect.AWAIT_OPERATOR: self._await_operator,
            Effect.OPEN_HOPPER: lambda: self.refilling.open_hopper(self._connected),
            Effect.CLOSE_HOPPER: self._close_hopper,
            Effect.ACKNOWLEDGE: self._acknowledge,
            Effect.LEAVE_PART: self._leave_part,
            Effect.REST_BEAM: self._rest_beam,
            Effect.STOP_MOTION: self._stop_motion,
            Effect.POWDER_OFF: self._powder_off,
            Effect.GAS_OFF: self._gas_off,
            Effect.GAS_OFF_NOW: self._gas_off_now,
        }

    async def carry_out_effect(self, do: Effect) -> None:
        """Return when the effect has been achieved. Raises MachineError, JobError.

        What a feeder will not do is an Interlock: the others and motion can still be held.
        """
        self._recorder.record_effect(do)
        self.phase.begin_effect(do, self._loop.time())
        try:
            await self._acts[do]()
        except MachineError as error:
            if do in _BY_FEEDERS:
                raise InterlockError.from_error(error.what, error) from error
            raise

    def halt(self, error: Exception | None) -> None:
        """Beam and motion off at once, without waiting."""
        if self._course.is_entered:
            self._course.segment.deposition.stop()
        if self._cell is not None:
            self._beam.switch_off_now(error)

    def active_alarms(self) -> list[MachineError]:
        """What prevents a held run from resuming now."""
        return [] if self._watch is None else self._watch.active_alarms()

    def interlock_board(self) -> list[InterlockRow]:
        """Every interlock as it is now; empty before the machine is accepted."""
        return [] if self._watch is None else self._watch.interlock_board()

    def report_ages(self) -> ReportAges:
        """How old the devices' last reports are."""
        return ReportAges() if self._cell is None else self._cell.report_ages()

    def reentry_preview(self) -> ReentryPreview | None:
        """Where a held run would go on; None where it has not begun, or no bead is left."""
        return self._course.reentry_preview() if self._course.is_entered else None

    def hopper_levels(self) -> list[dict[str, Any]]:
        """How full the hoppers are that report it."""
        return [] if self._cell is None else self._cell.hopper_levels()

    def stop_listening(self) -> None:
        """The run is over: send nothing more, and ignore further reports."""
        for watch in (self._watch, self._supply, self._slopes):
            if watch is not None:
                watch.stop()
        if self._course.is_entered:
            feed = self._course.segment.feed
            feed.stop()
            self.accounts.close_at_reached_place()
            self._recorder.record_purge(feed.fed.take_remaining_fed_g(self._loop.time()))

    async def close(self) -> None:
        """Release the cell, however the run ended."""
        if self._cell is not None:
            with suppress(JournalError):  # unwritten, the position is not trusted the next time
                self._whereabouts.record_run_end(self._cell.motion)
            await self._cell.close()
        await self.purge.close()

    @property
    def position_trusted(self) -> bool:
        """Whether the reported position is trusted; before the first query, by the earlier run."""
        if self._cell is None:
            return self._continues is not None and self._continues.is_position_trusted
        return self._cell.motion.position_trusted

    # --- start --------------------------------------------------------------------------------

    async def _connect(self) -> None:
        self._cell = await Cell.connect(self._profile, self._hoppers)

    async def _check_machine(self) -> None:
        cell, profile = self._connected, self._profile
        self.beam_off = await acceptance.accept_machine(
            cell, profile, self._job, self._recorder, self._whereabouts, run=self._run,
            continues=self._continues,
        )
        self._course.begin(RunSegmentFactory(
            self._job, profile, self._hoppers, cell, self._recorder,
            self.accounts, self.beam_off, self.purge.hoses, self._program_done,
            self._tripped, self._progress, self.heights, self.purge.layers, self._layer_stop_due,
        ))
        self._watch = DeviceMonitor(
            cell, profile, lambda: self._course.segment.deposition, self.alarms, self._recorder,
            self._tripped, self._held,
        )
        self._supply = SupplyWatch(
            self._job, self._hoppers, cell, lambda: self._course.segment.clock, self.alarms,
            self._recorder)
        self._supply.start()
        self._slopes = SlopeWatch(
            self._hoppers, profile, cell, lambda: self._course.segment.feed.fed,
            lambda: self._course.segment.deposition.is_in_progress, self.alarms,
            self._recorder)
        self._slopes.start()
        acceptance.refuse_unready(self._watch.active_alarms())

    async def _move_to_purge(self) -> None:
        await self._beam.move_to_purge(self._profile.motion)

    async def _gas_on(self) -> None:
        await self.purge.switch_gas_on(self._connected)

    async def _powder_on(self) -> None:
        await self.purge.switch_powder_on(self._connected, self._course.segment.feed)

    async def _await_stable(self) -> None:
        await self.purge.settle(self._connected, self._course.segment.feed)
        await self.refilling.prove_flow(self._connected)

    async def _arm_beam(self) -> None:
        await self._course.restore_requested_override(self._connected)
        await self._beam.arm()

    async def _lead_powder(self) -> None:
        """Run the program's clock down to its start, so that led powder arrives in time."""
        wait_s = self._course.segment.feed.plan.lead_s
        self._course.segment.clock.start_at(self._loop.time() + wait_s)
        await asyncio.sleep(wait_s)

    async def _start_motion(self) -> None:
        self._course.segment.deposition.start()

    # --- hold and resume ----------------------------------------------------------------------

    async def _feed_hold(self) -> None:
        self._course.stop_sending()
        await self._beam.hold()

    async def _clear_motion(self) -> None:
        """A reset at standstill keeps the position and drops what was planned."""
        self._course.record_place()
        await self._connected.motion.reset()

    async def _await_operator(self) -> None:
        if self.refilling.take_due_request():
            self._refill_due()
        if self.heights is not None and self.heights.awaited is not None:
            self.alarms.notify(self.heights.request_text())
            self._height_asked()
        elif self._is_purge_all_that_holds():
            self._resume_due()
        await asyncio.sleep(HELD_AT_MOST_S)

    def _is_purge_all_that_holds(self) -> bool:
        """Whether the run was held for a purge alone, so that it goes on by itself."""
        is_due = self.purge.layers is not None and self.purge.layers.take_due()
        return is_due and self.refilling.hopper is None and not (
            len(self.alarms) or self.active_alarms())

    async def _close_hopper(self) -> None:
        self.alarms.notify(await self.refilling.weigh_and_record(self._connected))

    async def _acknowledge(self) -> None:
        """The operator has commanded resume: reset latched alarms whose cause is gone."""
        faulty = [
            feeder for feeder in self._connected.feeders
            if feeder.fault is not None or (feeder.status is not None and feeder.status.alarm)
        ]
        self._watching.acknowledge()
        await acceptance.reset_alarms(self._connected, faulty)

    async def _leave_part(self) -> None:
        """Move to the purge position; from there the job resumes at the place reached."""
        await self._beam.come_to_rest()
        await refuse_changed_offset(self._connected.motion, self._connected.offset_mm)
        await self._move_to_purge()
        if not self._course.continue_after_hold():
            self._program_done()
            await self._loop.create_future()  # what follows from that breaks this off

    # --- stop ---------------------------------------------------------------------------------

    async def _rest_beam(self) -> None:
        self._course.segment.clock.stop_at(self._loop.time())
        await self._beam.finish_motion()

    async def _stop_motion(self) -> None:
        self._course.stop_sending()
        await self._beam.stop(
            self._course.record_place,
            lambda why: self._recorder.record_effect(Effect.STOP_MOTION, failed=why)
        )

    async def _powder_off(self) -> None:
        self._course.segment.feed.stop()
        await self._connected.for_each_feeder(FeederDriver.stop_powder)

    async def _gas_off(self) -> None:
        """Gas off after the post-flow: powder left in a hose clogs the next start."""
        await self._connected.for_each_feeder(FeederDriver.stop_gas)

    async def _gas_off_now(self) -> None:
        await self._connected.for_each_feeder(lambda feeder: feeder.stop_gas(post_flow=False))

    @property
    def _beam(self) -> BeamControl:
        return BeamControl(self._connected)

    @property
    def _connected(self) -> Cell:
        if self._cell is None:
            raise AttributeError("the cell is not connected")
        return self._cell

    @property
    def _watching(self) -> DeviceMonitor:
        if self._watch is None:
            raise AttributeError("the machine has not been accepted")
        return self._watch
