"""Where the pure stages of planning run: in this process, in others, or on a Dask cluster."""

from lmctl.plan.execution.ordered import ordered_results
from lmctl.plan.execution.stage_workers import LocalWorkers, StageWorkers, usable_cores

__all__ = ["LocalWorkers", "StageWorkers", "ordered_results", "usable_cores"]
