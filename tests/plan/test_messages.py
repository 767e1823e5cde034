"""What is told where a plan cannot be made: by workers, by rules that leave nothing, by limits."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from distributed import KilledWorker

from lmctl.errors import PlanError
from lmctl.plan.execution import dask_cluster
from lmctl.plan.execution.dask_cluster import DaskWorkers, cluster_workers
from lmctl.plan.execution.worker import geometry_stage, receive_part
from lmctl.plan.sequence.alloy_watch import AlloyWatch
from tests.error_facts import assert_states


def test_a_cluster_without_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(PlanError) as refused:
        cluster_workers("tcp://127.0.0.1:8786")
    assert_states(refused.value, "needs the package `distributed`", "pip install")


class Client:
    """A scheduler's client. threads : of its workers; said : what they answer"""

    def __init__(self, threads: dict[str, int], said: Any = None) -> None:
        self._threads, self._said, self.closed = threads, said, False

    def nthreads(self) -> dict[str, int]:
        return self._threads

    def run(self, _: Any) -> Any:
        if isinstance(self._said, Exception):
            raise self._said
        return self._said

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize(
    ("client", "facts"),
    [
        (Client({}), ("the cluster at tcp://here has no workers", "dask worker tcp://here")),
        (Client({"w": 1}, ModuleNotFoundError("no module named lmctl")),
         ("workers of the cluster cannot run lmctl", "no module named lmctl", "every worker")),
        (Client({"w": 1}, {"w": {"lmctl": "0.0.0"}}),
         ("run other versions than this planner", "lmctl 0.0.0", "same packages")),
    ],
)
def test_clusters_that_nothing_can_be_planned_on(
    client: Client, facts: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask_cluster, "_connected", lambda address: client)
    with pytest.raises(PlanError) as refused:
        DaskWorkers(SimpleNamespace(), "tcp://here")
    assert_states(refused.value, *facts)
    assert client.closed


def test_workers_that_die_over_a_layer_are_told() -> None:
    workers = object.__new__(DaskWorkers)
    workers._executor = SimpleNamespace(shutdown=lambda wait: None)
    workers._client, workers._plugin = Client({}), "lmctl-part"
    killed = KilledWorker("layer-3", SimpleNamespace(address="tcp://w:1"), 3)
    with pytest.raises(PlanError) as refused:
        workers.__exit__(KilledWorker, killed, None)
    assert_states(refused.value, "died over one layer", "layer-3", "memory may be short")


def test_a_worker_without_the_part_or_with_another() -> None:
    with pytest.raises(PlanError) as refused:
        receive_part("key", b"damaged", "0" * 64)
    assert_states(refused.value, "did not reach a planning worker as it was sent", "7 bytes",
                  "plan again")
    with pytest.raises(PlanError) as refused:
        geometry_stage("never sent", SimpleNamespace(), 0)
    assert_states(refused.value, "has no copy of the part", "start the workers again")


def test_rules_that_leave_no_mixture_that_hoppers_can_meter() -> None:
    watch = object.__new__(AlloyWatch)
    rules = SimpleNamespace(
        regions=SimpleNamespace(rule_at=lambda levels, near: np.zeros(len(levels), dtype=int)),
        rules=[SimpleNamespace(as_text=lambda: "brittle: 316L 0.4 to 0.6")])
    watch._mixtures = SimpleNamespace(rules=rules, near_region=None)
    watch._deliverable = np.empty((0, 2))
    with pytest.raises(PlanError) as refused:
        watch.allowed_levels(np.array([[0.5, 0.5]]), "layer 3")
    assert_states(refused.value, "no mixture that the hoppers can meter", "layer 3", "brittle",
                  "raise speed_mm_s")
