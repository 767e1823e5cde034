"""The pure stages of planning on a Dask cluster (package `distributed`, extra `scale`).

A plugin sends the part to every worker once, as bytes whose digest the worker checks. A worker that
joins later, or replaces one that died, receives it too. Dask reruns the work of a dead worker on
others. Workers run best with one thread each: geometry holds Python's lock.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.metadata
import pickle
import platform
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import lmctl
from lmctl.errors import PlanError
from lmctl.plan.execution.stage_workers import StageWorkers
from lmctl.plan.execution.worker import drop_part, receive_part

if TYPE_CHECKING:
    from distributed import Client

    from lmctl.part.part import Part

#: How long a scheduler may take to answer, and its workers to begin [s].
_TIMEOUT_S = 10.0
#: How often workers are asked to drop the part; a scheduler notices a dead worker within the first.
_DROP_ATTEMPTS = 3
_INSTALL = "pip install 'lmctl[scale]'"


def cluster_workers(address: str) -> Callable[[Part], StageWorkers]:
    """Return a function that opens workers on a scheduler's cluster, such as "tcp://host:8786".

    Raises PlanError where `distributed` is not installed; opening does where the scheduler does not
    answer, has no workers, or they run other versions.
    """
    try:
        importlib.import_module("distributed")
    except ImportError as missing:
        raise PlanError("planning on a cluster needs the package `distributed`",
                        where=str(missing), hint=_INSTALL) from None
    return lambda part: DaskWorkers(part, address)


def versions() -> dict[str, str]:
    """Versions that must be equal in planner and workers, for a job to be the same bytes."""
    packages = ("numpy", "scipy", "numba", "contourpy")
    return {"lmctl": lmctl.__version__, "python": platform.python_version()} | {
        package: importlib.metadata.version(package) for package in packages}


class DaskWorkers(StageWorkers):
    """Workers of a cluster, each with the part. Use as a context manager."""

    def __init__(self, part: Part, address: str) -> None:
        self._client = _connected(address)
        try:
            _check_versions(self._client, address)
            threads = sum(self._client.nthreads().values())
            super().__init__(part, self._client.get_executor(pure=False), threads)
            self._plugin = f"lmctl-part-{self._key}"
            self._client.register_plugin(_part_plugin(self._key, part), name=self._plugin)
        except BaseException:
            self._client.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        from distributed import KilledWorker

        self._executor.shutdown(wait=error is None)
        self._unregister_plugin()
        self._client.close()
        if isinstance(error, KilledWorker):
            raise PlanError("workers of the cluster died over one layer, again and again",
                            where=str(error), hint="see the workers' logs; memory may be short"
                            ) from error

    def _unregister_plugin(self) -> None:
        """Have workers drop the part. All layers are planned or given up by now, so that no failure
        here may void them: a worker that dies meanwhile breaks the request, and what still holds a
        part holds it until its process ends.
        """
        for _ in range(_DROP_ATTEMPTS):
            with contextlib.suppress(Exception):
                self._client.unregister_worker_plugin(self._plugin)
                return

    def window(self) -> int:
        """Submissions worth having in flight; workers may join or leave while planning."""
        self._n_workers = max(1, sum(self._client.nthreads().values()))
        return super().window() + 1


def _connected(address: str) -> Client:
    from distributed import Client

    try:
        client = Client(address, timeout=_TIMEOUT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise PlanError(f"no Dask scheduler answers at {address}", where=str(error),
                        hint="start one with `dask scheduler`, workers with `dask worker "
                             "tcp://HOST:8786 --nthreads 1`") from None
    return client


def _check_versions(client: Client, address: str) -> None:
    """Raises PlanError where there are no workers, or some run other versions."""
    if not client.nthreads():
        client.close()
        raise PlanError(f"the cluster at {address} has no workers",
                        hint=f"start some with `dask worker {address} --nthreads 1`")
    try:
        worker_versions: dict[str, Any] = client.run(versions)
    except Exception as error:
        raise PlanError("workers of the cluster cannot run lmctl", where=str(error),
                        hint="install the same lmctl on every worker") from None
    own = versions()
    different = [
        f"{name}: {', '.join(f'{key} {said.get(key)} (here {own[key]})' for key in differing)}"
        for name, said in worker_versions.items()
        if (differing := [key for key in own if said.get(key) != own[key]])
    ]
    if different:
        raise PlanError("workers of the cluster run other versions than this planner",
                        where=different, hint="install the same packages everywhere; a job would "
                        "depend on who planned which layer")


def _part_plugin(key: str, part: Part) -> Any:
    from distributed import WorkerPlugin

    class PartPlugin(WorkerPlugin):
        """Gives a worker the part, and takes it away again."""

        def __init__(self) -> None:
            self.data = pickle.dumps(part)
            self.digest = hashlib.sha256(self.data).hexdigest()

        def setup(self, worker: Any) -> None:
            receive_part(key, self.data, self.digest)

        def teardown(self, worker: Any) -> None:
            drop_part(key)

    return PartPlugin()
