"""Jobs on substrates that are not level: where beads lie, how fast, and what is refused."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from lmctl.config.machine import load_profile
from lmctl.config.nozzle import NozzleSettings
from lmctl.errors import PlanError
from lmctl.examples.templates import write_template
from lmctl.job.schema import LineKind
from lmctl.part.load import load_part
from lmctl.part.substrate import flattened_part
from lmctl.plan.geometry import layer_geometry
from lmctl.plan.layer_range import place_layers
from lmctl.plan.planner import plan_job
from lmctl.preflight.part_check import check_part
from lmctl.run.program.place import ProgramPlace
from lmctl.run.program.reentry import plan_reentry
from tests.plan.planned_jobs import layers_of

CELL = load_profile(Path(__file__).parents[2] / "lmctl" / "examples" / "cell.toml")
#: Beads leave their surface by no more than the chord and the program's rounding.
OFF_MM = 0.022

SLAB = """
name = "slab"
[[material]]
name = "316L"
[[body]]
kind = "{body}"
{keys}
[substrate]
{substrate}
[process]
bead_width_mm = 2.0
layer_height_mm = 0.8
"""
#: A box that reaches far below what it is deposited on.
DEEP_BOX = "low_mm = [0, 0, -30]\nhigh_mm = [30, 14, {top}]"


def slab(folder: Path, substrate: str, top: float = 2.4, body: str = "box", keys: str = "") -> Path:
    file = folder / "slab.toml"
    file.write_text(SLAB.format(body=body, keys=keys or DEEP_BOX.format(top=top),
                                substrate=substrate))
    return file


@pytest.fixture(scope="module")
def shaft(tmp_path_factory: pytest.TempPathFactory) -> tuple[object, list]:
    folder = tmp_path_factory.mktemp("shaft")
    file = write_template("shaft", folder)[0]
    plan_job(load_part(file), CELL, folder / "shaft.lmj")
    return layers_of(folder / "shaft.lmj")


def bead_ends(manifest, layer):
    """Begin and end of every bead line, in the part's coordinates, with its row of the table."""
    at = np.stack([layer.lines[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
    at = at - np.array(manifest.part_offset_mm)
    rows = np.flatnonzero(layer.lines["kind"] == LineKind.BEAD)
    return at[rows - 1], at[rows], layer.lines[rows]


def test_beads_on_a_shaft_lie_on_rounds_of_their_layers(shaft):
    manifest, layers = shaft
    assert len(layers) == 3
    for number, layer in enumerate(layers, start=1):
        begin, end, _ = bead_ends(manifest, layer)
        for share in (0.0, 0.5, 1.0):
            at = begin + share * (end - begin)
            off = np.hypot(at[:, 1], at[:, 2]) - (25 + 0.8 * number)
            assert np.abs(off).max() < OFF_MM


def test_the_volume_on_a_shaft_is_that_between_the_two_rounds(shaft):
    manifest, _ = shaft
    wanted = 50 * quad(lambda y: math.sqrt(27.4**2 - y * y) - math.sqrt(625 - y * y), -13, 13)[0]
    totals = manifest.totals
    assert totals["deposited_volume_mm3"] == pytest.approx(wanted, rel=0.01)
    assert totals["intended_volume_mm3"] == pytest.approx(wanted, rel=0.005)
    assert totals["built_fraction"] > 0.99
    assert totals["substrate"] == {"kind": "cylinder", "material": "316L", "layers": "parallel",
                                   "rise_mm": pytest.approx(3.3, abs=0.1),
                                   "slope_deg": pytest.approx(30.8, abs=1.0)}


def test_powder_for_a_bead_on_the_slope_is_what_its_place_takes(shaft):
    """Flow is constant, so time by strip and thickness: v · strip · thickness is the same."""
    manifest, layers = shaft
    begin, end, lines = bead_ends(manifest, layers[0])
    step = end - begin
    length, level_mm = np.linalg.norm(step, axis=1), np.hypot(step[:, 0], step[:, 1])
    assert (length / level_mm).max() > 1.1
    level_pace = lines["speed_mm_s"] * level_mm / length
    thick = 25.4 / np.sqrt(25.4**2 - ((begin + end) / 2)[:, 1] ** 2)
    volume_rate = level_pace * lines["bead_width_mm"] * thick
    wide = np.abs(lines["bead_width_mm"] / 2.0 - 1) < 0.2
    assert np.ptp(volume_rate[wide]) / volume_rate.mean() < 0.05


def test_the_nozzle_crosses_above_all_of_the_layer(shaft):
    manifest, layers = shaft
    clearance = CELL.motion.clearance_mm
    for number, layer in enumerate(layers, start=1):
        at = np.stack([layer.lines[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1)
        crown = 25 + 0.8 * number + manifest.part_offset_mm[2]
        step = np.diff(at, axis=0)
        crosses = np.hypot(step[:, 0], step[:, 1]) > 0.01
        crosses &= (layer.lines["kind"] == LineKind.TRAVEL)[1:]
        assert crosses.any()
        assert np.abs(step[crosses, 2]).max() < 1e-6
        assert at[1:][crosses, 2].min() >= crown + clearance - 0.01
        assert layer.z_mm == pytest.approx(crown, abs=0.01)


def test_layers_on_a_tilted_plate_are_at_a_distance_from_it(tmp_path):
    file = slab(tmp_path, 'kind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [-0.1, 0, 1]',
                body="prism",
                keys="outline_mm = [[0, 0], [30, 0], [30, 14], [0, 14]]\nlow_mm = -5\nhigh_mm = 9")
    plan_job(load_part(file), CELL, tmp_path / "job.lmj")
    manifest, layers = layers_of(tmp_path / "job.lmj")
    normal = np.array([-0.1, 0.0, 1.0]) / math.sqrt(1.01)
    for number, layer in enumerate(layers[:4], start=1):
        _, end, _ = bead_ends(manifest, layer)
        assert end @ normal == pytest.approx(number * manifest.totals["layer_height_mm"], abs=0.003)
    # the box is highest over the plate at its lower end
    assert len(bead_ends(manifest, layers[-1])[1]) < len(bead_ends(manifest, layers[0])[1])


def test_blended_layers_end_level_and_are_paced_by_their_thickness(tmp_path):
    file = slab(tmp_path, 'kind = "plane"\npoint_mm = [15, 0, 0]\nnormal = [-0.05, 0, 1]\n'
                          'layers = "blended"', top=4.0)
    plan_job(load_part(file), CELL, tmp_path / "job.lmj")
    manifest, layers = layers_of(tmp_path / "job.lmj")
    _, end, _ = bead_ends(manifest, layers[-1])
    assert end[:, 2] == pytest.approx(4.0, abs=0.003)
    _, end, lines = bead_ends(manifest, layers[0])
    low, high = end[:, 0] < 6, end[:, 0] > 24
    # thickness over the lower end is (4 + 0.75) / 4 of the mean, and 3.25 / 4 over the upper
    ratio = lines["speed_mm_s"][high].mean() / lines["speed_mm_s"][low].mean()
    assert ratio == pytest.approx((4 + 0.6) / (4 - 0.6), rel=0.1)
    assert manifest.totals["deposited_volume_mm3"] == pytest.approx(30 * 14 * 4, rel=0.01)


def test_what_is_flat_within_the_tolerance_stays_level(tmp_path):
    gentle = 'kind = "plane"\npoint_mm = [15, 7, 0]\nnormal = [-0.01, 0, 1]'
    part = flattened_part(load_part(slab(tmp_path, gentle)))
    assert part.layer_stack is not None
    assert part.layer_stack.shape == "level"
    part = flattened_part(load_part(slab(tmp_path, f"{gentle}\nstandoff_tolerance_mm = 0.1")))
    assert part.layer_stack.shape == "parallel"


def test_a_body_without_a_substrate_is_planned_as_before(tmp_path):
    part = load_part(slab(tmp_path, 'material = "316L"', keys="low_mm = [0, 0, 0]\n"
                                                             "high_mm = [9, 9, 2.4]"))
    assert flattened_part(part) is part


def walled(folder: Path, wall_mm: float) -> Path:
    """A trough of 20 mm between walls, known by a scan."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(-10, 41, 0.5), np.arange(-10, 25, 0.5)))
    z = wall_mm * np.clip((np.abs(x - 15) - 12) / 0.6, 0, 1)
    np.savetxt(folder / "walls.csv", np.column_stack([x, y, z]), delimiter=",", fmt="%.3f")
    return slab(folder, 'kind = "scan"\nfile = "walls.csv"\nunits = "mm"\nlayers = "level"',
                keys="low_mm = [5, 0, -1]\nhigh_mm = [25, 14, 1.6]")


def refusal(file: Path, profile=CELL) -> str:
    with pytest.raises(PlanError) as caught:
        place_layers(load_part(file), profile)
    return caught.value.render()


def test_a_nozzle_that_would_meet_a_wall_beside_it_is_refused_with_both_places(tmp_path):
    cell = CELL.model_copy(update={
        "motion": CELL.motion.model_copy(update={"clearance_mm": 30.0}),
        "nozzle": NozzleSettings(standoff_mm=8, tip_diameter_mm=6, half_angle_deg=30)})
    told = refusal(walled(tmp_path, 16.0), cell)
    # over x = 24.5 or so the wall at 27.6 is within the tip's half of 3 mm and 8 mm over it
    assert "the nozzle runs" in told
    assert "surface at x 27." in told or "surface at x 2." in told
    assert place_layers(load_part(walled(tmp_path, 7.0)), cell).n_layers == 2


def test_walls_higher_than_the_lift_are_refused(tmp_path):
    told = refusal(walled(tmp_path, 7.0))
    assert "rises by 6.2 mm; the nozzle lifts by 5 mm" in told or "rises by 6." in told
    assert "motion.clearance_mm" in told


@pytest.mark.parametrize(
    ("substrate", "keys", "told"),
    [
        ('kind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [-1, 0, 1]', "", "slopes by up to 45.0°"),
        ('kind = "plane"\npoint_mm = [0, 0, 9]', "", "lies nowhere above its substrate"),
        ('kind = "cylinder"\npoint_mm = [15, 7, -5]\nradius_mm = 5\naxis = [0, 1, 0]', "",
         "of the part lie beside the substrate"),
        ('kind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [-0.2, 0, 1]\nlayers = "blended"', "",
         "times the layer height"),
    ],
    ids=["steep", "above the part", "narrower than the part", "too uneven"],
)
def test_substrates_that_layers_cannot_follow_are_refused(
    tmp_path, substrate, keys, told
):
    assert told in refusal(slab(tmp_path, substrate, top=8.0, keys=keys))


def test_a_part_in_the_air_over_its_substrate_is_refused(tmp_path):
    file = slab(tmp_path, 'kind = "plane"\npoint_mm = [0, 0, 0]\nnormal = [-0.1, 0, 1]',
                keys="low_mm = [0, 0, 7]\nhigh_mm = [30, 14, 9]")
    with pytest.raises(PlanError, match="is deposited on its substrate"):
        plan_job(load_part(file), CELL, tmp_path / "job.lmj")


def test_the_way_back_to_a_path_stays_over_what_is_built(shaft):
    """A run that comes back lifts by its clearance only: why layers may not rise by more."""
    manifest, layers = shaft
    offset = np.array(manifest.part_offset_mm)
    for layer in layers:
        beads = layer.first_line + np.flatnonzero(layer.lines["kind"] == LineKind.BEAD)
        for line in beads[:: len(beads) // 7]:
            entry = plan_reentry(manifest, lambda index: layers[index],
                                 ProgramPlace(int(line), 0.4), CELL.motion)
            way = entry.layer.lines[: entry.beam_on_line - entry.layer.first_line]
            at = np.stack([way[axis] for axis in ("x_mm", "y_mm", "z_mm")], axis=1) - offset
            share = np.linspace(0, 1, 50)[None, :, None]
            places = (at[:-1, None] + share * np.diff(at, axis=0)[:, None]).reshape(-1, 3)
            over = (np.abs(places[:, 1]) < 13) & (places[:, 0] > 5) & (places[:, 0] < 55)
            assert over.any()
            built = 25 + 0.8 * layer.index
            assert (np.hypot(places[over, 1], places[over, 2]) - built).min() > 0.7


def test_a_part_on_its_substrate_reaches_other_processes_whole(tmp_path):
    part = flattened_part(load_part(write_template("shaft", tmp_path)[0]))
    sent = pickle.loads(pickle.dumps(part))
    placement = check_part(part, CELL)
    here, there = (layer_geometry(one, placement, 1) for one in (part, sent))
    assert np.array_equal(here.points_mm, there.points_mm)
    assert np.array_equal(here.strip_width_mm, there.strip_width_mm)
