"""Runs driven through their control socket, as another terminal would."""

from __future__ import annotations

import asyncio
import json
import os

import pytest

from lmctl.machine.motion.links import ByteLink
from lmctl.run.control.socket_path import SOCKET_NAME
from lmctl.run.journal.format import run_fingerprint
from lmctl.run.state.transitions import RunState
from tests.run.whole.conftest import BenchRun


class Terminal:
    """Keeps one connection to a run's socket, and every answer."""

    def __init__(self, folder):
        self.folder = folder
        self.said = []
        self.talks = []

    def asks(self, do, **values):
        """An act for `run(acts=...)`."""

        def act(_):
            (path,) = self.folder.glob(f"*/runs/run-0001/{SOCKET_NAME}")
            self.talks.append(asyncio.create_task(self.talk(path, {"do": do, **values})))

        return act

    async def talk(self, path, request):
        reader, writer = await asyncio.open_unix_connection(str(path))
        writer.write(json.dumps(request).encode() + b"\n")
        while line := await reader.readline():
            self.said.append(json.loads(line))
            if request["do"] != "watch":
                break
        writer.close()


def acts_of(bench_run):
    return [(r["act"], r["accepted"]) for r in bench_run.records("operator")]


def test_hold_resume_and_override_by_the_socket(run, square_job, tmp_path):
    terminal = Terminal(tmp_path)
    ran = run(square_job, acts=[
        (2.0, terminal.asks("status")), (2.5, terminal.asks("resume")),
        (3.0, terminal.asks("hold")), (4.0, terminal.asks("status")),
        (4.5, terminal.asks("override", percent=80)), (5.0, terminal.asks("resume")),
    ])
    assert ran.result is not None, ran.error
    assert ran.executor.state is RunState.DONE
    ran.check_safe()
    ok = [answer["ok"] for answer in terminal.said]
    assert ok == [True, False, True, True, True, True]
    before, _, _, held, *_ = terminal.said
    assert before["state"] == "depositing"
    assert 0 < before["line"] < before["lines"]
    assert before["run"] == "run-0001"
    assert len(before["position_mm"]) == 3
    assert before["alarms"] == []
    assert held["state"] == "held"
    assert acts_of(ran) == [("resume", False), ("hold", True), ("override 80 %", True),
                            ("resume", True)]
    refused = ran.records("operator")[0]
    assert "cannot resume now: the run is depositing" in refused["refused"]
    assert refused["local"].keys() == {"uid", "pid", "wall"}


@pytest.mark.parametrize("act", ["hold", "stop"])
def test_a_slow_disk_does_not_keep_the_beam_on(run, square_job, tmp_path, monkeypatch, act):
    log, to_disk, to_wire = [], os.fdatasync, ByteLink.write_realtime

    def sent(link, data):
        log.append(data)
        to_wire(link, data)

    def synced(fd):
        log.append("synced")
        to_disk(fd)

    def ask(one):
        monkeypatch.setattr(ByteLink, "write_realtime", sent)
        monkeypatch.setattr(os, "fdatasync", synced)
        one.executor.hold() if act == "hold" else one.executor.stop()

    ends = [(5.0, Terminal(tmp_path).asks("stop"))] if act == "hold" else []
    ran = run(square_job, acts=[(3.0, ask), *ends])
    ran.check_safe()
    assert "synced" in log
    assert log[0] == b"!"


def test_a_stop_ends_it_in_the_safe_order_and_is_seen_by_who_watches(run, square_job, tmp_path):
    terminal = Terminal(tmp_path)
    ran = run(square_job, acts=[(1.0, terminal.asks("watch", every_s=1.0)),
                                (3.0, terminal.asks("stop"))])
    ran.check_safe()
    assert ran.executor.state is RunState.STOPPED
    states = [answer["state"] for answer in terminal.said]
    assert states[0] == "depositing"
    assert states[-1] == "stopped"
    assert acts_of(ran) == [("stop", True)]
    assert not (ran.journal.parent / SOCKET_NAME).exists()


def test_looking_on_changes_nothing_in_the_journal(run, square_job, tmp_path):
    alone = run(square_job)
    terminal = Terminal(tmp_path)
    watched = run(square_job, acts=[(0.5, terminal.asks("watch", every_s=0.1)),
                                    (2.0, terminal.asks("status"))])
    assert len(terminal.said) > 20
    assert run_fingerprint(watched.journal) == run_fingerprint(alone.journal)


@pytest.mark.parametrize("override", [100, 60])
def test_time_left_counts_gas_and_powder_before_it_deposits(
    square_job, profile, tmp_path, override
):
    class Looked(BenchRun):
        async def _act(self, acts):
            self.seen = []
            while self.executor.state is not RunState.DEPOSITING:
                if self.executor.state is not RunState.READY:
                    notify = self.executor.snapshot()
                    self.seen.append((self.loop.time(), notify["state"], notify["remaining_s"]))
                await asyncio.sleep(0.25)

    ran = Looked(tmp_path / "looked", profile, square_job, acts=["look"], override=override)
    done_s = ran.entered_s(RunState.FINISHING)
    assert {state for _, state, _ in ran.seen} >= {RunState.GAS, RunState.POWDER, RunState.ARMED}
    wrong_s = [left_s - (done_s - now_s) for now_s, _, left_s in ran.seen]
    assert max(map(abs, wrong_s)) < 3.0, wrong_s  # of the 14 s that gas and powder take
