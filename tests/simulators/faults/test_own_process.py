"""The bench as a process of its own: faults from a file, and its record asked for by others."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from simulators.__main__ import main as serve

FAULTS = """
[[fault]]
kind = "panel_hold"
at_line = 2

[[fault]]
kind = "host_killed"
at_s = 0.3
"""


@pytest.fixture
def cell_file(tmp_path, bench_text):
    path = tmp_path / "bench.toml"
    path.write_text(bench_text.replace(":2323", ":0").replace(":5021", ":0").replace(
        ":5022", ":0"), encoding="utf-8")
    return path


def test_faults_are_reported_as_they_happen_and_the_record_is_written_when_asked(
    tmp_path, cell_file
):
    (tmp_path / "faults.toml").write_text(FAULTS, encoding="utf-8")
    record = tmp_path / "record.json"
    bench = subprocess.Popen(
        [sys.executable, "-m", "simulators", cell_file, "--faults", tmp_path / "faults.toml",
         "--record", record],
        stdout=subprocess.PIPE, text=True,
    )
    try:
        port = int(json.loads(bench.stdout.readline())["motion"].rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as host:
            host.sendall(b"G21 G90 G94\nM4 S0\nN1 G1 X1 F600 S500\nN2 G1 X5\nN3 G1 X9\n")
            reported = [json.loads(bench.stdout.readline()) for _ in range(2)]
        bench.send_signal(signal.SIGUSR1)
        early = _written(record)
        os.remove(record)
        bench.terminate()
        assert bench.wait(timeout=20) == 0
    finally:
        bench.kill()
        bench.stdout.close()
    assert {one["fault"] for one in reported} == {"panel_hold", "host_killed"}
    late = json.loads(record.read_text())
    assert not (tmp_path / "record.json.part").exists()
    for asked in (early, late):
        assert [line["line"] for line in asked["lines"]] == [1, 2]
        assert len(asked["faults"]) == 2
        assert asked["drawn"][0] == {
            "line": 1, "beam_on_mm": pytest.approx(1.0), "repeated_mm": 0.0}
        assert asked["host"]["motion"][0][1] is True
    assert late["host"]["motion"][-1][1] is False
    assert late["verdict"]["beam_off_after_s"] < 0.3


def _written(path):
    for _ in range(200):
        if path.exists():
            return json.loads(path.read_text())
        time.sleep(0.05)
    raise AssertionError("no record was written")


def test_every_mistake_of_a_fault_file_is_reported(tmp_path, cell_file, capsys):
    faults = tmp_path / "faults.toml"
    faults.write_text('[[fault]]\nkind = "dor"\n')
    assert serve([str(cell_file), "--faults", str(faults)]) == 3
    reported = capsys.readouterr().err
    assert "does not say what goes wrong" in reported
    assert "fault[1].kind: there is no fault 'dor'; 'door'?" in reported
    assert "fault[1]: needs one of at_s, at_line, at_level_g" in reported
    assert serve([str(cell_file), "--faults", str(tmp_path / "nothing")]) == 3
    assert "cannot read" in capsys.readouterr().err
