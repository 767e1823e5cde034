"""`lmctl report --as-built`, from a run on a bench with a process."""

import json

import pytest

from tests.cli.conftest import LINK_CUT

PROCESS = """
[process]
max_power_W = 3000
bead_width_mm = 2.0
power_W = 1500
speed_mm_s = 10
"""


@pytest.fixture
def built(lmctl, box, tmp_path):
    """A run whose voxel map is there."""
    bench = tmp_path / "bench.toml"
    bench.write_text(bench.read_text() + PROCESS)
    outcome = lmctl("run", box, "--sim", "--bench", bench)
    assert outcome.code == 0, outcome.talk
    return tmp_path / "runs" / "run-0001"


def test_the_figures_of_a_build(lmctl, built, tmp_path):
    assert (built / "voxel-map.npz").is_file()
    found = lmctl("report", "run-0001", "--as-built", "--json").json
    assert found["built_by"] == "simulated"
    assert found["design_mm3"] == pytest.approx(12 * 8 * 0.8, rel=0.01)
    assert found["built_over_design"] == pytest.approx(1.0, abs=0.05)
    assert found["by_path"]["within"]["0.02"] > 0.9
    for one in found["balance"]:  # weighed to 0.1 g at every layer and purge
        assert abs(one["unaccounted_g"]) < 0.4
    text = lmctl("report", "run-0001", "--as-built").data
    assert "as built by the simulated process" in text
    assert "316L" in text
    # what the file cannot be written as, and what does not go together
    for arguments in (["-o", "x.foo"], ["-l", "9", "-o", "x.png"], ["-l", "1"],
                      ["-l", "1", "-l", "1", "-o", "x.png"], ["--csv"]):
        assert lmctl("report", "run-0001", "--as-built", *arguments).code == 2
    assert lmctl("report", "run-0001", "--layer", "1").code == 2

    # without the map the same is predicted, and marked so
    (built / "voxel-map.npz").unlink()
    predicted = lmctl("report", "run-0001", "--as-built", "--json").json
    assert predicted["built_by"] == "predicted"
    assert predicted["core_void"] is None
    assert predicted["balance"] == []
    assert predicted["built_over_design"] == pytest.approx(found["built_over_design"], abs=0.03)
    assert predicted["by_path"]["within"]["0.02"] == pytest.approx(
        found["by_path"]["within"]["0.02"], abs=0.05)
    assert "not measured" in lmctl("report", "run-0001", "--as-built").data


def test_a_folder_receives_all_forms(lmctl, built, tmp_path):
    outcome = lmctl("report", "run-0001", "--as-built", "-o", "out", "-l", "1")
    assert outcome.code == 0, outcome.talk
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["as-built.json", "as-built.txt", "as-built.vti", "layer-0001.png"]
    assert json.loads((tmp_path / "out" / "as-built.json").read_text())["by_volume"]
    head = (tmp_path / "out" / "as-built.vti").read_bytes()[:3000].decode("ascii", "ignore")
    assert 'Name="designed 316L"' in head
    assert 'Name="built WC-12Co"' in head


def test_a_damaged_map_is_reported(lmctl, built):
    (built / "voxel-map.npz").write_bytes(b"PK")
    outcome = lmctl("report", "run-0001", "--as-built")
    assert outcome.code == 1
    assert "not a voxel map, or is damaged" in outcome.talk
    assert "Traceback" not in outcome.talk


def test_a_bench_without_process_leaves_no_map(lmctl, box, tmp_path):
    assert lmctl("run", box, "--sim").code == 0
    assert not (tmp_path / "runs" / "run-0001" / "voxel-map.npz").exists()


def test_a_part_of_two_runs_is_predicted_from_both(lmctl, box, tmp_path):
    """A run is cut off in its path, another goes on; on a machine nothing maps what is there."""
    (tmp_path / "faults.toml").write_text(LINK_CUT)
    assert lmctl("run", box, "--sim", "--faults", "faults.toml").code == 5
    alone = lmctl("report", "run-0001", "--as-built", "--json").json
    assert alone["built_over_design"] < 0.7
    recovered = lmctl("recover", "run-0001", "--sim", "--yes", "--position-restored",
                      "--deposited=0")
    assert recovered.code == 0, recovered.talk
    both = lmctl("report", "run-0002", "--as-built", "--json").json
    assert lmctl("report", "run-0001", "--as-built", "--json").json == both
    assert lmctl("run", box, "--sim", "--runs", "whole").code == 0
    whole = lmctl("report", "run-0001", "--as-built", "--json", "--runs", "whole").json
    assert both["built_by"] == whole["built_by"] == "predicted"
    assert both["built_over_design"] == pytest.approx(whole["built_over_design"], abs=0.03)
    assert both["missing_mm3"] == pytest.approx(whole["missing_mm3"], abs=3.0)


def on_bench(tmp_path, *changes):
    """A bench with a process and another truth. changes : (old, new) in its text, each once"""
    text = (tmp_path / "bench.toml").read_text() + PROCESS
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (tmp_path / "hidden.toml").write_text(text)
    return tmp_path / "hidden.toml"


def test_a_truth_that_makes_the_build_impossible_is_said_and_shown(lmctl, box, tmp_path):
    """A tenth of the powder stays on the part: the run cannot know it, the comparison says it."""
    bench = on_bench(tmp_path, ("catch_efficiency = 0.75", "catch_efficiency = 0.075"),
                     ("catch_efficiency = 0.55", "catch_efficiency = 0.055"))
    assert lmctl("run", box, "--sim", "--bench", bench).code == 0
    found = lmctl("report", "run-0001", "--as-built", "--json").json
    assert found["built_over_design"] == pytest.approx(0.1, abs=0.02)
    assert found["missing_mm3"] == pytest.approx(0.9 * found["design_mm3"], rel=0.05)
    assert found["by_path"]["within"]["0.02"] > 0.9  # both alike: the mixture is right
    text = lmctl("report", "run-0001", "--as-built").data
    assert "missing" in text
