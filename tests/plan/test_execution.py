"""Where layers are made: in this process or others, the job is the same; nothing is left behind."""

import multiprocessing
import os
import signal

import pytest

from lmctl.errors import PlanError
from lmctl.plan.execution import ordered_results, stage_workers
from lmctl.plan.execution.stage_workers import _InlineExecutor
from lmctl.plan.planner import PlanOptions, plan_job


@pytest.fixture
def processes_at_once(monkeypatch):
    """Small plans are worth processes too."""
    monkeypatch.setattr(stage_workers, "_WORTH_PROCESSES_S", -1.0)


@pytest.fixture
def graded(make_part, shapes):
    return make_part(shapes["islands"], lambda p: 0.5 + 0.01 * p[:, 0] + 0.01 * p[:, 2],
                     height_mm=6.4)


def test_jobs_are_the_same_whatever_the_number_of_processes(
        tmp_path, graded, profile, processes_at_once):
    for jobs in (1, 2):
        plan_job(graded, profile, tmp_path / f"{jobs}.lmj", options=PlanOptions(jobs=jobs))
    assert (tmp_path / "1.lmj").read_bytes() == (tmp_path / "2.lmj").read_bytes()


def test_an_interrupted_plan_ends_its_processes_and_leaves_no_file(
        tmp_path, graded, profile, processes_at_once):
    def stop(done, total):
        if done == 3:
            assert multiprocessing.active_children()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan_job(graded, profile, tmp_path / "a.lmj", stop, PlanOptions(jobs=2))
    assert not multiprocessing.active_children()
    assert os.listdir(tmp_path) == []


def test_a_process_that_dies_is_said_in_words(tmp_path, graded, profile, processes_at_once):
    def kill_one(done, total):
        for child in multiprocessing.active_children()[:1]:
            os.kill(child.pid, signal.SIGKILL)

    with pytest.raises(PlanError, match="ended before its work was done") as caught:
        plan_job(graded, profile, tmp_path / "a.lmj", kill_one, PlanOptions(jobs=2))
    assert "--jobs 1" in caught.value.hint
    assert os.listdir(tmp_path) == []


def test_an_error_in_another_process_is_the_one_of_this(
        tmp_path, make_part, shapes, profile, processes_at_once):
    """A field that a worker cannot evaluate: its own exception comes out, and no file is left."""
    def mixture(points):
        if points[0, 2] > 4:
            raise PlanError("no composition there", where="z > 4 mm")
        return 0.5

    part = make_part(shapes["disc"], mixture, height_mm=6.4)
    with pytest.raises(PlanError, match="no composition there"):
        plan_job(part, profile, tmp_path / "a.lmj", options=PlanOptions(jobs=2))
    assert os.listdir(tmp_path) == []


def test_results_come_in_order_and_no_more_is_begun_than_the_window_allows():
    begun = []

    def submit(item):
        begun.append(item)
        return _InlineExecutor().submit(lambda: 10 * item)

    results = ordered_results(submit, range(100), lambda: 4)
    assert [next(results) for _ in range(3)] == [0, 10, 20]
    assert begun == list(range(6))
    results.close()
    assert list(ordered_results(submit, range(5), lambda: 3)) == [0, 10, 20, 30, 40]
