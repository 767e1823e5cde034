"""`lmctl machine feeder-test`, and what a profile, a plan, a run and the doctor make of it."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lmctl.calibration import load_calibration, save_calibration
from lmctl.job.reader import JobReader
from lmctl.run.journal.format import read_records
from tests.cli.conftest import CELL

HIDDEN = (("lag_s = 1.0\n", "lag_s = 1.2\n"), ("slope_factor = 1.0 ", "slope_factor = 1.05 "),
          ("noise_rsd = 0.0 ", "noise_rsd = 0.02 "))
USING = "\n[calibration]\n"


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the calibration of a bench whose hopper A is not as the profile says."""
    from lmctl.cli.__main__ import main
    from tests.cli.conftest import BENCH

    folder = tmp_path_factory.mktemp("measured")
    text = BENCH
    for old, new in HIDDEN:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "bench.toml").write_text(text)
    (folder / "cell.toml").write_text(CELL)
    assert main(["machine", "feeder-test", "--sim", "--bench", str(folder / "bench.toml"),
                 "--machine", str(folder / "cell.toml"), "--hopper", "A", "--limit", "200",
                 "--runs", str(folder / "runs"), "--operator", "Ada", "--json"]) == 0
    (folder / "cell.toml").write_text(CELL + USING)
    return folder


def test_a_feeder_test_writes_what_it_found_and_journals_it(measured: Path) -> None:
    found = load_calibration(measured / "calibration.json")
    (hopper,) = found.hopper
    for value, truth in ((hopper.dead_time_s, 3.0), (hopper.lag_s, 1.2), (hopper.slope, 1.05)):
        assert value.value == pytest.approx(truth, abs=2 * value.half_width)
    assert hopper.slope.half_width < 0.02
    assert hopper.conditions.by == "Ada"
    assert (measured / "feeder-test-A.png").stat().st_size > 10_000
    (record,) = [r for r in read_records(measured / "runs/machine-bench-cell-simulated.jsonl")
                 if r["kind"] == "measured"]
    assert (record["hopper"], record["digest"]) == ("A", found.digest)


def test_plan_and_doctor_use_and_name_it(lmctl, measured: Path, tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_text(
        'name = "block"\n[[material]]\nname = "316L"\n[[body]]\nkind = "box"\n'
        "low_mm = [0, 0, 0]\nhigh_mm = [8, 6, 0.8]\n")
    cell = measured / "cell.toml"
    planned = lmctl("plan", "part.toml", "-m", cell, "-o", "part.lmj")
    digest = load_calibration(measured / "calibration.json").digest
    assert digest[:12] in planned.data
    assert "hopper B: it has no feeder test" in planned.talk.replace("\n  ", " ")
    with JobReader(tmp_path / "part.lmj") as job:
        assert job.manifest.calibration is not None
        assert job.manifest.calibration["digest"] == digest
        (hopper,) = job.manifest.hoppers
        assert hopper.lag_s == pytest.approx(1.2, abs=0.1)
    assert lmctl("run", "part.lmj", "--sim", "-m", cell, "--bench", measured / "bench.toml",
                 "--operator", "").code == 0
    (journal,) = (tmp_path / "runs").glob("*/journal.jsonl")
    header = next(iter(read_records(journal)))
    assert header["calibration"]["digest"] == digest
    assert header["hoppers"][0]["slope"] == pytest.approx(1.05, abs=0.02)
    assert "calibration" in lmctl("log", journal.parent).data
    doctor = lmctl("machine", "doctor", "--sim", "-m", cell)
    assert digest[:12] in doctor.data
    assert doctor.code == 1  # hopper B was not tested
    checked = lmctl("check", cell)
    assert (checked.code, digest[:12] in checked.data) == (0, True)
    assert "hopper B: it has no feeder test" in checked.talk.replace("\n  ", " ")


def test_an_old_calibration_refuses(refused, measured: Path, tmp_path: Path) -> None:
    found = load_calibration(measured / "calibration.json")
    (hopper,) = found.hopper
    old = (datetime.now(UTC) - timedelta(days=100)).isoformat()
    aged = hopper.model_copy(update={
        "conditions": hopper.conditions.model_copy(update={"measured": old})})
    save_calibration(found.with_hopper(aged), tmp_path / "calibration.json")
    (tmp_path / "cell.toml").write_text(CELL + USING)
    for told in (refused("plan", measured / "cell.toml", "-m", "cell.toml", code=3),
                 refused("check", "cell.toml", code=3)):
        assert "100 days ago" in told
        assert "feeder-test" in told


def test_wrong_names_and_missing_scales_are_refused(refused, tmp_path: Path) -> None:
    assert "no hopper Z" in refused("machine", "feeder-test", "--sim", "--hopper", "Z", code=2)
    (tmp_path / "cell.toml").write_text(CELL.partition("[scale]")[0])
    assert "no catch scale" in refused("machine", "feeder-test", "--sim", "-m", "cell.toml", code=3)
    (tmp_path / "calibration.json").write_text(json.dumps({"format": "x"}))
    assert "known format" in refused("machine", "feeder-test", "--sim", code=3)
