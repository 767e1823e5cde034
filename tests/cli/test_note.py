"""`lmctl note`, and the log of a part that took two runs."""

from __future__ import annotations

import pytest

from lmctl.cli.__main__ import main
from lmctl.config.machine import load_profile
from tests.run.conftest import squares, write_job

FAULTS = '[[fault]]\nkind = "hard_limit"\nat_line = 40\n'


@pytest.fixture(scope="module")
def two_runs(tmp_path_factory):
    """The folder of a part whose first run met a limit switch, and whose second went on."""
    folder = tmp_path_factory.mktemp("part")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("LMCTL_OPERATOR", "Ada")
        assert main(["init", "gear", "."]) == 0
        write_job(folder / "part.lmj", load_profile(folder / "cell.toml"), squares())
        (folder / "faults.toml").write_text(FAULTS)
        assert main(["run", "part.lmj", "--sim", "--faults", "faults.toml"]) == 5
        assert main(["recover", "run-0001", "--sim", "--yes", "--position-restored",
                     "--operator", "Bob"]) == 0
    return folder


@pytest.fixture
def in_folder(two_runs, lmctl, monkeypatch):
    monkeypatch.chdir(two_runs)
    return lmctl


def test_any_run_of_a_part_prints_the_log_of_all_of_them(in_folder):
    logs = [in_folder("log", run).data for run in ("run-0001", "run-0002")]
    assert logs[0] == logs[1]
    assert max(map(len, logs[0].splitlines())) <= 80
    text = " ".join(logs[0].split())
    assert "faulted" in text
    assert "DONE" in text
    assert "Ada (user" in text
    assert "Bob (user" in text
    assert "events of run-0001" in text
    assert "events of run-0002" in text
    rows = in_folder("log", "run-0002", "--csv").data.splitlines()
    assert [row.split(",")[0] for row in rows] == ["layer", "1", "2"]
    assert rows[1].split(",")[4] == rows[2].split(",")[4] == "yes"
    alone = in_folder("log", "run-0001", "--run-only").data
    assert "events of run-0002" not in alone
    assert "partial" in alone


def test_digests_are_whole(in_folder):
    journal = in_folder("log", "run-0001", "--json").json
    header = journal["records"][0]
    text = in_folder("log", "run-0001").data
    for key in ("job", "part_sha256", "profile"):
        assert len(header[key]) == 64
        assert header[key] in text


def test_a_deviation_gets_its_reason_and_disposition(in_folder, refused):
    log = in_folder("log", "run-0001").data
    assert "no disposition yet" in log
    journal = in_folder("log", "run-0001", "--json").json
    fault = next(r["seq"] for r in journal["records"] if r["kind"] == "fault")
    noted = in_folder("note", "run-0001", "a chip lay on the switch", "--about", fault,
                      "--disposition", "accepted", "--operator", "Ada")
    assert noted.code == 0
    log = " ".join(in_folder("log", "run-0002").data.split())
    assert "accepted: a chip lay on the switch (Ada, " in log
    assert in_folder("log", "run-0001", "--verify").code == 0
    assert "has no record 99999" in refused("note", "run-0001", "what?", "--about", 99999, code=1)
    assert "a note has a text" in refused("note", "run-0001", " ", code=2)
