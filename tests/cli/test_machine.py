"""`lmctl machine`, met as an operator meets it: on the bench, on a bench of its own, on nothing."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import pytest

from lmctl.run.journal.format import read_records, verify_journal
from tests.cli.conftest import CELL, HOMING
from tests.part_files import block_file

PART = block_file((20, 20, 0.8))


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def acts(folder: Path) -> list[dict[str, object]]:
    (path,) = (folder / "runs").glob("machine-bench-cell*.jsonl")
    assert verify_journal(path).intact
    return [record for record in read_records(path) if record["kind"] in ("act", "ended")]


# --- looking ----------------------------------------------------------------------------------


def test_status_shows_every_device(lmctl) -> None:
    text = lmctl("machine", "status", "--sim").data
    for part in ("Idle, grblhal", "X 0.000  Y 0.000  Z 0.000 mm", "feeder F2", "hopper A", "100 %"):
        assert part in text
    seen = lmctl("machine", "status", "--sim", "--json").json
    assert seen["motion"]["position_trusted"] is True
    assert seen["motion"]["blocks_free"] == 100
    assert seen["feeders"]["F1"]["hoppers"]["A"]["level_percent"] == 100.0


def test_doctor_finds_the_shipped_cell_well(lmctl) -> None:
    outcome = lmctl("machine", "doctor", "--sim")
    assert outcome.code == 0, outcome.data
    assert "✗" not in outcome.data
    assert outcome.data.rstrip().endswith("all well")


@pytest.mark.parametrize(("change", "said", "what_to_do", "code"), [
    (("32 = 1", "32 = 0"), "laser mode is off", "lmctl machine settings 32=1", 4),
    (("10 = 511", "10 = 1"), "neither Ln: nor Bf:", "settings 10=71", 4),
    (("30 = 1000", "30 = 255"), "full power is S255", "settings 30=1000", 4),
    (("32 = 1", "32 = 1\n13 = 1"), "every position would be misread", "settings 13=0", 4),
    (("32 = 1", "32 = 1\n31 = 50"), "low powers, and those of slow moves", "settings 31=0", 4),
    (("32 = 1", "32 = 1\n31 = 5"), "low powers, and those of slow moves", "settings 31=0", 1),
    (("111 = 6000", "111 = 3000"), "speed of Y: $111=3000.000, the profile has 6000",
     "settings 111=6000", 1),
    (("122 = 500", "122 = 250"), "acceleration of Z: $122=250.000", "settings 122=500", 1),
    (("132 = 200", "132 = 150"), "travel of Z: $132=150.000, the profile has 200",
     "settings 132=200", 1),
    (("32 = 1", "32 = 1\n11 = 0.05"), "junction deviation: $11=0.050, not 0.01",
     "settings 11=0.01", 1),
    (("planner_blocks = 100", "planner_blocks = 40"), "the profile has 100 blocks",
     "motion.planner_blocks = 40", 1),
    (("n_min_rpm = 0.3", "n_min_rpm = 1.0"), "2.59 to 64.8 g/min; the profile has 0.8 to 60",
     "correct min_flow_g_min", 1),
    (("n_max_rpm = 25.0", "n_max_rpm = 10.0"), "cannot feed 60 g/min", "lower its max_flow", 4),
    (HOMING, "its position is unknown", "lmctl machine home", 4),
    (HOMING, "Z of the profile, 0 to 200 mm, is 0 to 200 on the controller, which has -200 to 0",
     "lmctl machine offset Z-200", 4),
    (("32 = 1", "32 = 1\n22 = 1"), "soft limits off ($20)", "settings 20=1", 4),
    (('dialect = "grblhal"', 'dialect = "grbl"'), "no Bf:", "settings 10=", 4),
])
def test_doctor_says_what_is_wrong_and_what_to_do(
    lmctl, bench, change, said, what_to_do, code
) -> None:
    if "grbl\"" in change[1]:
        path = bench(change, ("10 = 511", "10 = 1"), ("rx_bytes = 1024", "rx_bytes = 128"))
    else:
        path = bench(change)
    outcome = lmctl("machine", "doctor", "--sim", "--bench", path)
    lines = outcome.data.splitlines()
    (at,) = [i for i, line in enumerate(lines) if "✗" in line and said in line][:1]
    assert what_to_do in lines[at + 1]
    assert outcome.code == code
    checks = lmctl("machine", "doctor", "--sim", "--bench", path, "--json").json
    assert checks["good"] is False
    assert any(said in check["text"] and not check["good"] for check in checks["checks"])


def test_what_doctor_calls_dangerous_keeps_a_run_from_starting(
    lmctl, refused, bench, tmp_path
) -> None:
    path = bench(("30 = 1000", "30 = 255"), ("32 = 1", "32 = 1\n13 = 1"))
    (tmp_path / "part.toml").write_text(PART)
    assert lmctl("plan", "part.toml").code == 0
    text = refused("run", "part.lmj", "--sim", "--bench", path, code=4)
    assert "full power is S255" in text
    assert "also: reports in mm: $13=1" in text


def test_one_dead_device_keeps_no_other_from_being_looked_at(lmctl, tmp_path) -> None:
    (tmp_path / "cell.toml").write_text(CELL.replace("2323", str(_free_port())))
    outcome = lmctl("machine", "doctor", "--machine", "cell.toml")
    assert outcome.code == 4
    assert outcome.data.count("✗") == 3
    outcome = lmctl("machine", "status", "--machine", "cell.toml")
    assert outcome.code == 4
    assert outcome.data.count("cannot be looked at") == 3
    assert "feeder F2" in outcome.data


def test_looking_changes_nothing(lmctl, active, tmp_path) -> None:
    cell = active()
    before = lmctl("machine", "status", "-m", cell, "--json").json
    for _ in range(2):
        assert lmctl("machine", "doctor", "-m", cell).code == 0
    assert lmctl("machine", "status", "-m", cell, "--json").json == before
    assert not (tmp_path / "runs").exists()


# --- acting -----------------------------------------------------------------------------------


def test_a_machine_is_homed_offset_jogged_and_stays_known(lmctl, refused, active, tmp_path):
    """From one command to the next, and so for a run."""
    cell = active(HOMING)
    assert "the machine position is unknown" in refused(
        "machine", "jog", "X10", "-m", cell, code=4)
    assert "limited to 10 mm" in refused("machine", "jog", "X-20", "--relative", "-m", cell, code=2)
    assert lmctl("machine", "jog", "X-5", "--relative", "-m", cell).code == 0
    homed = lmctl("machine", "home", "-m", cell, "--yes")
    assert homed.code == 0
    assert "Z goes first, to its switch: Z+" in homed.talk
    assert "is at X -1.000  Y -1.000  Z -1.000" in homed.data
    offset = lmctl("machine", "offset", "X-300", "Y-300", "Z-200", "-m", cell)
    assert "program zero lies at X -300.000  Y -300.000  Z -200.000" in offset.data
    assert lmctl("machine", "doctor", "-m", cell).code == 0
    jogged = lmctl("machine", "jog", "X250", "z190.5", "--feed", "6000", "-m", cell)
    assert "X 250.000  Y 299.000  Z 190.500" in jogged.data
    text = refused("machine", "jog", "Y10", "--relative", "-m", cell, code=2, hint=False)
    assert "Y: 309.00 mm, the travel is 0 to 300" in text
    seen = acts(tmp_path)
    assert [record["do"] for record in seen if record["kind"] == "act"] == [
        "jog", "jog", "jog", "home", "offset", "jog", "jog"]
    assert [record["trusted"] for record in seen if record["kind"] == "ended"] == [
        False, False, False, True, True, True, True]
    assert "unknown" in str(seen[1]["why"])


def test_a_homed_grbl_which_says_nothing_of_it_is_known_while_it_stands_where_it_was_left(
    lmctl, active
) -> None:
    cell = active(HOMING, ('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3"),
                    ("rx_bytes = 1024", "rx_bytes = 128"),
                    ("planner_blocks = 100", "planner_blocks = 15"))
    unlocked = lmctl("machine", "unlock", "-m", cell, "--yes")
    assert unlocked.code == 0, unlocked.talk
    assert lmctl("machine", "jog", "X-5", "-m", cell).code == 4
    assert lmctl("machine", "home", "-m", cell, "--yes").code == 0
    assert lmctl("machine", "offset", "X-300", "Y-300", "Z-200", "-m", cell).code == 0
    assert lmctl("machine", "jog", "X290", "--feed", "3000", "-m", cell).code == 0
    assert lmctl("machine", "jog", "X285", "--runs", "elsewhere", "-m", cell).code == 4


def test_ctrl_c_ends_a_jog_at_once(active, tmp_path, lmctl) -> None:
    cell = active()
    begun_s = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", "machine", "jog", "X250", "--feed", "600",
         "-m", str(cell)], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )
    journal = tmp_path / "runs/machine-bench-cell.jsonl"
    for _ in range(200):
        if journal.exists() and '"act"' in journal.read_text():
            break
        time.sleep(0.05)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, talk = process.communicate(timeout=20)
    at_most_mm = 10.0 * (time.monotonic() - begun_s)
    assert process.returncode == 130
    assert talk.strip() == "interrupted"
    first = lmctl("machine", "status", "-m", cell, "--json").json["motion"]
    time.sleep(0.3)
    second = lmctl("machine", "status", "-m", cell, "--json").json["motion"]
    assert first["state"] == second["state"] == "Idle"
    assert 0 < first["position_mm"][0] == second["position_mm"][0] < min(at_most_mm, 200.0)
    assert acts(tmp_path)[-1]["why"] == "stopped by the operator"


def test_a_machine_at_work_is_left_alone(lmctl, refused, active, tmp_path) -> None:
    cell = active()
    holder = subprocess.Popen(
        [sys.executable, "-m", "lmctl.cli", "machine", "jog", "X250", "--feed", "600",
         "-m", str(cell)], cwd=tmp_path, stderr=subprocess.PIPE,
    )
    try:
        for _ in range(200):
            if (tmp_path / "runs/machine-bench-cell.jsonl").exists():
                break
            time.sleep(0.05)
        for command in (["jog", "X5"], ["home", "--yes"], ["status"], ["doctor"], ["unlock"]):
            text = refused("machine", *command, "-m", cell, code=4)
            assert "lmctl machine jog has the machine" in text
    finally:
        holder.send_signal(signal.SIGINT)
        holder.communicate(timeout=20)


@pytest.mark.parametrize(("words", "said"), [
    (["Q5"], "'Q5' is no axis"), (["X"], "'X' is no axis"), (["X5", "X6"], "X is named twice"),
    (["Xnan"], "'Xnan' is no axis"), (["X1e3"], "'X1e3' is no axis"), (["--fast"], "no axis"),
    (["X5\nM3 S1000"], "no axis"), (["X-1"], "the travel is 0 to 300"),
    (["X5", "--feed", "9000"], "too fast"), (["X5", "--feed", "nan"], "not a number"),
])
def test_jogs_that_cannot_be_meant(lmctl, words, said) -> None:
    outcome = lmctl("machine", "jog", "--sim", *words)
    assert outcome.code == 2
    assert said in outcome.talk


def test_no_one_is_homed_without_being_asked(refused, lmctl, bench, monkeypatch) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    path = bench(HOMING)
    assert "there is no terminal to ask at" in refused("machine", "home", "--sim", "--bench", path,
                                                    code=2)
    assert "no homing cycle ($22=0)" in refused("machine", "home", "--sim", code=4)
    assert lmctl("machine", "unlock", "--sim").data == "nothing is locked\n"


@pytest.mark.parametrize("command", ["status", "doctor", "home", "unlock"])
def test_a_machine_has_to_be_named(refused, command) -> None:
    assert "which machine?" in refused("machine", command, code=2)
    refused("machine", command, "-m", "nothere.toml", code=2)


def test_the_machines_journal_may_end_half_written_but_not_be_altered(
    lmctl, refused, tmp_path
) -> None:
    for _ in range(2):
        assert lmctl("machine", "jog", "X5", "--sim").code == 0
    path = tmp_path / "runs/machine-bench-cell-simulated.jsonl"
    with path.open("ab") as file:
        file.write(b'{"prev":"half')
    assert lmctl("machine", "jog", "X5", "--sim").code == 0
    assert len(acts(tmp_path)) == 6
    text = path.read_text()
    path.write_text(text.replace('"X":5.0', '"X":6.0', 1))
    assert "was damaged or altered" in refused("machine", "jog", "X5", "--sim", code=1)
    assert json.loads(text.splitlines()[0])["machine"] == "bench cell simulated"


def test_behind_a_watchdog_relay_axes_can_be_moved_and_doctor_says_why_it_sees_little(lmctl):
    examples = files("lmctl.examples")
    cell = ["--sim", "-m", examples / "cell-safe.toml", "--bench", examples / "bench-safe.toml"]
    assert "X 5.000" in lmctl("machine", "jog", "X5", *cell).data
    doctor = lmctl("machine", "doctor", *cell)
    assert doctor.code == 1
    assert "it is in state Door" in doctor.data
    assert "it is the watchdog relay" in doctor.data
    assert "every fitted input is good" in doctor.data


def test_a_look_at_the_cell_shows_the_relay_and_the_laser_enable_output(lmctl):
    examples = files("lmctl.examples")
    cell = ["--sim", "-m", examples / "cell-safe.toml", "--bench", examples / "bench-safe.toml"]
    safety = lmctl("machine", "status", *cell).data.partition("\nsafety")[2]
    assert "relay      open, as it is while no host sends heartbeats" in safety
    assert "laser      enable output off" in safety
    facts = lmctl("machine", "status", "--json", *cell).json["safety"]
    assert (facts["relay_closed"], facts["laser_enabled"]) == (False, False)
    bare = lmctl("machine", "status", "--sim").data  # of a cell without them it says nothing
    assert "relay" not in bare
    assert "laser" not in bare
