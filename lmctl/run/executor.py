"""Running a job: from a job file and a profile to a finished part and a sealed journal."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from lmctl.config.machine import Hopper, MachineProfile
from lmctl.errors import JobError, LmctlError, UsageError
from lmctl.job.reader import JobReader
from lmctl.preflight.job_check import check_job
from lmctl.preflight.program_check import check_program
from lmctl.run import signals
from lmctl.run.cell.ownership import owning
from lmctl.run.control.server import Controls, ControlSocket, Peer, listening
from lmctl.run.course import Continuation, Course
from lmctl.run.deposition import Progress
from lmctl.run.endings import ending, first_out, recoverable
from lmctl.run.header import header, local
from lmctl.run.journal import rundir
from lmctl.run.journal.recorder import Recorder
from lmctl.run.journal.whereabouts import Whereabouts
from lmctl.run.journal.writer import Journal
from lmctl.run.program.overrides import OverrideRange, override_range
from lmctl.run.program.reentry import START
from lmctl.run.sequence import CellSequence
from lmctl.run.snapshot import View
from lmctl.run.state.machine import StateMachine
from lmctl.run.state.table import FINAL, Event, State
from lmctl.run.trouble import TroubleLog
from lmctl.run.unreported import unreported

__all__ = ["Continuation", "Executor", "Notice", "Progress", "RunResult", "run_job"]

#: A line about an alarm or a warning, for people.
Notice = Callable[[str], None]

_BEAM_STAYED_OFF = (
    "the profile names no safety-input device ([safety]): every power was sent as S0, so the beam "
    "stayed off"
)

#: States in which a hold is somebody else's: pressed at the machine's own panel.
_MUST_NOT_BE_HELD = (
    State.GAS, State.POWDER, State.ARMED, State.DEPOSITING, State.PURGING, State.RESUMING,
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

    machine: StateMachine
    sequence: CellSequence
    course: Course
    recorder: Recorder
    view: View


async def run_job(
    job_path: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
    progress: Progress | None = None, notice: Notice | None = None,
) -> RunResult:
    """Run a job on the machine a profile names; see `Executor`."""
    return await Executor(
        job_path, profile, runs_dir, operator=operator, progress=progress, notice=notice
    ).run()


class Executor:
    """One run of one job. `hold`, `resume`, `stop` and `set_override` act while `run` runs.

    progress : told (program time done, in all, layer, machine time left) about once a second
    notice : told of each alarm and warning as it comes, in a line
    continues : the run that has made the part so far, or None
    """

    def __init__(
        self, job_path: Path, profile: MachineProfile, runs_dir: Path, *, operator: str = "",
        progress: Progress | None = None, notice: Notice | None = None,
        continues: Continuation | None = None,
    ) -> None:
        self._job_path = job_path
        self._profile = profile
        self._runs_dir = runs_dir
        self._operator = operator
        self._progress = progress
        self._notice = notice
        self._continues = continues
        self._override_percent = 100
        self._override_range = OverrideRange()
        self._live: _Live | None = None

    @property
    def state(self) -> State:
        """Where the run is."""
        return State.READY if self._live is None else self._live.machine.state

    # --- the operator -------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop on the path, beam off, position kept. Raises UsageError where that cannot be."""
        self._request(Event.HOLD)

    def resume(self) -> None:
        """End a hold; the beam returns once the hose is purged.

        Raises UsageError where nothing is held, or what it was held for still is so.
        """
        standing = [] if self._live is None else self._live.sequence.standing()
        if standing and self.state is State.HELD:
            raise UsageError(
                f"cannot resume: {standing[0].what}",
                where=[error.what for error in standing[1:]], hint=standing[0].hint,
            )
        self._request(Event.RESUME)

    def stop(self) -> None:
        """End the run: beam and motion, then powder, then gas. A second stop skips post-flow.

        Raises UsageError where the run has not begun or has ended.
        """
        self._request(Event.STOP)

    def set_override(self, percent: int) -> None:
        """Scale speed, beam and powder together; before the run, for all of it.

        In the run it comes with the next travel that powder can be made to follow.
        percent : 50 to 200, and what beam and powder of this job can follow
        Raises UsageError for another value, and where nothing is laid any more.
        """
        self._override_range.check(percent)
        if self.state in {*FINAL, State.FINISHING, State.STOPPING, State.TRIPPED}:
            raise UsageError(f"cannot override now: the run is {self.state}")
        self._override_percent = percent
        if self._live is not None:
            self._live.course.set_override(percent)

    def snapshot(self) -> dict[str, Any]:
        """How the run stands: see `lmctl.run.snapshot`. Not before `run` has begun."""
        live = self._live
        assert live is not None
        return live.view.snapshot(
            self.state.value, live.course, live.recorder.latest, live.sequence.alarms,
            beam_off=live.sequence.beam_off,
        )

    def _act(self, act: str, percent: int | None) -> None:
        """An act of the control socket. Raises UsageError."""
        if act == "override":
            self.set_override(percent or 0)
        else:
            {"hold": self.hold, "resume": self.resume, "stop": self.stop}[act]()

    def _came(self, act: str, peer: Peer, refused: str) -> None:
        """Journal an act of the control socket; a journal that cannot be written ends the run."""
        live = self._live
        assert live is not None
        try:
            live.recorder.operator(act, refused, uid=peer.uid, pid=peer.pid)
        except LmctlError as error:
            live.machine.trip(error)

    def _request(self, event: Event) -> None:
        if self._live is None or not self._live.machine.wish(event):
            raise UsageError(f"cannot {event} now: the run is {self.state}",
                             hint="a run can be held while it deposits and resumed once held")

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
        made = rundir.create(self._runs_dir, self._job_path)
        try:
            with (
                owning(self._profile, made.run, self._runs_dir),
                listening(made.path) as control, JobReader(made.job) as job,
            ):
                if job.digest != digest:
                    raise JobError(f"{self._job_path} changed while it was read")
                hoppers = _hoppers_of(job, self._profile)
                first = header(job, self._profile, hoppers, self._operator, self._continues)
                here = local(made.run, self._profile)
                with Journal(made.journal, first, local=here) as journal:
                    return await self._drive(job, hoppers, made, journal, control, began)
        finally:
            if not made.journal.exists():
                rundir.discard(made)

    async def _drive(
        self, job: JobReader, hoppers: list[Hopper], made: rundir.RunDir, journal: Journal,
        control: socket.socket, began: float,
    ) -> RunResult:
        loop = asyncio.get_running_loop()
        start_t = loop.time()
        recorder = Recorder(journal, lambda: loop.time() - start_t, [h.name for h in hoppers])

        if self._continues is not None:
            earlier = rundir.RunDir(self._runs_dir / self._continues.run).journal
            for span in unreported(job, self._profile, earlier, self._continues.place):
                recorder.unreported(**span.as_json())

        view = View(made.run, job.manifest, self._profile, hoppers, self._operator, self._progress)

        course = Course(recorder, START if self._continues is None else self._continues.place)
        sequence = CellSequence(
            job, self._profile, hoppers, recorder, course,
            program_done=lambda: machine.post(Event.PROGRAM_DONE),
            held=lambda: machine.state not in _MUST_NOT_BE_HELD,
            tripped=lambda error: machine.trip(error), progress=view.hear,
            whereabouts=Whereabouts(self._runs_dir, self._profile.name), run=made.run,
            continues=self._continues,
        )
        if self._notice is not None:
            sequence.alarms.told = self._notice
        trouble = TroubleLog(sequence.alarms, recorder)
        machine = StateMachine(sequence.carry_out, sequence.halt, trouble)
        self._live = _Live(machine, sequence, course, recorder, view)
        operators = ControlSocket(control, Controls(self.snapshot, self._act, self._came))
        operators.start()
        if self._override_percent != 100:
            course.set_override(self._override_percent)
        # To the last record: a third Ctrl-C must not keep the journal from its seal.
        with signals.calling(lambda: machine.wish(Event.STOP), loop):
            try:
                await machine.run()
            finally:
                warnings = (_BEAM_STAYED_OFF,) if course.entered and sequence.beam_off else ()
                machine_s = loop.time() - start_t
                sequence.end()
                try:
                    await operators.close()
                    recorder.seal(machine.state, lines=course.executed, warnings=list(warnings),
                                  recoverable=recoverable(machine, course),
                                  **first_out(machine, sequence.alarms),
                                  position_trusted=sequence.position_trusted)
                finally:  # a disk that is full must not leave the feeders to their watchdogs
                    await sequence.close()
        if machine.state is not State.DONE:
            raise ending(made, machine, course, sequence.alarms)
        return RunResult(
            made.run, machine.state.value, course.executed, machine_s,
            time.perf_counter() - began, made.journal, warnings,
        )


def _hoppers_of(job: JobReader, profile: MachineProfile) -> list[Hopper]:
    """The profile's hoppers that the job uses, in the job's order; preflight has found them all."""
    by_name = {hopper.name: hopper for hopper in profile.hopper}
    return [by_name[use.name] for use in job.manifest.hoppers]
