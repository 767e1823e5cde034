"""From a part to a job: layers, paths, times, powder. Synchronous array code, no devices."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.plan.execution.dask_cluster import cluster_workers as cluster_workers
    from lmctl.plan.layer_range import place_layers as place_layers
    from lmctl.plan.planner import PlanOptions as PlanOptions
    from lmctl.plan.planner import plan_job as plan_job

#: Public names, and the module that holds each; loaded on first use.
_HOMES = {
    "PlanOptions": "lmctl.plan.planner",
    "cluster_workers": "lmctl.plan.execution.dask_cluster",
    "place_layers": "lmctl.plan.layer_range",
    "plan_job": "lmctl.plan.planner",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
