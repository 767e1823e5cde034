"""`run --sim --faults`: the simulated cell fails as a file says, and the run ends as it should."""

from importlib.resources import files

FAULTS = """
[[fault]]
kind = "panel_override"
feed = 110
at_s = 5

[[fault]]
kind = "hard_limit"
at_line = 40
"""


def test_faults_happen_end_the_run_and_are_listed(lmctl, box, tmp_path):
    (tmp_path / "faults.toml").write_text(FAULTS)
    ended = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert ended.code != 0
    (listed,) = [line for line in ended.talk.splitlines() if line.startswith("faults injected")]
    assert listed.startswith("faults injected: panel_override (feed 110) at 5.000 s, hard_limit at")
    assert "hard limit" in ended.talk.partition("error:")[2]
    assert ended.data == ""


def test_faults_that_never_come_are_said_not_to_have_come(lmctl, box, tmp_path):
    (tmp_path / "faults.toml").write_text('[[fault]]\nkind = "estop"\nat_line = 9000000\n')
    ended = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert ended.code == 0, ended.talk
    assert "faults injected: none" in ended.talk


def test_every_mistake_in_a_fault_file_at_once(refused, tmp_path, lmctl):
    (tmp_path / "job.lmj").write_bytes(b"")
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "dor"\nat_s = 1\n[[fault]]\nkind = "disc_stalls"\ndevice = "F9"\n')
    talk = refused("run", "job.lmj", "--sim", "--faults", "faults.toml", code=3)
    assert "faults.toml has 3 mistakes" in talk
    assert "fault[1].kind: there is no fault 'dor'; 'door'?" in talk
    assert "fault[2].device: there is no 'F9'" in talk
    assert "fault[2]: needs one of at_s, at_line, at_level_g" in talk
    assert "faults injected" not in talk


def test_a_fault_file_that_is_not_there_or_not_for_a_real_machine(refused, tmp_path):
    (tmp_path / "job.lmj").write_bytes(b"")
    refused("run", "job.lmj", "--sim", "--faults", "nothing.toml", code=2)
    refused("run", "job.lmj", "--machine", "cell.toml", "--faults", "faults.toml", code=2,
            hint=False)


def test_of_a_controller_that_is_gone_no_one_says_that_the_beam_is_off(lmctl, box, tmp_path):
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "link_closed"\ndevice = "motion"\nat_line = 40\n')
    ended = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert ended.code == 5, ended.talk
    assert "beam and motion were not seen to stop: look at the machine" in ended.talk
    assert "beam off" not in ended.talk
    assert "powder was" not in ended.talk


def test_of_a_feeder_that_is_silent_no_one_says_that_its_powder_stopped(lmctl, box, tmp_path):
    (tmp_path / "faults.toml").write_text(
        '[[fault]]\nkind = "device_silent"\ndevice = "F1"\nat_line = 40\n'
        '[[fault]]\nkind = "hard_limit"\nat_line = 44\n')
    ended = lmctl("run", box, "--sim", "--faults", "faults.toml")
    assert ended.code == 5, ended.talk
    assert "powder was not seen to stop" in ended.talk
    assert "gas was not seen to go off" in ended.talk
    assert "beam off, motion held at" in ended.talk


def test_a_cell_that_is_not_ready_is_said_to_be_untouched_and_doctor_says_so_before(
    lmctl, box, tmp_path
):
    cell, bench = (files("lmctl.examples") / name for name in ("cell-safe.toml", "bench-safe.toml"))
    (tmp_path / "hot.toml").write_text(
        cell.read_text().replace("chiller_max_C = 25", "chiller_max_C = 20")
        .replace("oxygen_warn_ppm = 500", "oxygen_warn_ppm = 10"))
    (tmp_path / "bench-safe.toml").write_text(bench.read_text())
    where = ("--sim", "-m", "hot.toml", "--bench", "bench-safe.toml")
    ended = lmctl("run", box, *where)
    assert ended.code == 4, ended.talk
    assert "the chiller is at 22 °C, 20 °C is allowed" in ended.talk
    assert "beam off" not in ended.talk
    looked = lmctl("machine", "doctor", *where)
    assert looked.code == 4
    assert "✗ the chiller is at 22 °C, 20 °C is allowed" in looked.data
    assert "✗ oxygen is at 20 ppm, a warning from 10 ppm on" in looked.data
    assert "every fitted input" not in looked.data
