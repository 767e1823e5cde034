"""The states of a run, and the loop that goes through them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.state.state_machine import RunStateMachine as RunStateMachine
    from lmctl.run.state.transitions import Effect as Effect
    from lmctl.run.state.transitions import RunEvent as RunEvent
    from lmctl.run.state.transitions import RunState as RunState

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "Effect": "lmctl.run.state.transitions",
    "RunEvent": "lmctl.run.state.transitions",
    "RunState": "lmctl.run.state.transitions",
    "RunStateMachine": "lmctl.run.state.state_machine",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
