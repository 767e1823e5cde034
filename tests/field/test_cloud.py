"""Fields of scanned clouds: signs under noise and gaps, sharp edges, and clear refusals."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.grid import Grid
from lmctl.field.primitives import box_distance, torus_distance


def around(points: np.ndarray, pitch: float) -> Grid:
    return Grid.enclosing(points.min(axis=0), points.max(axis=0), pitch)


def errors_near(field, true: np.ndarray, within: float) -> np.ndarray:
    near = np.abs(true) < within
    return (field.values.reshape(-1) - true)[near]


@pytest.mark.parametrize("seed", [11, 2])
def test_signs_of_a_noisy_gear_are_right_away_from_its_surface(gear, seed):
    """More seeds in tests/benchmarks/cloud_signs.py."""
    points = gear.cloud(20_000, 0.02, np.random.default_rng(seed))
    grid = around(points, 0.25)
    field = cloud_field(points, grid)
    true = gear.distance(grid)
    away = np.abs(true) > 1.5 * np.sqrt(gear.area_mm2() / len(points))
    assert np.array_equal((field.values.reshape(-1) > 0)[away], (true > 0)[away])
    # Samples are 0.8 mm apart: edges are found from the faces that meet in them.
    assert np.sqrt(np.mean(errors_near(field, true, 0.3) ** 2)) < 0.05


def test_smooth_surfaces_are_third_order(sphere_cloud):
    worst = []
    for count, pitch in ((2_000, 0.8), (8_000, 0.4)):
        points = sphere_cloud(count, 10.0)
        grid = around(points, pitch)
        true = 10.0 - np.linalg.norm(grid.window().node_points(), axis=1)
        error = errors_near(cloud_field(points, grid), true, pitch)
        worst.append(np.sqrt(np.mean(error**2)))
    assert worst[0] < 2e-3
    assert worst[1] < worst[0] / 6


def test_a_torus_has_a_hole(sphere_cloud):
    rng = np.random.default_rng(2)
    turn, tube = rng.uniform(0, 2 * np.pi, (2, 12_000))
    keep = rng.uniform(0, 13, 12_000) < 9 + 4 * np.cos(tube)
    ring = 9 + 4 * np.cos(tube[keep])
    points = np.column_stack(
        [ring * np.cos(turn[keep]), ring * np.sin(turn[keep]), 4 * np.sin(tube[keep])]
    ) + rng.normal(0, 0.02, (keep.sum(), 3))
    grid = around(points, 0.5)
    true = torus_distance(grid.window().node_points(), [0, 0, 0], [0, 0, 1], 9.0, 4.0)
    field = cloud_field(points, grid)
    away = np.abs(true) > 0.1
    assert np.array_equal((field.values.reshape(-1) > 0)[away], (true > 0)[away])
    assert np.sqrt(np.mean(errors_near(field, true, 0.5) ** 2)) < 0.02


def box_cloud(rng: np.random.Generator, count: int, size: np.ndarray) -> np.ndarray:
    points = rng.uniform(0, 1, (count, 3)) * size
    faces = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis = rng.choice(3, count, p=faces / faces.sum())
    points[np.arange(count), axis] = rng.integers(0, 2, count) * size[axis]
    return points


def test_edges_of_a_box_stay_sharp():
    size = np.array([12.0, 9.0, 7.0])
    points = box_cloud(np.random.default_rng(3), 12_000, size)
    grid = around(points, 0.25)
    true = box_distance(grid.window().node_points(), [0, 0, 0], size)
    error = np.abs(errors_near(cloud_field(points, grid), true, 0.25))
    # Samples are 0.2 mm apart; a fit across edges would err by about as much at all of them.
    assert np.quantile(error, 0.99) < 0.01
    assert np.sqrt(np.mean(error**2)) < 0.01


def test_uneven_density_and_small_holes_are_bridged(sphere_cloud):
    points = sphere_cloud(20_000, 10.0)
    rng = np.random.default_rng(4)
    dense = points[rng.random(len(points)) < np.where(points[:, 0] > 0, 1.0, 0.12)]
    holes = sphere_cloud(12, 10.0, seed=5)
    gap = np.linalg.norm(dense[:, None] - holes, axis=2).min(axis=1)
    spacing = np.where(dense[:, 0] > 0, 0.25, 0.72)
    cloud = dense[gap > 1.2 * spacing]
    grid = around(cloud, 0.4)
    true = 10.0 - np.linalg.norm(grid.window().node_points(), axis=1)
    field = cloud_field(cloud, grid)
    away = np.abs(true) > 0.3
    assert np.array_equal((field.values.reshape(-1) > 0)[away], (true > 0)[away])


def test_thin_walls_have_two_sides():
    size = np.array([20.0, 16.0, 1.2])
    points = box_cloud(np.random.default_rng(6), 9_000, size)
    grid = around(points, 0.2)
    true = box_distance(grid.window().node_points(), [0, 0, 0], size)
    field = cloud_field(points, grid)
    away = np.abs(true) > 0.3  # samples are 0.27 mm apart
    assert np.array_equal((field.values.reshape(-1) > 0)[away], (true > 0)[away])
    assert np.quantile(np.abs(errors_near(field, true, 0.2)), 0.98) < 0.02


def test_repeats_and_strays_are_dropped_and_reported(sphere_cloud):
    points = sphere_cloud(5_000, 10.0)
    strays = np.random.default_rng(7).uniform(-16, 16, (20, 3))
    strays = strays[np.abs(np.linalg.norm(strays, axis=1) - 10) > 2]
    cloud = np.vstack([points, points[:50], strays])
    grid = around(cloud, 0.5)
    field = cloud_field(cloud, grid)
    true = 10.0 - np.linalg.norm(grid.window().node_points(), axis=1)
    away = np.abs(true) > 0.05
    assert np.array_equal((field.values.reshape(-1) > 0)[away], (true > 0)[away])
    assert any("50 repeated points" in remark for remark in field.remarks)
    assert any("dropped as outliers" in remark for remark in field.remarks)


def test_order_of_the_points_does_not_matter(sphere_cloud):
    points = sphere_cloud(3_000, 10.0)
    grid = around(points, 0.8)
    again = np.random.default_rng(8).permutation(points)
    assert np.array_equal(cloud_field(points, grid).values, cloud_field(again, grid).values)


@pytest.mark.parametrize("left", [0.0, -7.0, -9.0])
def test_an_open_cloud_is_refused_with_the_size_of_the_opening(sphere_cloud, left):
    points = sphere_cloud(5_000, 10.0)
    with pytest.raises(InputError, match="open") as error:
        cloud_field(points[points[:, 2] > left], around(points, 0.5))
    assert "opening" in error.value.where[0]
    assert error.value.hint


def test_a_cloud_too_sparse_for_its_pitch_is_refused_with_the_pitch_it_can_bear(sphere_cloud):
    points = sphere_cloud(1_000, 30.0)
    with pytest.raises(InputError, match=r"up to .* mm apart, the grid pitch is 0.25 mm") as error:
        cloud_field(points, around(points, 0.25))
    pitch = float(error.value.hint.split("at least ")[1].split(" mm")[0])
    assert cloud_field(points, around(points, pitch)).values.max() > 25.0


def on_a_ball(count, radius):
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1)[:, None]


@pytest.mark.parametrize(
    ("points", "what"),
    [
        (np.array([[0.0, 0, 0], [1, 1, 1]]), "only 2 distinct points"),
        (np.zeros((500, 3)), "only 1 distinct point"),
        (np.random.default_rng(0).random((500, 3)) * [5, 5, 0], "in one plane"),
        (np.outer(np.linspace(0, 9, 500), [1.0, 2.0, 0.5]), "on one line"),
        (np.full((500, 3), np.nan), "not numbers"),
        (np.full((500, 3), np.inf), "not numbers"),
        (np.zeros((500, 2)), "not a list of x, y, z"),
        (np.zeros((0, 3)), "only 0 distinct points"),
        (np.random.default_rng(0).random((500, 3)) * 40 - 10, "outside its grid"),
        (on_a_ball(300, 0.5), "only 8 points apart from each other"),
        (on_a_ball(3000, 0.95) + 0.4, "encloses nothing that the grid can see"),
    ],
)
def test_clouds_that_cannot_be_used_are_refused(points, what):
    grid = Grid((-3.0, -3.0, -3.0), 1.0, (20, 20, 20))
    with pytest.raises(InputError, match=what):
        cloud_field(points, grid)


def test_points_all_through_a_volume_are_no_surface():
    points = np.random.default_rng(9).random((6_000, 3)) * 20
    with pytest.raises(InputError):
        cloud_field(points, around(points, 0.5))


def test_lines_of_a_scanner_are_made_even():
    turn, height = np.meshgrid(
        np.linspace(0, 2 * np.pi, 600, endpoint=False), (np.arange(30) + 0.5) * np.pi / 30
    )
    points = 10 * np.column_stack([
        (np.sin(height) * np.cos(turn)).ravel(), (np.sin(height) * np.sin(turn)).ravel(),
        np.cos(height).ravel(),
    ])
    grid = around(points, 0.4)
    true = 10.0 - np.linalg.norm(grid.window().node_points(), axis=1)
    error = errors_near(cloud_field(points, grid), true, 0.4)
    assert np.abs(error).max() < 0.02  # lines are 1 mm apart


def test_noise_averages_out_where_samples_are_dense(sphere_cloud):
    rng = np.random.default_rng(12)
    points = sphere_cloud(60_000, 10.0) + rng.normal(0, 0.1, (60_000, 3))
    for pitch in (0.4, 1.0):
        grid = around(points, pitch)
        true = 10.0 - np.linalg.norm(grid.window().node_points(), axis=1)
        error = errors_near(cloud_field(points, grid), true, pitch)
        assert np.sqrt(np.mean(error**2)) < 0.05


def test_a_closed_cavity_is_refused(sphere_cloud):
    points = np.vstack([sphere_cloud(6_000, 10.0), sphere_cloud(3_000, 6.0, seed=1)])
    with pytest.raises(InputError, match="cannot be distinguished everywhere") as error:
        cloud_field(points, around(points, 0.4))
    assert "cavities" in error.value.hint
