"""Running a job: from a job file and a profile to a finished part and a sealed journal."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.errors import JobError, LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.preflight.job_check import check_job
from lmctl.preflight.program_check import check_program
from lmctl.run import signals
from lmctl.run.cell.ownership import lock_machine
from lmctl.run.control.server import (
    ControlCallbacks,
    ControlClient,
    ControlSocket,
    listening_socket,
)
from lmctl.run.execution.deposition import Progress
from lmctl.run.execution.job_progress import JobProgress
from lmctl.run.execution.run_header import local_header, run_header
from lmctl.run.execution.unreported_motion import find_unreported_motion
from lmctl.run.journal import run_folders
from lmctl.run.journal.earlier_run import EarlierRun
from lmctl.run.journal.format import read_records
from lmctl.run.journal.last_known_position import LastKnownPosition
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.journal.writer import JournalWriter
from lmctl.run.operator_acts import begin_refill, end_refill, perform_act, request_event
from lmctl.run.powder.height_control import HeightControl
from lmctl.run.program.override_limits import OverrideRange, override_range
from lmctl.run.program.place import NOTHING_REACHED
from lmctl.run.sequence import CellSequence
from lmctl.run.state.state_machine import RunStateMachine
from lmctl.run.state.transitions import FINAL_STATES, RunEvent, RunState
from lmctl.run.status.outcomes import first_out_fields, is_recoverable, outcome_error
from lmctl.run.status.snapshot import RunView
from lmctl.run.status.stop_messages import stop_message
from lmctl.run.status.watcher import Watcher, periodic_watcher_updates
from lmctl.run.trouble_log import TroubleLog

__all__ = ["EarlierRun", "Notice", "Progress", "RunExecutor", "RunResult", "Watcher", "run_job"]

#: A line about an alarm or a warning, for people.
Notice = Callable[[str], None]

_BEAM_STAYED_OFF = (
    "the profile names no safety-input device ([safety]): every power was sent as S0, so the beam "
    "stayed off"
)

#: States in which a hold was not commanded by the host: it was pressed at the machine's panel.
_MUST_NOT_BE_HELD = (
    RunState.GAS, RunState.POWDER, RunState.ARMED, RunState.DEPOSITING, RunState.PURGING,
    RunState.RESUMING,
)


@dataclass(frozen=True)
class RunResult:
    """A finished run.

    lines : program lines executed
    machine_s : time on the machine's clock, from connecting to gas off
    wall_s : time on the wall clock
    warnings : what the operator should know, e.g. that the beam stayed off
    """

    run: str
    state: str
    lines: int
    machine_s: float
    wall_s: float
    journal: Path
    warnings: tuple[str, ...] = ()


class _Live(NamedTuple):
    """What a run that has begun is made of."""

    machine: RunStateMachine
    sequence: CellSequence
    course: JobProgress
    recorder: RunRecorder
    view: RunView


async def run_job(
    job_path: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
    progress: Progress | None = None, notice: Notice | None = None,
    watcher: Watcher | None = None,
) -> RunResult:
    """Run a job on the machine a profile names; see `RunExecutor`."""
    return await RunExecutor(
        job_path, profile, runs_dir, operator=operator, progress=progress, notice=notice,
        watcher=watcher,
    ).run()


class RunExecutor:
    """One run of one job. `hold`, `resume`, `stop` and `set_override` act while `run` runs.

    progress : called with (program time done, in all, layer, machine time left) about once a second
    notice : called with one line of text for each alarm and warning as it appears
    continues : the run that has made the part so far, or None
    watcher : called with a snapshot once a second of machine time
    folder : of the run, None before it is made
    """

    def __init__(
        self, job_path: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
        progress: Progress | None = None, notice: Notice | None = None,
        continues: EarlierRun | None = None, watcher: Watcher | None = None,
    ) -> None:
        self._job_path = job_path
        self._profile = profile
        self._runs_dir = runs_dir
        self._operator = operator
        self._progress = progress
        self._notice = notice
        self._continues = continues
        self._watcher = watcher
        self._override_percent = 100
        self._override_range = OverrideRange()
        self._height_asked = asyncio.Event()
        self._live: _Live | None = None
        self.folder: run_folders.RunFolder | None = None

    @property
    def state(self) -> RunState:
        """Where the run is."""
        return RunState.READY if self._live is None else self._live.machine.state

    # --- the operator -------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path, beam off, position kept. Raises UsageError where that cannot be."""
        self._request(RunEvent.HOLD)

    def resume(self) -> None:
        """End a hold; the beam returns once the hose is purged.

        Raises UsageError where nothing is held, or the cause of the hold persists.
        """
        active = [] if self._live is None else self._live.sequence.active_alarms()
        if active and self.state is RunState.HELD:
            raise UsageError(
                f"cannot resume: {active[0].what}",
                where=[error.what for error in active[1:]], hint=active[0].hint,
            )
        heights = None if self._live is None else self._live.sequence.heights
        if heights is not None and heights.awaited is not None and self.state is RunState.HELD:
            raise UsageError("cannot resume: the run is held for a height check",
                             where=heights.request_text(),
                             hint="`lmctl height --skip` goes without")
        self._request(RunEvent.RESUME)

    async def height_awaited(self) -> None:
        """Return when the run is held for a height check."""
        await self._height_asked.wait()
        self._height_asked.clear()

    def enter_height(self, height_mm: float | None) -> None:
        """The height of the part in a run that is held for it; None: it was not measured.

        Raises UsageError where none is awaited, or this one cannot be.
        """
        live = self._live
        heights = None if live is None else live.sequence.heights
        if live is None or heights is None:
            raise UsageError("no height is asked for in this run",
                             hint="[process] height_check_every of the part file asks for it")
        if self.state is not RunState.HELD:
            raise UsageError(f"cannot take a height now: the run is {self.state}",
                             hint="it is asked for when the run is held after a layer")
        live.sequence.alarms.notify(heights.enter(height_mm))

    def refill(self, hopper: str, lot: str = "", mass_g: float = 0.0) -> None:
        """Refill a hopper: without a lot, request it; with a lot, report it done.

        A run that deposits is held at the end of its path; then powder and gas of the hopper's
        feeder go off, and it may be opened. With a lot it is weighed, and the run can be resumed.
        lot, mass_g : of the powder filled in, as the operator states
        Raises UsageError where the run has no such hopper or cannot be held for it.
        """
        live = self._live
        if live is None:
            raise UsageError("cannot refill now: the run has not begun",
                             hint="refill when the run has begun, or before it, by hand")
        refilling = live.sequence.refilling
        if lot:
            end_refill(live.machine, refilling, hopper, lot, mass_g)
        else:
            begin_refill(live.machine, live.course, refilling, hopper)

    def stop(self) -> None:
        """End the run: beam and motion, then powder, then gas. A second stop skips post-flow.

        Raises UsageError where the run has not begun or has ended.
        """
        self._request(RunEvent.STOP)

    def set_override(self, percent: int) -> None:
        """Scale speed, beam and powder together; before the run, for all of it.

        During the run it takes effect in the next travel that powder can follow.
        percent : 50 to 200, and what beam and powder of this job can follow
        Raises UsageError for another value, and once the run deposits nothing more.
        """
        self._override_range.check(percent)
        if self.state in {*FINAL_STATES, RunState.FINISHING, RunState.STOPPING, RunState.TRIPPED}:
            raise UsageError(f"cannot override now: the run is {self.state}",
                             hint="override while it deposits or is held")
        self._override_percent = percent
        if self._live is not None:
            self._live.course.set_override(percent)

    def snapshot(self) -> dict[str, Any]:
        """State of the run: see `lmctl.run.status.snapshot`. Not before `run` has begun."""
        live = self._live
        assert live is not None
        return live.view.snapshot(
            self.state, live.course, live.recorder, live.sequence)

    def _came(self, act: str, operator: str, peer: ControlClient, refused: str) -> None:
        """Journal an operator command; a journal that cannot be written ends the run."""
        live = self._live
        assert live is not None
        try:
            live.recorder.record_operator(act, operator, refused, uid=peer.uid, pid=peer.pid)
        except LmctlError as error:
            live.machine.trip(error)

    def _interrupted(self) -> None:
        """Ctrl-C: an operator's stop, answered at once."""
        live = self._live
        assert live is not None
        before = live.machine.state
        is_taken = live.machine.request_event(RunEvent.STOP)
        if is_taken:
            self._came("stop", self._operator, ControlClient(os.getuid(), os.getpid()), "")
        if self._notice is not None:
            self._notice(stop_message(before, live.sequence.phase, is_taken=is_taken))

    def _request(self, event: RunEvent) -> None:
        request_event(None if self._live is None else self._live.machine, event)

    # --- the run ------------------------------------------------------------------------------

    async def run(self) -> RunResult:
        """Run the job to its end.

        Ctrl-C is an operator's stop, and so is being cancelled: the machine is brought to rest
        first. A second one skips the post-flow.
        Raises JobError, ConfigError before anything is touched; MachineError where the machine
        cannot be used; RunFailed after a fault, RunStopped after a stop. A run that has begun
        leaves a sealed journal, whatever ends it.
        """
        began = time.perf_counter()  # of the wall: what a dry run took, and nothing waits for it
        with JobReader(self._job_path) as job:
            check_job(job.manifest, self._profile)
            check_program(job, self._profile)
            self._override_range = override_range(job.manifest, self._profile)
            self._override_range.check(self._override_percent)
            digest = job.digest
        self.folder = made = run_folders.create_run_folder(self._runs_dir, self._job_path)
        try:
            with (
                lock_machine(self._profile, made.run, self._runs_dir),
                listening_socket(made.path) as control, JobReader(made.job) as job,
            ):
                if job.digest != digest:
                    raise JobError(f"{self._job_path} changed while it was read",
                                   hint="run the job again when it is no longer written to")
                hoppers = _hoppers_of(job, self._profile)
                first = run_header(job, self._profile, hoppers, self._operator, self._continues)
                here = local_header(made.run, self._profile)
                with JournalWriter(made.journal, first, local=here) as journal:
                    return await self._drive(job, hoppers, made, journal, control, began)
        finally:
            if not made.journal.exists():
                run_folders.discard_run_folder(made)
                self.folder = None

    async def _drive(
        self, job: JobReader, hoppers: list[HopperSettings], made: run_folders.RunFolder,
        journal: JournalWriter,
        control: socket.socket, began: float,
    ) -> RunResult:
        loop = asyncio.get_running_loop()
        start_t = loop.time()
        recorder = RunRecorder(journal, lambda: loop.time() - start_t, [h.name for h in hoppers])

        if self._continues is not None:
            earlier = run_folders.RunFolder(self._runs_dir / self._continues.run).journal
            for span in find_unreported_motion(job, earlier, self._continues.reached):
                recorder.record_unreported_motion(**span.as_json())

        heights = HeightControl.of_job(job.manifest, recorder)
        if heights is not None and self._continues is not None:
            heights.go_on_from(read_records(
                run_folders.RunFolder(self._runs_dir / self._continues.run).journal))
        view = RunView(made, job.manifest, self._profile, hoppers, self._operator, self._progress)

        course = JobProgress(
            recorder, NOTHING_REACHED if self._continues is None else self._continues.reached)
        sequence = CellSequence(
            job, self._profile, hoppers, recorder, course,
            program_done=lambda: machine.post_event(RunEvent.PROGRAM_DONE),
            held=lambda: machine.state not in _MUST_NOT_BE_HELD,
            tripped=lambda error: machine.trip(error),
            refill_due=lambda: request_event(machine, RunEvent.REFILL),
            layer_stop_due=lambda: machine.post_event(RunEvent.HOLD),
            resume_due=lambda: request_event(machine, RunEvent.RESUME),
            height_asked=self._height_asked.set, progress=view.on_progress,
            whereabouts=LastKnownPosition(self._runs_dir, self._profile), run=made.run,
            continues=self._continues, heights=heights,
        )
        if self._notice is not None:
            sequence.alarms.notify = self._notice
        trouble = TroubleLog(sequence.alarms, recorder)
        machine = RunStateMachine(sequence.carry_out_effect, sequence.halt, trouble)
        self._live = _Live(machine, sequence, course, recorder, view)
        operators = ControlSocket(control, ControlCallbacks(
            self.snapshot, lambda act, values: perform_act(self, act, values), self._came))
        operators.start()
        if self._override_percent != 100:
            course.set_override(self._override_percent)
        # To the last record: a third Ctrl-C must not keep the journal from its seal.
        with signals.call_on_signal(self._interrupted,
                                    loop), periodic_watcher_updates(self.snapshot, self._watcher):
            try:
                await machine.run()
            finally:
                warnings = (_BEAM_STAYED_OFF,) if course.is_entered and sequence.beam_off else ()
                machine_s = loop.time() - start_t
                sequence.stop_listening()
                try:
                    await operators.close()
                    recorder.seal(machine.state, lines=course.lines_executed,
                                  warnings=list(warnings),
                                  recoverable=is_recoverable(machine, course),
                                  **first_out_fields(sequence.alarms),
                                  position_trusted=sequence.position_trusted)
                finally:  # a disk that is full must not leave the feeders to their watchdogs
                    await sequence.close()
        if machine.state is not RunState.DONE:
            raise outcome_error(made, machine, course, sequence.alarms)
        return RunResult(
            made.run, machine.state.value, course.lines_executed, machine_s,
            time.perf_counter() - began, made.journal, warnings,
        )


def _hoppers_of(job: JobReader, profile: MachineProfile) -> list[HopperSettings]:
    """The profile's hoppers that the job uses, in the job's order; preflight has found them all."""
    by_name = {hopper.name: hopper for hopper in profile.hopper}
    return [by_name[use.name] for use in job.manifest.hoppers]
