"""Every layer of which anything was executed has a row, whenever a run is held or stopped."""

from __future__ import annotations

import asyncio

import pytest

from lmctl.errors import LmctlError
from lmctl.job.reader import JobReader
from lmctl.job.schema import LineKind
from lmctl.report.part_record import part_record_of
from lmctl.run.executor import EarlierRun, RunExecutor
from lmctl.run.journal.recovery import find_recovery_place
from lmctl.run.journal.replay import replay_run
from lmctl.run.journal.run_folders import RunFolder
from lmctl.run.state.transitions import RunState
from simulators import virtual_time
from simulators.bench import Bench
from simulators.bench_config import BenchConfig
from tests.run.whole.broken_off import seen
from tests.run.whole.conftest import EXAMPLES, wired


async def until(condition):
    while not condition():  # noqa: ASYNC110 (it has no event)
        await asyncio.sleep(0.005)


def after_last_bead(job, layer):
    """The first line after the last bead of a layer."""
    with JobReader(job) as reader:
        lines = reader.read_layer(layer).lines
        first_line = reader.manifest.layers[layer].first_line
    return first_line + int((lines["kind"] == LineKind.BEAD).nonzero()[0][-1]) + 1


def test_a_layer_held_after_its_last_bead_is_in_the_log(whole, profile, tmp_path):
    """Held in the travel between two layers, stopped, recovered: no run ever ends that layer."""
    line = after_last_bead(whole.job, 0)
    ended_s = float(whole.path.time_s[whole.path.line == line - 1].max()) - whole.started_s
    runs = tmp_path / "runs"

    async def main():
        config = BenchConfig.parse((EXAMPLES / "bench.toml").read_text())
        async with Bench(config, ephemeral_ports=True) as bench:
            cell = wired(profile, bench.endpoints)
            first = RunExecutor(whole.job, cell, runs)
            task = asyncio.create_task(first.run())
            await until(lambda: first.state is RunState.DEPOSITING)
            await asyncio.sleep(ended_s + 0.03)
            first.hold()
            await until(lambda: first.state is RunState.HELD)
            first.stop()
            with pytest.raises(LmctlError, match="stopped by the operator"):
                await task
            made = RunFolder(runs / "run-0001")
            with JobReader(made.job) as job:
                found = find_recovery_place(
                    job, replay_run(made), seen(bench.motion.position_mm), profile)
            await RunExecutor(made.job, cell, runs, continues=EarlierRun(
                "run-0001", found.reached, is_position_trusted=not found.lost)).run()

    virtual_time.run_in_virtual_time(main())
    alone = part_record_of(runs / "run-0001/journal.jsonl", run_only=True)
    assert [row.number for row in alone.layers] == [1]
    part = part_record_of(runs / "run-0001/journal.jsonl")
    assert [run.run for run in part.runs] == ["run-0001", "run-0002"]
    assert [(row.number, row.complete) for row in part.layers] == [
        (1, True), (2, True), (3, True)]
    for row in part.layers:
        assert row.executed.path_mm == pytest.approx(row.planned.path_mm, abs=0.3)
        assert not {"path_mm", "beam_s", "energy_J"} & set(row.deviations)


def test_a_stopped_layer_is_partial_and_its_figures_are_those_of_what_was_executed(
    run, large_square_job
):
    one = run(large_square_job, acts=[(4.0, lambda r: r.executor.stop())])
    (row,) = part_record_of(one.journal).layers
    assert not row.complete
    assert row.remark.startswith("partial: line ")
    assert row.executed.path_mm == pytest.approx(one.path.length_mm.sum(), abs=0.1)
    assert row.executed.path_mm < row.planned.path_mm / 2
    assert {"path_mm", "beam_s", "energy_J"} <= set(row.deviations)


def test_alarms_say_when_they_were_over(run, large_square_job):
    one = run(large_square_job, acts=[
        (3.0, lambda r: r.bench.motion.receive(b"!")), (12.0, lambda r: r.executor.resume())])
    assert one.result.state == "done"
    (alarm,), (cleared,) = one.records("alarm"), one.records("alarm_cleared")
    assert cleared["name"] == alarm["name"] == "panel hold"
    assert cleared["how"] == "acknowledged"
    assert cleared["t"] - alarm["t"] == pytest.approx(9.0, abs=0.5)
    events = part_record_of(one.journal).runs[0].events
    assert all(event.wall.endswith("Z") for event in events)
    assert any(event.text.startswith("alarm over (acknowledged)") for event in events)
