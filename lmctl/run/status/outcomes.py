"""How an unfinished run is reported, and whether it can be resumed later."""

from __future__ import annotations

from typing import Any

from lmctl.errors import JobError, LmctlError, RunFailedError, RunInterruptedError, RunStoppedError
from lmctl.run.execution.job_progress import JobProgress
from lmctl.run.interlocks.alarms import RunAlarm, RunAlarms
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.state.state_machine import RunStateMachine
from lmctl.run.state.transitions import Effect, RunState

#: What is not known when the last try to take something off the machine failed.
_NOT_SEEN = {
    Effect.STOP_MOTION: "beam and motion were not seen to stop: look at the machine",
    Effect.POWDER_OFF: "powder was not seen to stop",
    Effect.GAS_OFF: "gas was not seen to go off",
    Effect.GAS_OFF_NOW: "gas was not seen to go off",
}


def is_recoverable(machine: RunStateMachine, course: JobProgress) -> bool:
    """Whether `lmctl recover` can go on with the part.

    Not where all of it is deposited, nor where the job itself failed: it would fail again.
    """
    wrong_job = isinstance(machine.fault, JobError)
    return course.has_begun and not machine.finished and not wrong_job


def first_out_fields(alarms: RunAlarms) -> dict[str, Any]:
    """Fields of a journal's seal: the cause of the alarms active at the end, and the others."""
    if not len(alarms):
        return {}
    cause, *others = alarms
    return {
        "cause": {"name": cause.name, "what": cause.what, "hint": cause.hint},
        "followed": [one.what for one in others],
    }


def outcome_error(made: RunFolder, machine: RunStateMachine, course: JobProgress,
                  alarms: RunAlarms) -> Exception:
    """What to raise for a run that did not get done."""
    journal = f"journal: {made.journal}"
    halted = _halted(machine, course)
    recoverable = is_recoverable(machine, course)
    hint = (
        f"`{made.command('recover')}` goes on from there" if recoverable
        else f"`{made.command('log')}` shows how far it came"
    )
    error, (first, *others) = machine.fault, tuple(alarms) or (None,)
    if first is None and machine.state is RunState.STOPPED:
        return RunStoppedError(f"{made.run} was stopped by the operator", where=(*halted, journal),
                               hint=hint)
    if isinstance(error, LmctlError) and not machine.touched:
        error.where = (*error.where, journal)
        return error
    # The cause is the headline; what ended the run may only have followed from it.
    reason = error if first is None else first
    if not isinstance(reason, RunAlarm | LmctlError):
        return reason or RuntimeError("the run ended without a reason")
    then = [f"then: {one.what}" for one in others if one is not None]
    if first is not None and error is not None and str(error) not in {one.what for one in alarms}:
        then.append(f"then: {error}")
    kind = RunStoppedError if machine.state is RunState.STOPPED else (
        RunInterruptedError if recoverable else RunFailedError)
    ended = kind(reason.what, where=(*reason.where, *then, *halted, journal),
                 hint="; then ".join(filter(None, (reason.hint, hint))))
    ended.__cause__ = error
    return ended


def _halted(machine: RunStateMachine, course: JobProgress) -> list[str]:
    """How the machine was left, as far as that is known."""
    if not machine.touched:
        return ["nothing had been switched on or moved"]
    unknown = [words for do, words in _NOT_SEEN.items() if do in machine.undone]
    if Effect.STOP_MOTION in machine.undone:
        return list(dict.fromkeys(unknown))
    return [f"beam off, motion held at {course.place_text}", *dict.fromkeys(unknown)]
