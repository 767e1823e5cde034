"""How a run stands and how it ended, in words and values for people and other programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.status.outcomes import first_out as first_out
    from lmctl.run.status.outcomes import is_recoverable as is_recoverable
    from lmctl.run.status.outcomes import outcome_error as outcome_error
    from lmctl.run.status.phase import PhaseClock as PhaseClock
    from lmctl.run.status.snapshot import RunView as RunView
    from lmctl.run.status.stop_messages import stop_words as stop_words
    from lmctl.run.status.watcher import Watcher as Watcher
    from lmctl.run.status.watcher import watched as watched

#: What others may use, and the module that holds it; loaded when it is asked for.
_HOMES = {
    "PhaseClock": "lmctl.run.status.phase",
    "RunView": "lmctl.run.status.snapshot",
    "Watcher": "lmctl.run.status.watcher",
    "first_out": "lmctl.run.status.outcomes",
    "is_recoverable": "lmctl.run.status.outcomes",
    "outcome_error": "lmctl.run.status.outcomes",
    "stop_words": "lmctl.run.status.stop_messages",
    "watched": "lmctl.run.status.watcher",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
