"""`lmctl machine settings` and `offset --clear`: doctor's advice, with no other sender."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import pytest

from lmctl.run.journal.format import read_records
from tests.cli.conftest import HOMING


def test_settings_are_shown_with_what_doctor_would_mend(lmctl, bench):
    shown = lmctl("machine", "settings", "--sim", "--bench", bench(("30 = 1000", "30 = 255")))
    assert shown.code == 0
    assert re.search(r"\$111 +6000\.000 +greatest rate of Y \[mm/min\]", shown.data)
    assert "✗ full power is S255" in shown.data
    assert "`lmctl machine settings 30=1000`" in shown.data
    found = lmctl("machine", "settings", "--sim", "--json").json
    assert found["settings"]["32"] == "1"
    assert found["firmware"].startswith("grblhal 1.1")


def test_what_doctor_advises_can_be_typed_until_all_is_well(lmctl, active, tmp_path):
    """Wrong settings of all sorts, mended with nothing but the commands in the hints."""
    cell = active(("32 = 1", "32 = 0\n13 = 1\n31 = 50"), ("10 = 511", "10 = 1"),
                    ("111 = 6000", "111 = 3000"))
    assert lmctl("machine", "doctor", "-m", cell).code == 4
    for _ in range(10):
        doctor = lmctl("machine", "doctor", "-m", cell)
        advice = re.search(r"what to do: `lmctl (machine settings [^`]*)`", doctor.data)
        if advice is None:
            break
        done = lmctl(*advice[1].split(), "-m", cell, "--yes")
        assert done.code == 0, done.talk
        assert "written, and read back" in done.data
    assert doctor.code == 0, doctor.data
    acts = [record for record in read_records(tmp_path / "runs/machine-bench-cell.jsonl")
            if record["kind"] == "act"]
    assert len(acts) == 5
    assert acts[0]["do"] == "settings"
    assert acts[0]["wanted"] == {"32": "1"}
    assert acts[0]["before"] == {"32": "0"}


def test_settings_are_kept_compared_and_put_back(lmctl, refused, active, tmp_path):
    cell = active()
    assert lmctl("machine", "settings", "-m", cell, "--backup", "kept.txt").code == 0
    assert "there already" in refused("machine", "settings", "-m", cell, "--backup", "kept.txt",
                                      code=2)
    same = lmctl("machine", "settings", "-m", cell, "--compare", "kept.txt")
    assert (same.code, "no difference" in same.data) == (0, True)
    assert lmctl("machine", "settings", "-m", cell, "110=4000", "$11=0.05", "--yes").code == 0
    other = lmctl("machine", "settings", "-m", cell, "--compare", "kept.txt")
    assert other.code == 1
    assert re.search(r"\$110 +4000\.000 +6000\.000 +greatest rate of X", other.data)
    assert lmctl("machine", "settings", "-m", cell, "--compare", "kept.txt", "--json").json == {
        "different": {"11": {"controller": "0.050", "file": "0.010"},
                      "110": {"controller": "4000.000", "file": "6000.000"}}}
    back = lmctl("machine", "settings", "-m", cell, "--apply", "kept.txt", "--yes")
    assert back.code == 0, back.talk
    assert "4000.000 -> 6000.000" in back.talk
    again = lmctl("machine", "settings", "-m", cell, "--apply", "kept.txt", "--yes")
    assert again.data == "nothing to write: the controller has these values already\n"


def test_what_cannot_be_written_is_said_with_exit_code_4(lmctl, active):
    cell = active()
    done = lmctl("machine", "settings", "-m", cell, "999=1", "112=3000", "--yes")
    assert done.code == 4
    assert "1 of 2 settings could not be written" in done.talk
    assert "$999: this controller has no such setting" in done.talk
    assert "$112" in done.data
    assert lmctl("machine", "settings", "-m", cell, "--json").json["settings"]["112"] == "3000.000"


def test_nothing_is_written_unasked(lmctl, refused, active, monkeypatch, tmp_path):
    cell = active(("32 = 1", "32 = 0"))
    monkeypatch.setattr("sys.stdin.isatty", lambda: False)
    assert "there is no terminal to ask at" in lmctl("machine", "settings", "-m", cell, "32=1").talk
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("click.confirm", lambda *_, **__: False)
    assert lmctl("machine", "settings", "-m", cell, "32=1").code == 130
    assert lmctl("machine", "settings", "-m", cell, "--json").json["settings"]["32"] == "0"
    assert not (tmp_path / "runs").exists()


def test_what_cannot_be_meant_is_refused_before_the_machine_is_asked(refused, tmp_path):
    (tmp_path / "wrong.txt").write_text("$110=6000\nG0 X100\n")
    assert "line 2: 'G0 X100' is no setting" in refused(
        "machine", "settings", "--sim", "--apply", "wrong.txt", code=3)
    assert "'jump' is no setting" in refused("machine", "settings", "--sim", "jump", code=2)
    assert "$32 is named twice" in refused("machine", "settings", "--sim", "32=1", "$32=0", code=2,
                                           hint=False)
    assert "exclude each other" in refused(
        "machine", "settings", "--sim", "32=1", "--backup", "x.txt", code=2, hint=False)
    assert not Path("x.txt").exists()


def test_changed_homing_takes_the_trust_in_the_position(lmctl, active):
    cell = active(HOMING, ('dialect = "grblhal"', 'dialect = "grbl"'), ("10 = 511", "10 = 3"),
                    ("rx_bytes = 1024", "rx_bytes = 128"),
                    ("planner_blocks = 100", "planner_blocks = 15"))
    assert lmctl("machine", "home", "-m", cell, "--yes").code == 0
    assert "position is known" in lmctl("machine", "doctor", "-m", cell).data
    done = lmctl("machine", "settings", "-m", cell, "100=200", "--yes")
    assert "what a position means has changed" in done.data
    assert "its position is unknown" in lmctl("machine", "doctor", "-m", cell).data


def test_offsets_are_shown_and_cleared(lmctl, refused, active):
    cell = active()
    assert lmctl("machine", "offset", "X5", "Y6", "-m", cell).code == 0
    shown = lmctl("machine", "offset", "-m", cell)
    assert shown.data.startswith("program zero lies at X 5.000  Y 6.000  Z 0.000 mm")
    assert "  G54  5.000,6.000,0.000" in shown.data
    cleared = lmctl("machine", "offset", "--clear", "Z-1", "-m", cell)
    assert cleared.data == "program zero lies at X 5.000  Y 6.000  Z -1.000 mm of the machine\n"
    assert "--here needs" in refused("machine", "offset", "--here", "-m", cell, code=2)


def test_behind_a_watchdog_relay_settings_can_be_read_all_the_same(lmctl):
    examples = files("lmctl.examples")
    shown = lmctl("machine", "settings", "--sim", "-m", examples / "cell-safe.toml",
                  "--bench", examples / "bench-safe.toml")
    assert shown.code == 0, shown.talk
    assert "laser mode" in shown.data


@pytest.mark.parametrize(("words", "told"), [
    (("settings", "--sim"), "does not report its settings in state Hold"),
    (("offset", "--sim"), "does not report its offsets in state Hold"),
])
def test_a_controller_that_reports_nothing_but_its_state(refused, monkeypatch, words, told):
    async def looked_at(endpoint, *, baud):
        return SimpleNamespace(report=SimpleNamespace(state="Hold"), identity=None, settings={},
                               offset_mm=None)

    monkeypatch.setattr("lmctl.machine.manual.inspect_motion.inspect_controller", looked_at)
    monkeypatch.setattr("lmctl.cli.machine_actions._look", lambda *_: SimpleNamespace(
        motion=SimpleNamespace(report=SimpleNamespace(state="Hold"), offset_mm=None)))
    talk = refused("machine", *words, code=4)
    assert told in talk
    assert "lmctl machine doctor" in talk
