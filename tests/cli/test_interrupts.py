"""Ctrl-C and busy ports, met by the real program in a process of its own."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest

import lmctl.examples
from lmctl.config.machine import load_profile
from lmctl.run.journal.format import read_records, verify_journal
from simulators import virtual_time
from tests.faults.kills import shortened, wired
from tests.part_files import block_file
from tests.run.conftest import squares, write_job

EXAMPLES = Path(lmctl.examples.__file__).parent

BLOCK = block_file((120, 90, 40))


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", *arguments], cwd=folder, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )


def when(condition: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    """Wait until something shows on disk; the process must not end before."""
    for _ in range(600):
        if condition():
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    raise AssertionError("it never came to that")


@pytest.fixture
def part(tmp_path: Path) -> Path:
    (tmp_path / "part.toml").write_text(BLOCK)
    return tmp_path / "part.toml"


def test_ctrl_c_while_planning_leaves_nothing(part: Path, tmp_path: Path) -> None:
    process = start(tmp_path, "plan", "part.toml")
    when(lambda: any(tmp_path.glob(".*.tmp")), process)
    process.send_signal(signal.SIGINT)
    _, talk = process.communicate(timeout=60)
    assert process.returncode == 130, talk
    assert "Traceback" not in talk
    assert "interrupted" in talk
    assert [path.name for path in tmp_path.iterdir()] == ["part.toml"]


def test_nothing_is_taken_to_pieces_after_ctrl_c(tmp_path: Path) -> None:
    """An exit handler of a library that cannot bear what the interrupt left of its work."""
    program = """
import atexit, os, signal
import lmctl.cli.__main__ as lmctl

def interrupted():
    atexit.register(os.kill, os.getpid(), signal.SIGSEGV)
    print("as far as it came")
    return 130

lmctl.main = interrupted
lmctl.run()
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, text=True,
                           stdout=subprocess.PIPE)
    assert (ended.returncode, ended.stdout) == (130, "as far as it came\n")


def test_ctrl_c_while_running_stops_in_the_safe_order(tmp_path: Path) -> None:
    write_job(tmp_path / "part.lmj", load_profile(EXAMPLES / "cell.toml"),
              squares(layers=6, per_layer=3, side_mm=12.0))
    process = start(tmp_path, "run", "part.lmj", "--sim", "--speed", "20", "--operator", "Ada")
    journal = tmp_path / "runs" / "run-0001" / "journal.jsonl"
    when(lambda: journal.exists() and '"depositing"' in journal.read_text(), process)
    process.send_signal(signal.SIGINT)
    _, talk = process.communicate(timeout=60)
    assert process.returncode == 5, talk
    assert "Traceback" not in talk
    assert "stopping: beam and motion off now" in talk
    assert verify_journal(journal).sealed
    records = list(read_records(journal))
    assert records[-1]["state"] == "stopped"
    (asked,) = [record for record in records if record["kind"] == "operator"]
    assert (asked["act"], asked["operator"], asked["local"]["uid"]) == ("stop", "Ada", os.getuid())
    acts = [record["do"] for record in records if record["kind"] == "act"]
    assert acts[-3:] == ["beam and motion off", "powder off", "post-flow, gas off"]


@pytest.mark.parametrize(("answer", "said"), [
    (b"", "the motion controller is silent"),
    (b"\xff\x00hello, this is a modem\r\n", "what answers is not a Grbl controller"),
])
def test_a_port_that_is_no_controller(
    refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes,
    said: str,
) -> None:
    """A real port; its silence is waited for in virtual time. The feeders are away as well."""
    master, slave = os.openpty()
    text = (EXAMPLES / "cell.toml").read_text().replace(
        "tcp://127.0.0.1:2323", f"pty://{os.ttyname(slave)}"
    )
    closed = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    for port, feeder in zip(("5021", "5022"), closed, strict=True):
        text = text.replace(f':{port}"', f':{feeder.getsockname()[1]}"')
        feeder.close()
    (tmp_path / "cell.toml").write_text(text)
    write_job(tmp_path / "part.lmj", load_profile(tmp_path / "cell.toml"), squares())

    async def answered(command: Coroutine[Any, Any, Any]) -> Any:
        loop = asyncio.get_running_loop()
        loop.add_reader(master, lambda: os.read(master, 100) and os.write(master, answer))
        try:
            return await command
        finally:
            loop.remove_reader(master)

    monkeypatch.setattr("asyncio.run",
                        lambda command: virtual_time.run_in_virtual_time(answered(command)))
    talk = refused("run", "part.lmj", "--machine", "cell.toml", code=4)
    os.close(master)
    os.close(slave)
    assert said in talk


def test_a_bench_of_its_own_is_a_machine_like_any_other(tmp_path: Path) -> None:
    """`python -m simulators` at the far end of real wires, driven as --machine drives a cell."""
    bench_text = shortened("bench.toml")
    for port in ("2323", "5021", "5022"):
        bench_text = bench_text.replace(f"127.0.0.1:{port}", "127.0.0.1:0")
    (tmp_path / "bench.toml").write_text(bench_text)
    bench = subprocess.Popen(
        [sys.executable, "-m", "simulators", "bench.toml"], cwd=tmp_path, text=True,
        stdout=subprocess.PIPE,
    )
    try:
        assert bench.stdout is not None
        (tmp_path / "cell.toml").write_text(wired(json.loads(bench.stdout.readline())))
        write_job(tmp_path / "part.lmj", load_profile(tmp_path / "cell.toml"),
                  squares(layers=1, per_layer=1, speed_mm_s=20.0))
        process = start(tmp_path, "run", "part.lmj", "-m", "cell.toml", "--json")
        data, talk = process.communicate(timeout=100)
        assert process.returncode == 0, talk
        assert json.loads(data)["state"] == "done"
    finally:
        bench.send_signal(signal.SIGINT)
        bench.communicate(timeout=20)
