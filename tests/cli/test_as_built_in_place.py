"""`lmctl report --as-built` of copies, and of a part on a substrate that is not flat."""

import math

import pytest

PROCESS = """
[process]
max_power_W = 3000
bead_width_mm = 2.0
power_W = 1500
speed_mm_s = 10
"""
#: A wall a millimetre thicker than two beads; the second copy stands across.
COPIES = """
name = "wall"
[[material]]
name = "316L"
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [14, 6, 1.6]
[[copy]]
name = "S1"
position_mm = [0, 0]
[[copy]]
name = "S2"
position_mm = [40, 0]
turn_deg = 90
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
"""
#: A shaft of radius 25, and what is deposited on 16 mm of its width.
SHAFT = """
name = "strip"
[[material]]
name = "316L"
[[body]]
name = "clad"
kind = "cylinder"
base_mm = [-1, 0, 0]
top_mm = [21, 0, 0]
radius_mm = 26.6
[[body]]
name = "window"
kind = "box"
low_mm = [0, -8, 0]
high_mm = [20, 8, 40]
[[body]]
kind = "intersection"
of = ["clad", "window"]
[placement]
origin_mm = [100, 100, -20]
[substrate]
kind = "cylinder"
point_mm = [0, 0, 0]
radius_mm = 25
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
"""


def planned_and_run(lmctl, folder, part: str, process: str) -> None:
    """A run whose voxel map is there."""
    assert lmctl("init", "box", ".").code == 0
    bench = folder / "bench.toml"
    bench.write_text(bench.read_text() + process)
    (folder / "part.toml").write_text(part)
    for arguments in (["plan", "part.toml", "--machine", "cell.toml"],
                      ["run", "part.lmj", "--sim", "--bench", "bench.toml"]):
        outcome = lmctl(*arguments)
        assert outcome.code == 0, outcome.talk


def test_each_copy_is_compared_with_the_design_in_its_place(lmctl, tmp_path):
    planned_and_run(lmctl, tmp_path, COPIES, PROCESS)
    found = lmctl("report", "run-0001", "--as-built", "--json").json["copies"]
    assert list(found) == ["S1", "S2"]
    for one in found.values():
        assert one["design_mm3"] == pytest.approx(14 * 6 * 1.6, rel=0.03)
        assert one["built_over_design"] == pytest.approx(1.0, abs=0.05)
        assert one["surplus_mm3"] < 0.15 * one["design_mm3"]  # a copy apart would be all surplus
    text = lmctl("report", "run-0001", "--as-built").data
    assert "wall, S1: as built" in text
    assert "wall, S2: as built" in text
    alone = lmctl("report", "run-0001", "--as-built", "--copy", "S2", "--json").json
    assert alone == found["S2"]
    wrong = lmctl("report", "run-0001", "--as-built", "--copy", "S3")
    assert wrong.code == 1
    assert "they are S1, S2" in wrong.talk
    assert "name one with --copy" in lmctl("report", "run-0001", "--as-built", "-o", "x.png").talk

    # without the map the same is predicted
    (tmp_path / "runs" / "run-0001" / "voxel-map.npz").unlink()
    predicted = lmctl("report", "run-0001", "--as-built", "--copy", "S2", "--json").json
    assert predicted["built_by"] == "predicted"
    assert predicted["built_over_design"] == pytest.approx(1.0, abs=0.05)


def test_a_strip_on_a_shaft_is_compared_without_the_shaft(lmctl, tmp_path):
    """The bench has the shaft in rows of heights; the part's origin is the axis, 20 mm below 0."""
    heights = [round(math.sqrt(625 - y * y) - 20, 4) for y in range(-20, 21)]
    rows = [[height, height] for height in heights]
    lowest = min(heights)
    process = PROCESS + f"substrate_z_mm = {lowest}\n" + (
        "[process.substrate_heights]\nx_mm = 60\ny_mm = 80\npitch_mm = 1\n"
        f"rows_mm = {[[round(v - lowest, 4) for v in row + row * 50] for row in rows]}\n")
    planned_and_run(lmctl, tmp_path, SHAFT, process)
    exact = 20 * (_cap(26.6) - _cap(25.0))
    for built_by in ("simulated", "predicted"):
        found = lmctl("report", "run-0001", "--as-built", "--json").json
        assert found["built_by"] == built_by
        assert found["design_mm3"] == pytest.approx(exact, rel=0.03)
        assert found["built_over_design"] == pytest.approx(1.0, abs=0.05)
        assert found["surplus_mm3"] < 0.15 * exact
        if built_by == "simulated":
            assert found["layers"][0]["built_mm"] == pytest.approx(0.8, abs=0.1)
            (tmp_path / "runs" / "run-0001" / "voxel-map.npz").unlink()


def _cap(radius: float) -> float:
    """Area between a round and its axis over 16 mm of width."""
    return 8 * math.sqrt(radius**2 - 64) + radius**2 * math.asin(8 / radius)


def test_dilution_from_a_shaft_is_in_the_first_layer_only(lmctl, tmp_path):
    """Steel on a carbide shaft: what is fed is steel, and a fifth of the first layer is not."""
    part = SHAFT.replace('name = "316L"\n', 'name = "316L"\n[[material]]\nname = "WC-12Co"\n', 1)
    part = part.replace("radius_mm = 25\n", 'radius_mm = 25\nmaterial = "WC-12Co"\n')
    part += ('[composition]\nfeature = { kind = "coordinate", along = "x" }\n'
             '[composition.profile]\nkind = "constant"\nof = { "316L" = 0.5, "WC-12Co" = 0.5 }\n')
    assert lmctl("init", "box", ".").code == 0
    cell = tmp_path / "cell.toml"
    cell.write_text(cell.read_text() + "[[dilution]]\nshare = 0.2\n")
    (tmp_path / "part.toml").write_text(part)
    planned = lmctl("plan", "part.toml", "--machine", "cell.toml", "--json")
    assert planned.code == 0, planned.talk
    assert lmctl("run", "part.lmj", "--machine", "cell.toml", "--sim").code == 0
    found = lmctl("report", "run-0001", "--as-built", "--json").json
    assert found["built_by"] == "predicted"
    # fed (0.5 - 0.2 · 1) / 0.8 = 0.375 carbide in the first layer, 0.5 in the second
    assert found["by_path"]["within"]["0.02"] > 0.98
