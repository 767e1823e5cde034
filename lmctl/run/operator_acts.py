"""Operator commands that need more than one event, and the reasons for refusing them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from lmctl.errors import UsageError
from lmctl.run.execution.job_progress import JobProgress
from lmctl.run.powder.refill import RefillProcedure
from lmctl.run.state.state_machine import RunStateMachine
from lmctl.run.state.transitions import RunEvent, RunState

_HINT = "a run can be held while it deposits and resumed once held"
_HINTS = {
    RunState.OPENING: "powder and gas are going off; then the hopper may be opened",
    RunState.REFILLING: "a hopper is open: fill and close it, then `lmctl refill HOPPER --lot LOT "
                     "--mass GRAMS`",
    RunState.WEIGHING: "the refilled hopper is weighed; wait a few seconds",
}


def request_event(machine: RunStateMachine | None, event: RunEvent) -> None:
    """Request an event of a run. Raises UsageError where its state does not accept it."""
    state = RunState.READY if machine is None else machine.state
    if machine is None or not machine.request_event(event):
        raise UsageError(f"cannot {event} now: the run is {state}", hint=_HINTS.get(state, _HINT))


def begin_refill(
    machine: RunStateMachine, course: JobProgress, refilling: RefillProcedure, hopper: str
) -> None:
    """Have a hopper made ready to be opened: at the end of the path under way, or at once.

    Raises UsageError where the run has no such hopper or cannot be held for it.
    """
    def hold() -> None:
        machine.request_event(RunEvent.HOLD)

    state = machine.state
    if state not in (RunState.DEPOSITING, RunState.HOLDING, RunState.HELD):
        raise UsageError(
            f"cannot refill now: the run is {state}",
            hint=_HINTS.get(state, "a hopper is refilled while the run deposits or is held"),
        )
    refilling.request_refill(hopper)
    if state is RunState.DEPOSITING:
        course.finish_path(hold)
    elif state is RunState.HELD:
        refilling.take_due_request()
        request_event(machine, RunEvent.REFILL)


def end_refill(
    machine: RunStateMachine, refilling: RefillProcedure, hopper: str, lot: str, mass_g: float
) -> None:
    """A hopper is filled and closed. Raises UsageError where it was not open."""
    if machine.state is not RunState.REFILLING:
        raise UsageError(
            f"hopper {hopper} is not open for refilling: the run is {machine.state}",
            hint=_HINTS.get(machine.state, f"`lmctl refill {hopper}` makes it ready to be opened"),
        )
    refilling.confirm_filled(hopper, lot, mass_g)
    request_event(machine, RunEvent.REFILLED)


class OperatedRun(Protocol):
    """What an operator may do to a run; each act raises UsageError where it cannot be."""

    def hold(self) -> None: ...
    def resume(self) -> None: ...
    def stop(self) -> None: ...
    def set_override(self, percent: int) -> None: ...
    def refill(self, hopper: str, lot: str = "", mass_g: float = 0.0) -> None: ...
    def enter_height(self, height_mm: float | None) -> None: ...


def perform_act(run: OperatedRun, act: str, values: Mapping[str, Any]) -> None:
    """An act of the control socket, with the values of its request. Raises UsageError."""
    if act == "override":
        run.set_override(values["percent"])
    elif act == "refill":
        run.refill(values["hopper"], values.get("lot", ""), values.get("mass_g", 0.0))
    elif act == "height":
        run.enter_height(values["height_mm"])
    else:
        {"hold": run.hold, "resume": run.resume, "stop": run.stop}[act]()
