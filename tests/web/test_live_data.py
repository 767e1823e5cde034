"""What viewers are sent: bounded whatever they read, and mixtures as reports infer them."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from lmctl.run.journal.format import read_records
from lmctl.web.job_layers import JobLayers
from lmctl.web.journal_points import JournalPoints
from lmctl.web.run_watch import RunWatch
from lmctl.web.viewer_queue import ViewerQueue, sse_message


def test_a_viewer_that_reads_slowly_gets_the_last_snapshot_and_every_point():
    async def main():
        viewer = ViewerQueue(lambda: b"everything;")
        viewer.offer(b"before;")
        assert await viewer.next_chunk(1.0) == b"everything;"
        for number in range(3):
            viewer.offer(b"point %d;" % number)
            viewer.offer_snapshot(b"snapshot %d;" % number)
        assert await viewer.next_chunk(1.0) == b"point 0;point 1;point 2;snapshot 2;"
        assert (await viewer.next_chunk(0.01)).startswith(b":")

    asyncio.run(main())


def test_a_viewer_that_reads_nothing_holds_little_and_then_gets_everything_anew():
    async def main():
        viewer = ViewerQueue(lambda: b"everything;")
        await viewer.next_chunk(1.0)
        for _ in range(10_000):
            viewer.offer(b"x" * 1000)
            viewer.offer_snapshot(b"y" * 1000)
            assert viewer._waiting_bytes <= 1_002_000
        assert await viewer.next_chunk(1.0) == b"everything;"

    asyncio.run(main())


def test_a_message_is_one_event_whatever_is_in_it():
    message = sse_message("events", [{"what": "a\n\nevent: stop\ndata: 1", "name": "\u2028ü"}])
    assert message.count(b"\n\n") == 1
    assert message.count(b"\n") == 3
    assert message.isascii()


def points_of(run, records, header, *, restarted=False):
    job = JobLayers(run.job, header)
    curves = JournalPoints(header, job)
    if restarted:
        curves.restart()
    joined = {}
    for record in records:
        for name, column in (curves.take(record) or {}).items():
            joined.setdefault(name, []).extend(column)
    job.close()
    return {name: np.array(column, dtype=float) for name, column in joined.items()}


def test_the_mixture_at_the_nozzle_is_what_the_flows_make_of_it(ended_run):
    header, *records = read_records(ended_run.journal)
    found = points_of(ended_run, records, header)
    # 0.1 g/s of each, by volume deposited: catch efficiency over density (g/mm³) of the library.
    deposit = np.array([0.75 / 7.95e-3, 0.55 / 14.2e-3])
    share = deposit / deposit.sum()
    steady = (found["set_g_min0"] == 6.0) & (found["set_g_min1"] == 6.0)
    assert np.abs(found["commanded0"][steady] - share[0]).max() < 0.02
    beam = found["power_W"] > 0
    assert np.abs(found["nozzle0"][beam] - share[0]).max() < 0.02
    assert np.nanmax(np.abs(found["nozzle0"] + found["nozzle1"] - 1.0)) < 2e-4
    planned = found["planned0"][~np.isnan(found["planned0"])]
    assert len(planned) > 20
    assert (planned == 0.5).all()


def test_the_mixture_designed_is_the_part_files_at_the_line_executed(ended_run):
    header, *records = read_records(ended_run.journal)
    found = points_of(ended_run, records, header)
    bead = ~np.isnan(found["planned0"])
    assert (found["designed0"][bead] == 0.6).all()
    assert (found["designed1"][bead] == 0.4).all()
    assert np.isnan(found["designed0"][~bead]).all()

    async def main():
        watch = RunWatch(ended_run)
        watch.start()
        await watch.caught_up.wait()
        found = watch.snapshot()["mixture"]
        await watch.close()
        return found

    found = asyncio.run(main())
    assert found["designed"] is None  # it has left the part
    assert found["origins"]["designed"]["kind"] == "planned"
    assert found["origins"]["nozzle"]["kind"] == "inferred"


def test_a_page_opened_in_the_middle_of_a_run_infers_the_same_or_nothing(ended_run):
    header, *records = read_records(ended_run.journal)
    whole = points_of(ended_run, records, header)
    first = [at for at, record in enumerate(records) if record["kind"] == "samples"][30]
    late = points_of(ended_run, records[first:], header, restarted=True)
    known = ~np.isnan(late["nozzle0"])
    assert known.any()
    assert not known[:10].any()
    same = whole["nozzle0"][-len(known):]
    assert np.nanmax(np.abs(late["nozzle0"] - same)) < 0.02


@pytest.mark.parametrize("damage", [
    {"kind": "samples", "t": 1.0, "at": [1.0]}, {"kind": "setpoint", "t": 1.0, "flow_g_min": 7},
    {"kind": "samples", "t": "x"}, {"kind": "samples", "t": 1.0, "at": None},
])
def test_a_damaged_record_ends_the_curves_and_nothing_else(ended_run, damage):
    watch = RunWatch(ended_run)
    watch._read_journal()
    assert watch.job is not None
    assert watch._points_of({"kind": "state", "t": 1.0}) is None
    assert watch._curves is not None
    assert watch._points_of(damage) is None
    assert watch._curves is None
    assert watch.snapshot()["state"] == "done"
    watch.job.close()
