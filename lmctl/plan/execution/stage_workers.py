"""The pure stages of one plan, run through an executor; wherever they run, results are equal."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from lmctl.errors import PlanError
from lmctl.plan.execution import worker
from lmctl.plan.geometry import LayerGeometry
from lmctl.plan.program_text import LayerLines
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.job.packed_layer import PackedLayer
    from lmctl.part.part import Part

#: Submissions in flight for each process that works.
_AHEAD = 2
#: Processes are started for plans that would otherwise take longer than this [s].
_WORTH_PROCESSES_S = 1.0
#: Layers made in the planner's own process first, to see how long one takes.
_TRIAL_LAYERS = 2


def usable_cores() -> int:
    """Cores this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class StageWorkers:
    """The pure stages of planning one part, through an executor. Use as a context manager.

    Errors of a stage come out of its future; PlanError where a worker process died.
    """

    def __init__(self, part: Part, executor: Executor, n_workers: int) -> None:
        self._key = worker.part_key(part)
        self._executor = executor
        self._n_workers = n_workers

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown(wait=True, cancel_futures=error is not None)
        if isinstance(error, BrokenExecutor):
            raise PlanError(
                "a planning process ended before its work was done",
                where="it was killed from outside, or memory ran out",
                hint="plan with fewer processes, such as --jobs 1") from error

    def window(self) -> int:
        """Submissions worth having in flight."""
        return 1 if self._n_workers == 1 else _AHEAD * self._n_workers

    def geometry(self, placement: Placement, layer: int) -> Future[LayerGeometry]:
        """Geometry of one layer."""
        return self._executor.submit(worker.geometry_stage, self._key, placement, layer)

    def text(self, layer: LayerLines) -> Future[PackedLayer]:
        """The bytes of one layer."""
        return self._executor.submit(worker.text_stage, layer)


class LocalWorkers(StageWorkers):
    """Stages in this process; in `jobs` others as soon as the layers to come are worth them.

    Where the system can fork, the processes share the part's memory with this one.
    """

    def __init__(self, part: Part, jobs: int) -> None:
        super().__init__(part, _InlineExecutor(), 1)
        worker.keep_part(self._key, part)
        self._part = part
        self._jobs = jobs
        self._trial_s: list[float] = []

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        worker.drop_part(self._key)
        super().__exit__(kind, error, trace)

    def geometry(self, placement: Placement, layer: int) -> Future[LayerGeometry]:
        """Geometry of one layer; the first ones are made here and timed."""
        if self._jobs == 1 or len(self._trial_s) == _TRIAL_LAYERS:
            return super().geometry(placement, layer)
        begin_s = time.perf_counter()
        future = super().geometry(placement, layer)
        self._trial_s.append(time.perf_counter() - begin_s)
        left = placement.n_layers - layer - 1
        if len(self._trial_s) == _TRIAL_LAYERS and min(self._trial_s) * left > _WORTH_PROCESSES_S:
            self._start_processes()
        return future

    def _start_processes(self) -> None:
        from lmctl.plan.execution.process_pool import ProcessPool  # late: small parts need none

        self._executor = ProcessPool(self._jobs, worker.keep_part, (self._key, self._part))
        self._n_workers = self._jobs


class _InlineExecutor(Executor):
    """Runs what is submitted at once, in this thread."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future
