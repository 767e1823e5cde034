"""What feeders warn of, as an operator meets it: before a run, while it goes, and in its log."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.resources import files

import pytest

from lmctl.cli import console, operate
from simulators.feeder import readings

CELL = (files("lmctl.examples") / "cell.toml").read_text()


@pytest.fixture
def feeders_tell(monkeypatch):
    """Every simulated feeder tells other values of itself."""
    honest = readings._system

    def report_values(**values):
        monkeypatch.setattr(readings, "_system", lambda *device: honest(*device) | values)

    return report_values


def test_status_shows_pressure_and_warnings_with_what_to_do(lmctl, feeders_tell):
    assert "gas        0.0 L/min, mixer pressure 0 mbar" in lmctl("machine", "status", "--sim").data
    feeders_tell(WARNING=0b1110, MIXER_PRESSURE=130)
    text = lmctl("machine", "status", "--sim").data
    for part in ("mixer pressure 130 mbar", "warning    hopper A of feeder F1: the weighed flow",
                 "hopper B of feeder F2: its calibration is old",
                 "what to do: recalibrate the feed factor before the next job"):
        assert part in text
    seen = lmctl("machine", "status", "--sim", "--json").json["feeders"]["F1"]
    assert seen["mixer_pressure_mbar"] == 130
    assert [one["what"].partition(": ")[2] for one in seen["warnings"]] == [
        "the weighed flow differs from the estimate by more than 5 % (A 0.00 of 0.00 g/min)",
        "the flow is unsteady, by more than 3 %", "its calibration is old"]
    feeders_tell(MIXER_PRESSURE=None)
    assert "mixer pressure - mbar" in lmctl("machine", "status", "--sim").data


def test_doctor_has_warnings_to_mend_and_a_clog_that_keeps_a_run_from_starting(
    lmctl, feeders_tell, tmp_path
):
    well = lmctl("machine", "doctor", "--sim")
    assert "✓ mixer pressure 0 mbar, 200 mbar is allowed" in well.data
    feeders_tell(WARNING=0b1000)
    warned = lmctl("machine", "doctor", "--sim")
    assert warned.code == 1
    assert "✗ hopper A of feeder F1: its calibration is old" in warned.data
    feeders_tell(MIXER_PRESSURE=201)
    clogged = lmctl("machine", "doctor", "--sim")
    assert clogged.code == 4
    assert "✗ mixer pressure 201 mbar, 200 mbar is allowed" in clogged.data
    assert "what to do: look for a clogged nozzle or kinked hose" in clogged.data
    (tmp_path / "bare.toml").write_text(
        "\n".join(line for line in CELL.splitlines() if "mixer_pressure" not in line))
    unwatched = lmctl("machine", "doctor", "--sim", "-m", "bare.toml")
    assert unwatched.code == 0
    assert "no mixer_pressure_max_mbar in the profile" in unwatched.data
    feeders_tell(MIXER_PRESSURE=None)
    without = lmctl("machine", "doctor", "--sim")
    assert without.code == 0
    assert "mixer" not in without.data


def test_a_run_shows_a_low_level_and_goes_on_and_its_log_shows_it_too(lmctl, box, tmp_path):
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "hopper_level"\ndevice = "F1"\ngrams = 1500\nat_s = 5\n')
    done = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert done.code == 0, done.talk
    line = "hopper A of feeder F1: the level is low (8 %, 1500 g left); what to do: fill it soon"
    (reported,) = [one for one in done.talk.splitlines() if one.startswith("warning: ")]
    assert reported.startswith(f"warning: {line}")
    assert "warning" not in done.data
    log = " ".join(lmctl("log", "run-0001").data.split())
    assert f"WARNING: {line}" in log


def test_status_of_a_run_shows_what_stands_and_alarms_go_before_warnings(capsys):
    warning = {"feeder": "F1", "hopper": "A", "what": "the level is low", "hint": "fill it soon"}
    alarm = {"what": "gas is low", "where": [], "hint": "check the bottle"}
    now = {"run": "run-0001", "state": "depositing", "layer": 1, "layers": 2, "line": 3,
           "lines": 9, "remaining_s": 5.0, "override_percent": 100, "alarms": []}
    operate._put_alarms(now | {"alarms": [alarm], "warnings": [warning]})
    assert capsys.readouterr().out.splitlines() == [
        "  alarm      gas is low", "             what to do: check the bottle",
        "  warning    the level is low", "             what to do: fill it soon"]
    assert operate._in_a_line(now | {"warnings": [warning]}).endswith("warning: the level is low")
    assert operate._in_a_line(now | {"alarms": [alarm], "warnings": [warning]}).endswith(
        "ALARM gas is low")
    # A run that an older version drives tells of no warnings.
    assert operate._in_a_line(now).endswith("100 %")
    operate._put_alarms(now)
    assert capsys.readouterr().out == ""


def test_a_run_goes_on_where_no_one_reads_its_output(monkeypatch):
    def broken(line):
        raise BrokenPipeError

    monkeypatch.setattr("lmctl.cli.console.print_message", broken)
    console.print_notice("warning: the level is low")


def test_on_a_terminal_a_notice_has_a_line_of_its_own_above_the_bar():
    program = (
        "from lmctl.cli.console import progress_bar\n"
        "with progress_bar('running') as bar:\n"
        "    bar(1, 2, 'layer 1')\n"
        "    bar.notice('warning: hopper [A]: ' + 'low ' * 40 + 'indeed')\n"
    )
    ours, theirs = os.openpty()
    try:
        subprocess.run([sys.executable, "-c", program], stderr=theirs, check=True,
                       env=os.environ | {"TERM": "xterm"})
        shown = os.read(ours, 65_536).decode()
    finally:
        os.close(ours)
        os.close(theirs)
    lines = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown).replace("\r", "\n").splitlines()
    assert "warning: hopper [A]: " + "low " * 40 + "indeed" in lines


def test_an_alarm_is_reported_when_it_comes_and_not_only_at_the_end(
    lmctl, box, tmp_path, monkeypatch
):
    monkeypatch.setattr("lmctl.run.sequence.HELD_AT_MOST_S", 20.0)
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "over_pressure"\ndevice = "F1"\nmbar = 300\nnoticed = false\n'
        "at_s = 25\n")
    ended = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert ended.code == 5, ended.talk
    lines = ended.talk.splitlines()
    alarm = "alarm: feeder F1: the mixer pressure is 300 mbar, 200 mbar is allowed; what to do: "
    assert lines[0].startswith(alarm)
    assert any(line.startswith("error: feeder F1: the mixer pressure is 300 mbar")
               for line in lines[1:])
