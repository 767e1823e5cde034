"""Where a part stands, and what is in the way of making it."""

from dataclasses import replace

import numpy as np
import pytest

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.part.materials.powders import MaterialSpec
from lmctl.preflight.part_check import check_part
from lmctl.preflight.placement import fitted_layer_height_mm


def refusal(part, profile):
    with pytest.raises(PlanError) as caught:
        check_part(part, profile)
    assert caught.value.hint
    return caught.value.render()


def test_centred_on_the_platform_with_its_lowest_point_on_it(part, profile):
    placement = check_part(part, profile)
    assert placement.offset_mm == pytest.approx([150, 150, 3])
    assert placement.n_layers == 13  # 10 mm in layers of 0.769, nearest to 0.8
    assert placement.layer_height_mm == pytest.approx(10 / 13)
    assert placement.cut_height_mm(0) == pytest.approx(-3 + 5 / 13)
    assert placement.nozzle_height_mm(0) == pytest.approx(10 / 13)
    assert placement.nozzle_height_mm(12) == pytest.approx(10)
    assert placement.uncovered_height_mm() == pytest.approx(0)


@pytest.mark.parametrize(("tall", "fitted"), [
    (8.0, 0.8), (8.0 + 1e-12, 0.8), (10.0, 10 / 13), (0.85, 0.85), (1.0, 0.8), (1.2, 0.8),
    (0.3, 0.8), (1.75, 0.875), (4.3, 0.86), (80.2, 80.2 / 100)])
def test_the_layer_height_is_fitted_within_a_tenth(tall, fitted):
    assert fitted_layer_height_mm(tall, 0.8) == pytest.approx(fitted, rel=1e-9)
    assert abs(fitted_layer_height_mm(tall, 0.8) / 0.8 - 1) <= 0.1


def test_where_the_part_file_says(part, profile):
    placement = check_part(replace(part, placement_mm=(50.0, 60.0, 5.0)), profile)
    assert placement.offset_mm == pytest.approx([50, 60, 5])
    assert placement.nozzle_height_mm(0) == pytest.approx(5 - 3 + 10 / 13)


@pytest.mark.parametrize(("height", "layers"), [(0.45, 1), (0.8, 1), (1.2, 1), (1.25, 2), (8, 10)])
def test_layers_are_those_whose_middle_meets_the_part(part, profile, height, layers):
    assert check_part(replace(part, low_mm=(-5.0, -5, 0), high_mm=(5.0, 5, height)),
                      profile).n_layers == layers


def test_less_than_half_a_layer(part, profile):
    text = refusal(replace(part, high_mm=(20.0, 20.0, -2.7)), profile)
    assert "0.3 mm tall" in text


def test_more_layers_than_a_job_holds(part, profile):
    tall = replace(part, high_mm=(20.0, 20.0, 87.0), process=ProcessSettings(layer_height_mm=0.005))
    assert "18,000 layers" in refusal(tall, profile)


def test_only_some_layers(part, profile):
    placement = check_part(part, profile)
    lowered = placement.restricted_to_layers(2, 9, set_down=True)
    assert lowered.n_layers == 8
    assert lowered.nozzle_height_mm(0) == pytest.approx(10 / 13)
    assert lowered.cut_height_mm(0) == pytest.approx(placement.cut_height_mm(2))
    kept = placement.restricted_to_layers(2, 9, set_down=False)
    assert kept.nozzle_height_mm(0) == pytest.approx(placement.nozzle_height_mm(2))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"placement_mm": (5.0, 100.0, 3.0)}, "x: needs -15.0 to 25.0 mm, has 0 to 300"),
        ({"placement_mm": (100.0, 290.0, 3.0)}, "y: needs 270.0 to 310.0"),
        ({"placement_mm": (100.0, 100.0, -2.0)}, "z: needs -4.2"),
        ({"high_mm": (20.0, 20.0, 195.0)}, "z: needs 0.8 to 203.0"),
        ({"high_mm": (400.0, 20.0, 7.0)}, "x: needs -60.0 to 360.0"),
    ],
)
def test_a_part_outside_the_travel(part, profile, changes, said):
    text = refusal(replace(part, **changes), profile)
    assert "outside the travel of 'bench cell'" in text
    assert said in text


def test_a_material_no_hopper_holds(part, profile):
    other = MaterialSpec("IN718", 0.008, None, 0.7, 1500.0, 10.0, ())
    assert "no hopper of 'bench cell' holds IN718" in refusal(
        replace(part, materials=(other,)), profile)


def test_more_power_than_the_laser_has(part, profile):
    hot = MaterialSpec("316L", 0.008, None, 0.7, 5000.0, 10.0, ())
    assert "316L wants 5000 W" in refusal(replace(part, materials=(hot,)), profile)


def test_more_speed_than_the_axes_have(part, profile):
    fast = MaterialSpec("316L", 0.008, None, 0.7, 1500.0, 150.0, ())
    assert "316L wants 150 mm/s" in refusal(replace(part, materials=(fast,)), profile)


def test_everything_in_the_way_at_once(part, profile):
    hot = MaterialSpec("Unobtainium", 0.008, None, 0.7, 5000.0, 10.0, ())
    text = refusal(replace(part, materials=(hot,), placement_mm=(0.0, 0.0, 3.0)), profile)
    assert "3 things" in text
    for word in ("no hopper", "5000 W", "x: needs", "y: needs"):
        assert word in text


def test_a_finer_layer_height_makes_more_layers(part, profile):
    finer = replace(part, process=ProcessSettings(layer_height_mm=0.25))
    placement = check_part(finer, profile)
    assert placement.n_layers == 40
    heights = np.array([placement.nozzle_height_mm(i) for i in range(40)])
    assert np.diff(heights) == pytest.approx(np.full(39, 0.25))
