"""Several copies on a plate: where their beads lie, in which order, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.config.machine import load_profile
from lmctl.config.nozzle import NozzleSettings
from lmctl.errors import ConfigError, PlanError
from lmctl.job.schema import LineKind
from lmctl.part.copies import composition_of_copies
from lmctl.part.load import load_part
from lmctl.plan.layer_range import place_layers
from lmctl.plan.planner import plan_job
from lmctl.preflight.copies_check import convex_hull, hull_gap_mm
from tests.plan.planned_jobs import layers_of

CELL = load_profile(Path(__file__).parents[2] / "lmctl" / "examples" / "cell.toml")
SLIM = CELL.model_copy(update={"nozzle": NozzleSettings(
    standoff_mm=1, tip_diameter_mm=6, half_angle_deg=45)})

#: Left half of one mixture, right half of another: two tracks or more a layer, and one change.
PART = """
name = "peg"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
name = "left"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [8, 10, {height}]
composition.profile = {{ kind = "constant", of = {{ "316L" = 0.9, "WC-12Co" = 0.1 }} }}
[[body]]
name = "right"
kind = "box"
low_mm = [8, 0, 0]
high_mm = [16, 10, {height}]
composition.profile = {{ kind = "constant", of = {{ "316L" = 0.3, "WC-12Co" = 0.7 }} }}
[[body]]
kind = "union"
of = ["left", "right"]
{copies}
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
strategy = "iso-composition"
{process}
"""
ROW = '[[copy]]\nname = "A"\nposition_mm = [0, 0]\ncount = [2, 1]\nspacing_mm = [{apart}, 10]\n'
TURNED = '[[copy]]\nname = "T"\nposition_mm = [70, 5]\nturn_deg = 90\n'


def peg(folder: Path, copies: str = "", process: str = "", height: float = 1.6) -> Path:
    file = folder / "peg.toml"
    file.write_text(PART.format(copies=copies, process=process, height=height))
    return file


def planned(folder: Path, copies: str = "", process: str = "", profile=CELL, height: float = 1.6):
    job = folder / "peg.lmj"
    plan_job(load_part(peg(folder, copies, process, height)), profile, job)
    return layers_of(job)


def refusal(folder: Path, copies: str, process: str = "", profile=CELL, height: float = 1.6) -> str:
    with pytest.raises(PlanError) as caught:
        place_layers(load_part(peg(folder, copies, process, height)), profile)
    return caught.value.render()


def bead_places(layer) -> tuple[np.ndarray, np.ndarray]:
    """Middle (n, 2) and length of every bead line."""
    at = np.stack([layer.lines["x_mm"], layer.lines["y_mm"]], axis=1)
    rows = np.flatnonzero(layer.lines["kind"] == LineKind.BEAD)
    begin, end = at[rows - 1], at[rows]
    return (begin + end) / 2, np.linalg.norm(end - begin, axis=1)


def test_each_copy_is_deposited_where_and_as_it_stands(tmp_path):
    alone, _ = planned(tmp_path)
    manifest, layers = planned(tmp_path, ROW.format(apart=30) + TURNED)
    assert [one["name"] for one in manifest.totals["copies"]] == ["A1", "A2", "T"]
    assert manifest.totals["path_length_mm"] == pytest.approx(
        3 * alone.totals["path_length_mm"], rel=0.002)
    assert manifest.totals["built_fraction"] == alone.totals["built_fraction"]
    assert len(layers) == 2
    for layer in layers:
        middle, length = bead_places(layer)
        shares = []
        for one in manifest.totals["copies"]:
            own = middle - [one["x_mm"], one["y_mm"]]
            if one["turn_deg"]:
                own = np.column_stack([own[:, 1], -own[:, 0]])
            inside = ((own > 0) & (own < [16, 10])).all(axis=1)
            shares.append(length[inside].sum())
            # seams differ, the area covered does not: the middle of all beads is that of the part
            assert np.average(own[inside], axis=0, weights=length[inside]) == pytest.approx(
                [8, 5], abs=0.15)
        assert sum(shares) == pytest.approx(length.sum())
        assert shares == pytest.approx([shares[0]] * 3, rel=0.01)


def test_a_layer_changes_its_mixture_once_for_all_copies(tmp_path):
    _, layers = planned(tmp_path, ROW.format(apart=30) + TURNED)
    for layer in layers:
        beads = layer.lines[layer.lines["kind"] == LineKind.BEAD]
        hard = beads["fractions"][:, 1] > 0.4
        assert (np.diff(hard.astype(int)) != 0).sum() == 1
    by_hand = [layer.lines["fractions"][layer.lines["kind"] == LineKind.BEAD][[0, -1], 1]
               for layer in layers]
    assert by_hand[0][1] == pytest.approx(by_hand[1][0], abs=0.01)  # the next layer goes back


def test_part_by_part_each_copy_is_finished_and_then_cleared(tmp_path):
    manifest, layers = planned(tmp_path, ROW.format(apart=40), 'copy_order = "part-by-part"', SLIM)
    assert [round(layer.z_mm, 3) for layer in layers] == [0.8, 1.6, 0.8, 1.6]
    assert [entry.index for entry in manifest.layers] == [0, 1, 2, 3]
    for layer, copy in zip(layers, (0, 0, 1, 1), strict=True):
        middle, _ = bead_places(layer)
        origin = manifest.totals["copies"][copy]
        assert (middle[:, 0] > origin["x_mm"]).all()
        assert (middle[:, 0] < origin["x_mm"] + 16).all()
    # between the copies the nozzle crosses with its clearance over the finished one
    lines = layers[2].lines
    at = np.stack([lines[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
    far = np.hypot(*np.diff(at[:, :2], axis=0).T) > 1.0
    crossing = far & (lines["kind"] == LineKind.TRAVEL)[1:] & (lines["path"][1:] < 0)
    first_bead = int(np.argmax(lines["kind"] == LineKind.BEAD))
    assert crossing[:first_bead].any()
    assert at[1:][:first_bead][crossing[:first_bead], 2].min() >= 1.6 + CELL.motion.clearance_mm


def test_a_grid_numbers_its_copies_and_names_are_kept_apart(tmp_path):
    part = load_part(peg(tmp_path, '[[copy]]\nposition_mm = [0, 0]\ncount = [2, 2]\n'
                                   'spacing_mm = [30, 20]\n[[copy]]\nname = "S7"\n'
                                   'position_mm = [70, 0]\ncount = [1, 2]\nspacing_mm = [9, 20]\n'))
    assert [copy.name for copy in part.copies] == [
        "copy 1", "copy 2", "copy 3", "copy 4", "S7-1", "S7-2"]
    assert part.copies[2].position_mm == (0, 20)


def test_each_place_has_the_composition_of_its_own_copy(tmp_path):
    part = load_part(peg(tmp_path, ROW.format(apart=30) + TURNED))
    at = composition_of_copies(part)(np.array(
        [[3.0, 5, 1], [13, 5, 1], [33, 5, 1], [43, 5, 1], [65, 8, 1], [65, 18, 1]]))
    assert at[:, 1] == pytest.approx([0.1, 0.7, 0.1, 0.7, 0.1, 0.7])


def test_copies_that_overlap_are_refused_by_name(tmp_path):
    assert "'A1' and 'A2' overlap by 4.0 mm" in refusal(tmp_path, ROW.format(apart=12))
    assert "'A1' and 'A2' are 1.0 mm apart" in refusal(tmp_path, ROW.format(apart=17))
    told = refusal(tmp_path, ROW.format(apart=30) + TURNED.replace("70, 5", "25, 5"))
    assert "'A1' and 'T' overlap by 1.0 mm" in told
    assert "'A2'" not in told


def test_of_many_pairs_in_each_others_way_the_first_are_named(tmp_path):
    told = refusal(tmp_path, ROW.format(apart=2).replace("count = [2, 1]", "count = [6, 1]"))
    assert "'A1' and 'A2' overlap by 10.0 mm" in told
    assert "and 5 more pairs" in told


def test_copies_beyond_the_travel_are_refused_by_name(tmp_path):
    told = refusal(tmp_path, ROW.format(apart=30) + "[placement]\norigin_mm = [265, 10, 0]\n")
    assert "'A2', x: needs 295.0 to 311.0 mm, has 0 to 300" in told
    assert "'A1'" not in told


@pytest.mark.parametrize(
    ("apart", "profile", "height", "told"),
    [
        (40, CELL, 1.6, "state [nozzle] in the machine profile"),
        # 8 layers: 5.6 mm above the first, 4.6 above the tip: 3 + 4.6 mm beside the axis
        (23, SLIM, 6.4, "'A1' stands 7.0 mm beside 'A2'"),
        (60, SLIM, 24.0, "would cross finished copies at 20.0 mm; they are 24.0 mm tall"),
    ],
    ids=["no nozzle", "too near", "too tall"],
)
def test_part_by_part_is_refused_where_the_nozzle_would_not_clear(
    tmp_path, apart, profile, height, told
):
    copies, process = ROW.format(apart=apart), 'copy_order = "part-by-part"'
    assert told in refusal(tmp_path, copies, process, profile, height)
    place_layers(load_part(peg(tmp_path, copies, "", height)), profile)  # layer by layer it goes


def test_just_far_enough_is_accepted(tmp_path):
    file = peg(tmp_path, ROW.format(apart=24), 'copy_order = "part-by-part"', 6.4)
    assert place_layers(load_part(file), SLIM).n_layers == 8


@pytest.mark.parametrize(
    ("copies", "told"),
    [
        ('[[copy]]\nname = "A"\nposition_mm = [0, 0]\n' * 2, "copy[2].name: 'A' is there twice"),
        ("[[copy]]\nposition_mm = [0, 0]\ncount = [2, 1]\n", "needs spacing_mm"),
        ("[[copy]]\nposition_mm = [0, 0]\ncount = [50, 50]\nspacing_mm = [9, 9]\n",
         "count makes 2500 copies"),
        ("[[copy]]\nposition_mm = [0, 0]\nangle = 3\n", "copy[1].angle: there is no such key"),
        ('[[copy]]\nposition_mm = [0, 0]\n[substrate]\nkind = "plane"\npoint_mm = [0, 0, 0]\n',
         "copy: several copies stand on a level plate"),
    ],
)
def test_mistakes_in_copies_are_told(tmp_path, copies, told):
    with pytest.raises(ConfigError) as caught:
        load_part(peg(tmp_path, copies))
    assert told in caught.value.render()


def test_gaps_between_hulls_are_those_of_the_shapes():
    square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    assert hull_gap_mm(square, np.add(square, [7, 0])) == pytest.approx(3.0)
    assert hull_gap_mm(square, np.add(square, [7, 8])) == pytest.approx(5.0)
    assert hull_gap_mm(square, np.add(square, [3, 1])) == pytest.approx(-1.0)
    diamond = np.array([[0.0, -2], [2, 0], [0, 2], [-2, 0]])
    assert hull_gap_mm(square, np.add(diamond, [7, 2])) == pytest.approx(1.0)
    assert hull_gap_mm(square, np.add(diamond, [6, 6])) == pytest.approx(np.sqrt(8) - np.sqrt(2))
    random = np.random.default_rng(2)
    points = np.vstack([square, random.uniform(0.1, 3.9, (200, 2))])
    assert sorted(map(tuple, convex_hull(points))) == sorted(map(tuple, square))


@pytest.mark.parametrize(
    ("copies", "process", "told"),
    [
        (ROW.format(apart=40), 'copy_order = "part-by-part"', "do not rise one after the other"),
        ('[substrate]\nkind = "plane"\npoint_mm = [0, 0, 0]', "",
         "heights are checked over a level plate"),
    ],
)
def test_heights_are_checked_of_layers_that_rise_over_a_level_plate(
    tmp_path, copies, process, told
):
    with pytest.raises(ConfigError) as caught:
        load_part(peg(tmp_path, copies, f"{process}\nheight_check_every = 2"))
    assert "process.height_check_every" in caught.value.render()
    assert told in caught.value.render()
