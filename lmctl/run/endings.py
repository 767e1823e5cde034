"""What is said of a run that did not get done, and whether it can go on later."""

from __future__ import annotations

from typing import Any

from lmctl.errors import JobError, LmctlError, RunBrokenOff, RunFailed, RunStopped
from lmctl.run.course import Course
from lmctl.run.interlocks.alarms import Alarm, Alarms
from lmctl.run.journal.rundir import RunDir
from lmctl.run.state.machine import StateMachine
from lmctl.run.state.table import Do, State

#: What is not known when the last try to take something off the machine failed.
_NOT_SEEN = {
    Do.STOP_MOTION: "beam and motion were not seen to stop: look at the machine",
    Do.POWDER_OFF: "powder was not seen to stop",
    Do.GAS_OFF: "gas was not seen to go off",
    Do.GAS_OFF_NOW: "gas was not seen to go off",
}


def recoverable(machine: StateMachine, course: Course) -> bool:
    """Whether `lmctl recover` can go on with the part.

    Not where all of it is laid, nor where the job itself went wrong: it would go wrong again.
    """
    wrong_job = isinstance(machine.fault, JobError)
    return course.began and not machine.finished and not wrong_job


def first_out(machine: StateMachine, alarms: Alarms) -> dict[str, Any]:
    """Fields of a journal's seal: the cause of a run that was not done, and what followed."""
    if machine.state is State.DONE or not len(alarms):
        return {}
    cause, *others = alarms
    return {
        "cause": {"name": cause.name, "what": cause.what, "hint": cause.hint},
        "followed": [one.what for one in others],
    }


def ending(made: RunDir, machine: StateMachine, course: Course, alarms: Alarms) -> Exception:
    """What to raise for a run that did not get done."""
    journal = f"journal: {made.journal}"
    halted = _halted(machine, course)
    going_on = recoverable(machine, course)
    hint = (
        f"`{made.command('recover')}` goes on from there" if going_on
        else f"`{made.command('log')}` shows how far it came"
    )
    error, (first, *others) = machine.fault, tuple(alarms) or (None,)
    if first is None and machine.state is State.STOPPED:
        return RunStopped(f"{made.run} was stopped by the operator", where=(*halted, journal),
                          hint=hint)
    if isinstance(error, LmctlError) and not machine.touched:
        error.where = (*error.where, journal)
        return error
    # The cause is the headline; what ended the run may only have followed from it.
    reason = error if first is None else first
    if not isinstance(reason, Alarm | LmctlError):
        return reason or RuntimeError("the run ended without a reason")
    then = [f"then: {one.what}" for one in others if one is not None]
    if first is not None and error is not None and str(error) not in {one.what for one in alarms}:
        then.append(f"then: {error}")
    kind = RunStopped if machine.state is State.STOPPED else (
        RunBrokenOff if going_on else RunFailed)
    ended = kind(reason.what, where=(*reason.where, *then, *halted, journal),
                 hint="; then ".join(filter(None, (reason.hint, hint))))
    ended.__cause__ = error
    return ended


def _halted(machine: StateMachine, course: Course) -> list[str]:
    """How the machine was left, as far as that is known."""
    if not machine.touched:
        return ["nothing had been switched on or moved"]
    unknown = [words for do, words in _NOT_SEEN.items() if do in machine.undone]
    if Do.STOP_MOTION in machine.undone:
        return list(dict.fromkeys(unknown))
    return [f"beam off, motion held at {course.where}", *dict.fromkeys(unknown)]
