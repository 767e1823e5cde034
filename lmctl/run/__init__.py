"""Running a job: streams lines, leads the powder, monitors, journals. Knows no geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.executor import Notice as Notice
    from lmctl.run.executor import RunExecutor as RunExecutor
    from lmctl.run.executor import RunResult as RunResult
    from lmctl.run.executor import run_job as run_job
    from lmctl.run.signals import catchable_signals as catchable_signals

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "Notice": "lmctl.run.executor",
    "RunExecutor": "lmctl.run.executor",
    "RunResult": "lmctl.run.executor",
    "catchable_signals": "lmctl.run.signals",
    "run_job": "lmctl.run.executor",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
