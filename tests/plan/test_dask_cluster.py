"""Planning on a Dask cluster of local workers: the same job, whatever becomes of them."""

import logging
import os
import signal
import socket
from pathlib import Path

import pytest

import lmctl.examples
from lmctl.config.machine import load_profile
from lmctl.errors import PlanError
from lmctl.part.load import load_part
from lmctl.plan.execution import dask_cluster
from lmctl.plan.execution.dask_cluster import cluster_workers
from lmctl.plan.planner import PlanOptions, plan_job
from tests.part_files import block_file

distributed = pytest.importorskip("distributed", reason="the extra `scale` is not installed")
# Its own processes and sockets are closed by it in its own time.
pytestmark = pytest.mark.filterwarnings("ignore:::distributed", "ignore::ResourceWarning")

PART = block_file((12, 10, 9.6), name="graded block", composition="""
feature = { kind = "axis", point_mm = [6, 5, 0], direction = [0, 0, 1] }
[composition.profile]
kind = "table"
points = [
  { at_mm = 0, of = { "316L" = 0.9, "WC-12Co" = 0.1 } },
  { at_mm = 9, of = { "316L" = 0.3, "WC-12Co" = 0.7 } },
]
""")


@pytest.fixture(scope="module")
def cluster():
    """Three worker processes of one thread each, which are not started again when they die.

    Two tests kill one each, so that each of them still runs on two workers.
    """
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None,
        host="127.0.0.1", silence_logs=logging.CRITICAL,
    ) as cluster:
        yield cluster


@pytest.fixture
def part(tmp_path):
    (tmp_path / "block.toml").write_text(PART)
    return load_part(tmp_path / "block.toml")


@pytest.fixture
def cell():
    return load_profile(Path(lmctl.examples.__file__).parent / "cell.toml")


def on_cluster(cluster):
    return PlanOptions(cluster=cluster_workers(cluster.scheduler_address))


def test_the_job_is_the_one_of_a_single_process_also_when_a_worker_dies_half_way(
        tmp_path, cluster, part, cell):
    plan_job(part, cell, tmp_path / "here.lmj")
    plan_job(part, cell, tmp_path / "there.lmj", options=on_cluster(cluster))
    assert (tmp_path / "there.lmj").read_bytes() == (tmp_path / "here.lmj").read_bytes()

    with distributed.Client(cluster, set_as_default=False) as client:
        victim = next(iter(client.run(os.getpid).values()))

    def kill_one_half_way(done, total):
        if done == total // 2:
            os.kill(victim, signal.SIGKILL)

    plan_job(part, cell, tmp_path / "killed.lmj", kill_one_half_way, on_cluster(cluster))
    assert (tmp_path / "killed.lmj").read_bytes() == (tmp_path / "here.lmj").read_bytes()


def test_a_worker_that_dies_after_the_last_layer_takes_no_job_with_it(
        tmp_path, cluster, part, cell):
    with distributed.Client(cluster, set_as_default=False) as client:
        victim = next(iter(client.run(os.getpid).values()))

    def kill_one_at_the_end(done, total):
        if done == total:
            os.kill(victim, signal.SIGKILL)

    plan_job(part, cell, tmp_path / "a.lmj", kill_one_at_the_end, on_cluster(cluster))
    plan_job(part, cell, tmp_path / "here.lmj")
    assert (tmp_path / "a.lmj").read_bytes() == (tmp_path / "here.lmj").read_bytes()


def test_workers_of_another_version_are_refused(tmp_path, cluster, part, cell, monkeypatch):
    monkeypatch.setattr(dask_cluster.lmctl, "__version__", "0.0.0+other")
    with pytest.raises(PlanError, match="other versions") as caught:
        plan_job(part, cell, tmp_path / "a.lmj", options=on_cluster(cluster))
    assert "here 0.0.0+other" in caught.value.where[0]
    assert not (tmp_path / "a.lmj").exists()


def test_an_interrupted_plan_leaves_neither_file_nor_work(tmp_path, cluster, part, cell):
    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_job(part, cell, tmp_path / "a.lmj", stop, on_cluster(cluster))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["block.toml"]
    with distributed.Client(cluster, set_as_default=False) as client:
        assert not client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.tasks))


def test_a_cluster_that_is_not_there(tmp_path, part, cell, monkeypatch):
    monkeypatch.setattr(dask_cluster, "_TIMEOUT_S", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(PlanError, match="no Dask scheduler answers") as caught:
        plan_job(part, cell, tmp_path / "a.lmj", options=PlanOptions(
            cluster=cluster_workers(address)))
    assert "dask scheduler" in caught.value.hint
    assert not (tmp_path / "a.lmj").exists()
