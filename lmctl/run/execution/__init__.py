"""One job being run on one accepted cell: how far it is, its segments between holds, its layers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.execution.deposition import Progress as Progress
    from lmctl.run.execution.device_monitor import DeviceMonitor as DeviceMonitor
    from lmctl.run.execution.job_progress import JobProgress as JobProgress
    from lmctl.run.execution.layer_accounts import LayerAccounts as LayerAccounts
    from lmctl.run.execution.run_header import local_header as local_header
    from lmctl.run.execution.run_segment import RunSegmentFactory as RunSegmentFactory
    from lmctl.run.execution.unreported_motion import (
        find_unreported_motion as find_unreported_motion,
    )
    from lmctl.run.execution.unreported_motion import (
        journal_unreported_motion as journal_unreported_motion,
    )

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "DeviceMonitor": "lmctl.run.execution.device_monitor",
    "JobProgress": "lmctl.run.execution.job_progress",
    "LayerAccounts": "lmctl.run.execution.layer_accounts",
    "Progress": "lmctl.run.execution.deposition",
    "RunSegmentFactory": "lmctl.run.execution.run_segment",
    "find_unreported_motion": "lmctl.run.execution.unreported_motion",
    "journal_unreported_motion": "lmctl.run.execution.unreported_motion",
    "local_header": "lmctl.run.execution.run_header",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
