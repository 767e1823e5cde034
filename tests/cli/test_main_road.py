"""The road a user goes: init, check, plan, show, run, log, jobs; each command's data and files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.part_files import block_file

Lmctl = Callable[..., object]

BLOCK = block_file((14, 10, 1.6), name="graded block", composition="""
feature = { kind = "coordinate", along = "x" }
profile = { kind = "linear", near = { "316L" = 0.8, "WC-12Co" = 0.2 }, \
far = { "316L" = 0.3, "WC-12Co" = 0.7 }, over_mm = [0, 14] }
""")


@pytest.fixture
def planned(lmctl: Lmctl, tmp_path: Path) -> dict[str, object]:
    (tmp_path / "block.toml").write_text(BLOCK)
    outcome = lmctl("plan", "block.toml", "--json")
    assert outcome.code == 0, outcome.talk
    return outcome.json


def test_a_plan_says_what_it_holds(planned: dict[str, object]) -> None:
    wanted = {"layers", "contours", "vertices", "path_length_mm", "laser_on_s", "duration_s",
              "powder_g", "warnings"}
    assert wanted <= set(planned)
    assert planned["layers"] == 2
    assert set(planned["powder_g"]) == {"316L", "WC-12Co"}
    # 2 layers of 14 × 10 mm in strips of 1.334 mm
    assert planned["path_length_mm"] == pytest.approx(2 * 14 * 10 / 1.334, rel=0.1)
    assert planned["filling"] == pytest.approx(1, abs=0.03)
    volume_rate = 1.334 * 0.8 * 10  # the same at every strip width
    assert planned["laser_on_s"] * volume_rate == pytest.approx(
        planned["deposited_volume_mm3"], rel=0.02)


def test_the_whole_road(lmctl: Lmctl, planned: dict[str, object], tmp_path: Path) -> None:
    run = lmctl("run", "block.lmj", "--sim", "--operator", "A. Person", "--json")
    assert run.code == 0, run.talk
    assert set(run.json) >= {"run", "state", "lines", "machine_s", "wall_s", "journal"}
    assert run.json["state"] == "done"
    assert run.json["lines"] == planned["lines"]
    assert run.json["machine_s"] >= planned["duration_s"]

    log = lmctl("log", run.json["run"])
    assert log.code == 0
    for word in ("DONE", "graded block", "A. Person", "316L", "WC-12Co", "whole and sealed"):
        assert word in log.data, word
    assert max(map(len, log.data.splitlines())) <= 80

    journal = lmctl("log", run.json["run"], "--json").json
    assert journal["sealed"] is True
    assert journal["records"][0]["kind"] == "header"
    assert journal["records"][-1]["kind"] == "seal"
    on_disk = (tmp_path / "runs" / "run-0001" / "journal.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in on_disk] == journal["records"]

    rows = list(csv.DictReader(io.StringIO(lmctl("log", run.json["run"], "--csv").data)))
    assert [row["layer"] for row in rows] == ["1", "2"]
    assert sum(float(row["reported_A_g"]) for row in rows) > 0

    assert lmctl("log", run.json["run"], "--verify").code == 0
    listed = lmctl("jobs", "--json").json
    assert [job["job"] for job in listed["jobs"]] == ["block.lmj"]
    assert [(r["run"], r["state"]) for r in listed["runs"]] == [("run-0001", "done")]


def test_any_byte_changed_in_a_journal_is_found(
    lmctl: Lmctl, planned: dict[str, object], tmp_path: Path
) -> None:
    assert lmctl("run", "block.lmj", "--sim").code == 0
    journal = tmp_path / "runs" / "run-0001" / "journal.jsonl"
    whole = journal.read_bytes()
    for place in range(0, len(whole), len(whole) // 40):
        journal.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        outcome = lmctl("log", "run-0001", "--verify")
        assert outcome.code == 1, place
        assert "Traceback" not in outcome.talk


def test_a_layer_as_a_picture(lmctl: Lmctl, planned: dict[str, object], tmp_path: Path) -> None:
    for name, head in (("layer.png", b"\x89PNG"), ("layer.svg", b"<?xml")):
        outcome = lmctl("show", "block.lmj", "--layer", 2, "-o", name)
        assert outcome.code == 0, outcome.talk
        assert outcome.data.strip() == name
        assert (tmp_path / name).read_bytes().startswith(head)


@pytest.mark.parametrize("template", ["gear", "box", "sphere"])
def test_every_template_is_whole(lmctl: Lmctl, tmp_path: Path, template: str) -> None:
    assert lmctl("init", template, "here").code == 0
    part = tmp_path / "here" / f"{template}.toml"
    assert lmctl("check", part, "--machine", tmp_path / "here" / "cell.toml").code == 0
    assert lmctl("check", tmp_path / "here" / "cell.toml").code == 0
    again = lmctl("init", template, "here")
    assert again.code == 2  # nothing of the user's is overwritten
    assert "--force" in again.talk


def test_help_of_every_command(lmctl: Lmctl) -> None:
    from lmctl.cli.__main__ import COMMANDS

    for name in COMMANDS:
        outcome = lmctl(name, "--help")
        assert outcome.code == 0
        assert outcome.data.startswith(f"Usage: lmctl {name}")


def test_the_same_job_gives_the_same_journal(
    lmctl: Lmctl, planned: dict[str, object], tmp_path: Path
) -> None:
    from lmctl.run.journal.format import run_fingerprint

    prints = set()
    for number in range(1, 7):
        assert lmctl("run", "block.lmj", "--sim").code == 0
        prints.add(run_fingerprint(tmp_path / "runs" / f"run-{number:04d}" / "journal.jsonl"))
    assert len(prints) == 1
