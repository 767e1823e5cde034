"""Messages after Ctrl-C: what happens now, how long it takes, and what another one does."""

from __future__ import annotations

from lmctl.run.state.transitions import FINAL_STATES, RunState
from lmctl.run.status.phase import PhaseClock

_UNTOUCHED = (RunState.READY, RunState.CONNECTING, RunState.CHECKING)


def stop_message(before: RunState, phase: PhaseClock, *, is_taken: bool) -> str:
    """before : the state in which the stop came; is_taken : whether that state takes one"""
    postflow = f"{phase.postflow_s:.0f} s"
    if before in FINAL_STATES or not is_taken:
        return f"the run is {before}: another stop changes nothing"
    if before in _UNTOUCHED:
        return "stopping: nothing has been switched on or moved, so the run ends at once"
    if before is RunState.FINISHING:
        return ("the part is finished; the gas post-flow is skipped: powder left in a hose may "
                "clog the next start")
    if before in (RunState.STOPPING, RunState.TRIPPED):
        return ("the gas post-flow is skipped: gas goes off as soon as powder has stopped. Powder "
                "left in a hose may clog the next start. Another Ctrl-C changes nothing")
    return (f"stopping: beam and motion off now, then powder, then gas after {postflow} of "
            "post-flow. Ctrl-C again skips the post-flow")
