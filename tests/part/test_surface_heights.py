"""Heights of substrates, and where layers over them lie, against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.part.substrate.layer_stack import LayerStack
from lmctl.part.substrate.measured_heights import grid_over, heights_of_mesh, heights_of_points
from lmctl.part.substrate.surface_heights import BarHeights, PlaneHeights

RNG = np.random.default_rng(5)
PLACES = RNG.uniform(-12, 12, (200, 2))
TILTED = PlaneHeights(np.array([1.0, 2.0, 3.0]), np.array([0.2, -0.3, 1.0]) / np.sqrt(1.13))
BAR = BarHeights(np.array([4.0, 1.0, -20.0]), np.array([0.6, 0.8]), 30.0)


def stack(heights, shape):
    return LayerStack(heights, shape, PLACES, np.empty((0, 3)), base_mm=1.0, top_mm=25.0,
                      depth_mm=14.0)


def test_a_bar_is_as_far_from_its_axis_as_its_radius_and_the_layers_under():
    for distance in (0.0, 2.4):
        z = BAR.raised_height_mm(PLACES, distance)
        along = np.array([0.6, 0.8, 0.0])
        arm = np.column_stack([PLACES, z]) - BAR.point_mm
        off = np.linalg.norm(np.cross(arm, along), axis=1)
        assert off == pytest.approx(30.0 + distance, abs=1e-9)


@pytest.mark.parametrize("shape", ["level", "shifted", "parallel", "blended"])
@pytest.mark.parametrize("heights", [TILTED, BAR], ids=["plane", "bar"])
def test_slope_and_thickness_are_the_derivatives_of_the_height(heights, shape):
    layers, level, step = stack(heights, shape), 1.6, 1e-5
    for axis in (0, 1):
        aside = np.eye(2)[axis] * step
        change = (layers.height_mm(PLACES + aside, level)
                  - layers.height_mm(PLACES - aside, level)) / (2 * step)
        assert layers.slope(PLACES, level)[:, axis] == pytest.approx(change, abs=1e-6)
    rise = (layers.height_mm(PLACES, level + step) - layers.height_mm(PLACES, level - step)) / (
        2 * step)
    assert layers.stretch(PLACES, level) == pytest.approx(rise, abs=1e-6)


@pytest.mark.parametrize("shape", ["level", "shifted", "parallel", "blended"])
@pytest.mark.parametrize("heights", [TILTED, BAR], ids=["plane", "bar"])
def test_a_height_leads_back_to_its_level(heights, shape):
    layers = stack(heights, shape)
    points = np.column_stack([PLACES, RNG.uniform(0, 3, len(PLACES))])
    assert layers.level_mm(layers.points_mm(points)) == pytest.approx(points[:, 2], abs=1e-9)


def test_blended_layers_begin_on_the_substrate_and_end_level():
    layers = stack(BAR, "blended")
    assert layers.height_mm(PLACES, 0.0) == pytest.approx(BAR.height_mm(PLACES))
    assert layers.height_mm(PLACES, 14.0) == pytest.approx(25.0)


def scan_of(height, count=8000, noise=0.02, seed=1):
    random = np.random.default_rng(seed)
    places = random.uniform(-20, 20, (count, 2))
    return np.column_stack([places, height(places) + random.normal(0, noise, count)])


GRID = grid_over(np.array([-12.0, -12.0]), np.array([12.0, 12.0]), 0.5)


def test_a_noisy_scan_gives_the_surface_within_its_noise():
    heights = heights_of_points(scan_of(BAR.height_mm), GRID, "scan")
    off = heights.height_mm(PLACES) - BAR.height_mm(PLACES)
    assert np.abs(off).max() < 0.05
    assert np.abs(heights.slope(PLACES) - BAR.slope(PLACES)).mean() < 0.05


def test_outliers_and_the_lower_side_of_a_scan_count_for_nothing():
    upper = scan_of(lambda at: np.full(len(at), 5.0))
    upper[::200, 2] += 0.8
    lower = scan_of(lambda at: np.zeros(len(at)), seed=2)
    heights = heights_of_points(np.vstack([lower, upper]), GRID, "scan")
    off = np.abs(heights.height_mm(PLACES) - 5.0)
    assert np.median(off) < 0.02
    assert off.max() < 0.2


def test_a_place_that_was_not_scanned_is_known():
    points = scan_of(BAR.height_mm)
    points = points[np.hypot(points[:, 0] - 3, points[:, 1]) > 4]
    heights = heights_of_points(points, GRID, "scan")
    assert not heights.covers(np.array([[3.0, 0.0], [50.0, 0.0]])).any()
    assert heights.covers(np.array([[9.0, 0.0], [-3.0, 5.0]])).all()


def test_too_few_samples_over_the_part_are_refused():
    with pytest.raises(InputError, match="has 5 samples over the part"):
        heights_of_points(scan_of(BAR.height_mm, count=9)[:5] * 0.1, GRID, "scan.csv")


def test_a_mesh_gives_its_upper_side_exactly():
    corners = np.array([(x, y, 0.25 * x - 0.5 * y + z) for z in (0.0, 6.0)
                        for x, y in ((-9, -9), (9, -9), (9, 9), (-9, 9))])
    triangles = np.array([(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)])
    heights = heights_of_mesh(corners, triangles, GRID)
    inside = PLACES[(np.abs(PLACES) < 8).all(axis=1)]
    assert heights.height_mm(inside) == pytest.approx(
        0.25 * inside[:, 0] - 0.5 * inside[:, 1] + 6.0, abs=1e-9)
    assert heights.covers(inside).all()
    assert not heights.covers(np.array([[11.0, 0.0]])).any()
