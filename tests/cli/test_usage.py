"""Commands that cannot be meant as they are given: what is wrong, and how it is given instead."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from lmctl.calibration.calibration_file import Calibration, save_calibration
from lmctl.cli.calibrations import stored_calibration
from lmctl.cli.profiles import load_checked_profile
from lmctl.errors import ConfigError
from lmctl.exchange.dialect import parse_dialect
from tests.part.angle_solid import binary_stl
from tests.part_files import block_file

Refused = Callable[..., str]

EXAMPLES = files("lmctl.examples")
CELL, SAFE = ((EXAMPLES / name).read_text("utf-8") for name in ("cell.toml", "cell-safe.toml"))
BENCH = (EXAMPLES / "bench.toml").read_text("utf-8")


def write(**texts: str) -> None:
    """Files in the folder of the test; "cell__toml" is cell.toml."""
    for name, text in texts.items():
        Path(name.replace("__", ".")).write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("words", "code", "facts"),
    [
        ("design a.stl", 2, ("a.stl is no part file", "lmctl init")),
        ("machine status -m cell.toml --bench bench.toml", 2,
         ("--bench belongs to --sim", "add --sim, or leave --bench out")),
        ("run a.lmj -m cell.toml --bench bench.toml", 2,
         ("--bench, --speed and --faults belong to --sim", "add --sim")),
        ("check faults.toml", 2, ("faults.toml is a fault file", "--sim --faults FILE")),
        ("check cell.toml -m cell.toml", 2, ("is checked by itself", "for a part or a job")),
        ("export a.lmj --to 3mf", 2, ("--to 3mf is for parts", "name the part file")),
        ("init box cell.toml/box", 2, ("cannot make the folder", "where you may write")),
        ("init box cell.toml", 2, ("cell.toml is a file, not a folder", "another folder")),
        ("log run-0001 --json --csv", 2, ("exclude each other", "give one of them")),
        ("height", 2, ("MM, or left out with --skip", "lmctl height 8.15")),
        ("height 8 --skip", 2, ("MM, or left out with --skip",)),
        ("simulate a.stl", 2, ("a.stl is no part file", "loads and supports")),
        ("machine catch-test --sim -m brass.toml --material brass", 2,
         ("no recipe is known for a coupon of brass", "--material")),
        ("plan a.toml --machine faults.toml", 3,
         ("is a fault file, and a machine profile is wanted", "--faults FILE")),
    ],
)
def test_it_is_said_how_it_is_given_instead(
    refused: Refused, words: str, code: int, facts: tuple[str, ...]
) -> None:
    write(cell__toml=CELL, bench__toml=BENCH, faults__toml='[[fault]]\nkind = "hard_limit"\n',
          a__lmj="", a__stl="", a__toml=block_file((9, 9, 4)),
          brass__toml=CELL.replace('material = "316L"', 'material = "brass"'))
    told = refused(*words.split(), code=code)
    for fact in facts:
        assert fact in told, told


@pytest.mark.parametrize(
    ("profile", "bench", "facts"),
    [
        (CELL, BENCH.replace("rx_bytes =", "rx_bites ="),
         ("bench.toml does not describe a bench", "rx_bites", "bench-keys.md")),
        (CELL.replace('"F2"', '"F3"'), BENCH, ("the bench has no feeder F3", "it has F1, F2")),
        (SAFE, BENCH, ("no safety device, and the profile has one", "table [safety]")),
    ],
)
def test_a_bench_that_is_not_the_profiles(
    refused: Refused, profile: str, bench: str, facts: tuple[str, ...]
) -> None:
    write(cell__toml=profile, bench__toml=bench)
    told = refused("machine", "status", "--sim", "-m", "cell.toml", "--bench", "bench.toml", code=3)
    for fact in facts:
        assert fact in told, told


def test_simulation_without_its_libraries(refused: Refused, monkeypatch) -> None:
    write(a__toml=block_file((9, 9, 4)))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    told = refused("simulate", "a.toml", code=2)
    assert "simulation needs scikit-fem and pyamg" in told
    assert "lmctl[design]" in told


def test_the_designer_without_its_libraries(refused: Refused, monkeypatch) -> None:
    write(a__toml=block_file((9, 9, 4)))
    monkeypatch.setitem(sys.modules, "lmctl.designer", None)
    told = refused("design", "a.toml", code=2)
    assert "the designer is not installed" in told
    assert "lmctl[web]" in told


def test_a_field_too_large_for_a_file(refused: Refused, monkeypatch) -> None:
    write(a__toml=block_file((9, 9, 4)))
    monkeypatch.setattr("lmctl.report.part_export.MAX_BYTES", 10)
    told = refused("show", "a.toml", "-o", "a.vti", code=1)
    assert "the field would take" in told
    assert "raise pitch_mm" in told


def test_a_dialect_tells_all_its_mistakes() -> None:
    text = (files("lmctl.exchange") / "dialects/plain.toml").read_text("utf-8")
    for old, new in (('"G1"', '"G1 {mm}"'), ('"M3"', '"M3\\nS0"'), ("{seconds:", "{s:")):
        text = text.replace(old, new)
    with pytest.raises(ConfigError) as refused:
        parse_dialect(text, name="own.toml")
    told = refused.value.render()
    for fact in ("own.toml has 3 mistakes", "it may name nothing in braces",
                 "beam_on: holds a line end", "dwell: ", "it may name {seconds}"):
        assert fact in told, told


def test_a_calibration_of_another_machine_is_not_added_to(tmp_path: Path) -> None:
    save_calibration(Calibration(machine="the other cell"), tmp_path / "calibration.json")
    with pytest.raises(ConfigError) as refused:
        stored_calibration(tmp_path / "calibration.json", "this cell")
    assert "of 'the other cell', not of 'this cell'" in refused.value.what
    assert "--output" in refused.value.hint


def test_a_profile_with_more_mistakes_than_are_listed(tmp_path: Path) -> None:
    (tmp_path / "cell.toml").write_text(CELL + "[[hopper]]\nname = 3\n" * 60)
    with pytest.raises(ConfigError) as refused:
        load_checked_profile(tmp_path / "cell.toml")
    assert refused.value.unlisted > 0
    assert refused.value.where[-1].endswith("more")


@pytest.fixture
def ran(recovered_part: Path, tmp_path: Path, refused: Refused) -> Path:
    """The folder of a part of two runs, to be spoilt."""
    shutil.copytree(recovered_part, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_run_that_was_continued_is_not_recovered_again(ran: Path, refused: Refused) -> None:
    told = refused("recover", "run-0001", "--sim", "--yes", code=1)
    assert "run-0001 has been continued by run-0002" in told
    assert "lmctl recover run-0002" in told


def test_a_journal_that_was_cut_off_is_whole_so_far(ran: Path, refused: Refused) -> None:
    journal = ran / "runs/run-0002/journal.jsonl"
    journal.write_text("".join(journal.read_text().splitlines(keepends=True)[:-1]))
    told = refused("log", "run-0002", "--verify", code=1)
    assert "is whole so far, but not sealed" in told
    assert "still going, or was broken off" in told


def test_notes_that_were_altered(ran: Path, refused: Refused, lmctl: Callable[..., Any]) -> None:
    assert lmctl("note", "run-0001", "seen by Carl").code == 0
    notes = next((ran / "runs/run-0001").glob("notes*"))
    notes.write_text(notes.read_text().replace("the plug was loose", "the plug was fixed"))
    told = refused("log", "run-0001", "--verify", code=1)
    assert "the notes of run-0001 do not fit their journal" in told
    assert "restore both from a copy" in told


def test_a_report_of_an_altered_journal(ran: Path, refused: Refused) -> None:
    journal = ran / "runs/run-0002/journal.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    lines.insert(5, '{"t": "soon", "kind": "state"}\n')
    journal.write_text("".join(lines))
    told = refused("report", "run-0002", code=1)
    assert "was damaged or altered, and no report can be made of it" in told
    assert "line 6" in told


def test_a_picture_of_a_layer_in_a_folder_that_is_not_there(ran: Path, refused: Refused) -> None:
    told = refused("show", "part.lmj", "-o", "nowhere/layer.png", code=2)
    assert "there is no folder nowhere" in told
    assert "make it first" in told


def test_a_copy_that_a_job_has_not(ran: Path, refused: Refused) -> None:
    told = refused("report", "run-0002", "--as-built", "--copy", "B", code=1)
    assert "the job has no copy 'B'" in told
    assert "it is of one part" in told


def test_a_comparison_with_data_that_have_gone_or_changed(
    ran: Path, refused: Refused, lmctl: Callable[..., Any]
) -> None:
    mesh = ran / "angle.stl"
    mesh.write_bytes(binary_stl())
    assert lmctl("plan", mesh, "--units", "mm", "-o", "runs/run-0002/job.lmj").code == 0
    mesh.write_bytes(binary_stl(head=b"another"))
    told = refused("report", "run-0002", "--as-built", code=1)
    assert "angle.stl has changed since the part was planned" in told
    assert "planned from" in told
    mesh.unlink()
    told = refused("report", "run-0002", "--as-built", code=2)
    assert "the part's data file angle.stl is not here" in told
    assert "--data" in told


def test_a_comparison_by_an_altered_journal(ran: Path, refused: Refused) -> None:
    journal = ran / "runs/run-0002/journal.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    lines.insert(5, '{"t": 1.0}\n')
    journal.write_text("".join(lines))
    told = refused("report", "run-0002", "--as-built", code=1)
    assert "was damaged or altered, and nothing can be compared by it" in told
    assert "restore the journal from a copy" in told
