"""hold, resume, stop, override and status, against a run in a process of its own."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lmctl.run.journal.format import verify_journal
from tests.part_files import block_file

BLOCK = block_file((60, 40, 1.6))


def when(condition: Callable[[], bool]) -> None:
    for _ in range(600):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError("it never came to that")


@pytest.fixture
def start(tmp_path: Path, lmctl) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts runs of a small block at twenty times real time."""
    (tmp_path / "part.toml").write_text(BLOCK)
    assert lmctl("plan", "part.toml").code == 0
    started = []

    def one(*arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "lmctl.cli", "run", "part.lmj", "--sim", "--speed", "20",
             *arguments], cwd=tmp_path, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )
        started.append(process)
        return process

    yield one
    for process in started:
        process.kill()
        process.communicate()


def test_a_run_is_held_looked_at_resumed_and_stopped(start, lmctl, refused, tmp_path) -> None:
    process = start("--operator", "Ada")
    when(lambda: (tmp_path / "runs/run-0001/control.sock").exists())
    when(lambda: lmctl("status", "--json").json["state"] == "depositing")

    text = lmctl("status").data
    assert "run-0001: depositing, block on bench cell (operator Ada)" in text
    for part in ("layer      1 of 2", "time left", "override   100 %", "A ", "nozzle"):
        assert part in text

    held = lmctl("hold")
    assert held.code == 0
    assert "run-0001 is held at layer" in held.data
    assert "lmctl resume run-0001" in held.data
    assert lmctl("override", "80", "run-0001", "--json").json["override_percent"] == 80
    assert "50 to 200" in refused("override", "900", code=2)
    assert "run-0001 resumes" in lmctl("resume").data
    again = lmctl("hold", "--json").json  # while it purges
    assert again["state"] == "held"
    assert "cannot hold now: the run is held" in refused("hold", code=2)
    seen = subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", "status", "--watch", "0.2", "--json"], cwd=tmp_path,
        stdout=subprocess.PIPE, text=True,
    )
    assert seen.stdout is not None
    assert json.loads(seen.stdout.readline())["state"] == "held"
    assert "run-0001 stops" in lmctl("stop").data
    _, talk = process.communicate(timeout=60)
    assert process.returncode == 5
    assert "run-0001 was stopped by the operator" in talk
    last = seen.communicate(timeout=20)[0].splitlines()[-1]
    assert json.loads(last)["state"] == "stopped"
    found = verify_journal(tmp_path / "runs/run-0001/journal.jsonl")
    assert found.intact
    assert found.sealed

    assert "run-0001 is not under way: stopped" in lmctl("status", "run-0001").data
    assert lmctl("status", "run-0001", "--json").json["state"] == "stopped"
    assert "it is stopped" in refused("hold", "run-0001", code=1)
    assert "no run is under way in runs" in refused("status", code=1)


def test_which_of_two_has_to_be_said(start, lmctl, refused, tmp_path) -> None:
    start()
    start()  # each on a bench of its own, so they may
    when(lambda: len(list((tmp_path / "runs").glob("run-*/control.sock"))) == 2)
    text = refused("hold", code=2)
    assert "2 runs are under way" in text
    assert "run-0001, run-0002" in text
    assert lmctl("status", "run-0002", "--json").json["run"] == "run-0002"
    for run in ("run-0001", "run-0002"):
        assert lmctl("stop", run).code == 0


def test_a_killed_run_is_not_under_way(start, lmctl, refused, tmp_path) -> None:
    process = start()
    path = tmp_path / "runs/run-0001/control.sock"
    when(path.exists)
    when(lambda: lmctl("status").code == 0)
    process.kill()
    process.wait()
    assert path.exists()
    assert "no run is under way" in refused("stop", code=1)
    assert not path.exists()
    assert "broken off" in lmctl("status", "run-0001").data
    assert "it was broken off" in refused("stop", "run-0001", code=1)


def test_where_there_is_nothing_to_drive(refused, tmp_path) -> None:
    assert "no run is under way in runs" in refused("hold", code=1)
    assert "there is no run 'run-0009'" in refused("resume", "run-0009", code=2)
    assert "there is no run '../etc'" in refused("stop", "../etc", code=2)
    refused("override", "fast", code=2, hint=False)
    (tmp_path / "runs/run-0001").mkdir(parents=True)
    (tmp_path / "runs/run-0001/control.sock").write_text("no socket")
    assert "no run is under way" in refused("status", code=1)


def test_what_answers_nonsense_or_nothing_is_said_so(refused, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("lmctl.run.control.client._ANSWER_S", 0.2)
    folder = tmp_path / "runs/run-0001"
    folder.mkdir(parents=True)
    (folder / "journal.jsonl").touch()
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(folder / "control.sock"))
        deaf.listen(8)
        assert "run-0001 does not answer" in refused("hold", code=1)


def test_a_hopper_is_refilled_from_another_terminal(start, lmctl, refused, tmp_path) -> None:
    process = start()
    when(lambda: (tmp_path / "runs/run-0001/control.sock").exists())
    when(lambda: lmctl("status", "--json").json["state"] == "depositing")

    assert "needs both --lot and --mass" in refused("refill", "A", "--lot", "L7", code=2)
    assert "uses no hopper 'Z'" in refused("refill", "Z", code=2)
    asked = lmctl("refill", "A")
    assert asked.code == 0
    assert "makes hopper A ready" in asked.data
    when(lambda: lmctl("status", "--json").json["state"] == "refilling")
    assert "fill and close it" in refused("resume", code=2)
    assert "weighs hopper A" in lmctl("refill", "A", "--lot", "HEAT-7", "--mass", "250").data
    when(lambda: lmctl("status", "--json").json["state"] == "held")
    assert "run-0001 resumes" in lmctl("resume").data
    when(lambda: lmctl("status", "--json").json["state"] == "depositing")
    assert lmctl("stop").code == 0
    lmctl("stop")
    process.communicate(timeout=60)
    records = [json.loads(line) for line in
               (tmp_path / "runs/run-0001/journal.jsonl").read_text().splitlines()]
    (refill,) = (record for record in records if record["kind"] == "refill")
    assert (refill["hopper"], refill["lot"], refill["mass_g"]) == ("A", "HEAT-7", 250.0)
    assert refill["weighed_g"] == 0.0  # no powder was poured in: the two differ
    acts = [record["act"] for record in records if record["kind"] == "operator"]
    assert acts[:2] == ["refill Z", "refill A"]
    assert "refill A with lot HEAT-7, 250 g" in acts
