"""State of a run and how it ended, in words and values for people and other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.status.outcomes import first_out_fields as first_out_fields
    from lmctl.run.status.outcomes import is_recoverable as is_recoverable
    from lmctl.run.status.outcomes import outcome_error as outcome_error
    from lmctl.run.status.phase import PhaseClock as PhaseClock
    from lmctl.run.status.snapshot import RunView as RunView
    from lmctl.run.status.stop_messages import stop_message as stop_message
    from lmctl.run.status.watcher import Watcher as Watcher
    from lmctl.run.status.watcher import periodic_watcher_updates as periodic_watcher_updates

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "PhaseClock": "lmctl.run.status.phase",
    "RunView": "lmctl.run.status.snapshot",
    "Watcher": "lmctl.run.status.watcher",
    "first_out_fields": "lmctl.run.status.outcomes",
    "is_recoverable": "lmctl.run.status.outcomes",
    "outcome_error": "lmctl.run.status.outcomes",
    "periodic_watcher_updates": "lmctl.run.status.watcher",
    "stop_message": "lmctl.run.status.stop_messages",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
