"""A job, or what was run of it, as one HTML file to look through: layers, values, curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.report.job_viewer.writing import write_job_viewer as write_job_viewer
    from lmctl.report.job_viewer.writing import write_run_viewer as write_run_viewer

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "write_job_viewer": "lmctl.report.job_viewer.writing",
    "write_run_viewer": "lmctl.report.job_viewer.writing",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
