"""Fields of meshes: exact distances, and signs that survive what CAD exports do to a mesh."""

from __future__ import annotations

import igl
import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.field.field import sample_distance, sample_gradient
from lmctl.field.grid import Grid
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.primitives import box_distance

BOX = ([-6.1, -4.3, -2.7], [6.2, 4.4, 3.1])


@pytest.fixture
def grid() -> Grid:
    return Grid.enclosing(np.array(BOX[0]), np.array(BOX[1]), 0.5)


def test_a_box_is_measured_exactly(box_mesh, grid):
    field = mesh_field(*box_mesh(*BOX), grid)
    true = box_distance(grid.window().node_points(), *BOX).reshape(grid.shape)
    assert np.abs(field.values - true)[np.abs(true) < 0.5].max() < 1e-5
    # Farther out the point taken is the best among those of the seeds.
    assert np.abs(field.values - true).max() < 0.1 * grid.pitch_mm
    assert np.array_equal(field.values > 0, true > 0)
    assert field.remarks == ()


def test_faces_exactly_on_nodes_keep_their_signs(box_mesh):
    low, high = [-3.0, -2.0, -2.0], [3.0, 2.0, 2.0]
    grid = Grid.enclosing(np.array(low), np.array(high), 0.5)
    field = mesh_field(*box_mesh(low, high), grid)
    true = box_distance(grid.window().node_points(), low, high).reshape(grid.shape)
    assert np.abs(field.values - true).max() < 0.1 * grid.pitch_mm
    assert field.remarks == ()


def test_every_node_agrees_with_libigl(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0, 48)
    vertices = vertices * [1.0, 0.7, 1.3] + 0.2 * np.sin(vertices[:, ::-1])
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.4)
    points = grid.window().node_points()
    exact = -igl.signed_distance(
        points, vertices, triangles, sign_type=igl.SIGNED_DISTANCE_TYPE_PSEUDONORMAL
    )[0].reshape(grid.shape)
    error = mesh_field(vertices, triangles, grid).values - exact
    assert np.sqrt(np.mean(error**2)) < 0.03 * grid.pitch_mm
    away = np.abs(exact) > 1e-6
    assert np.array_equal((error + exact > 0)[away], (exact > 0)[away])


@pytest.mark.parametrize("wound", ["outwards", "inwards", "at random"])
def test_winding_does_not_matter(sphere_mesh, wound):
    vertices, triangles = sphere_mesh(8.0)
    flip = {"outwards": np.zeros(len(triangles), bool), "inwards": np.ones(len(triangles), bool),
            "at random": np.random.default_rng(0).random(len(triangles)) < 0.5}[wound]
    triangles = np.where(flip[:, None], triangles[:, ::-1], triangles)
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5)
    field = mesh_field(vertices, triangles, grid)
    true = 8.0 - np.linalg.norm(grid.window().node_points(), axis=1).reshape(grid.shape)
    away = np.abs(true) > 0.05
    assert np.array_equal((field.values > 0)[away], (true > 0)[away])


def test_a_small_hole_is_outvoted_and_reported(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0)
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5)
    centres = vertices[triangles].mean(axis=1)
    hole = np.linalg.norm(centres - [0.0, 8.0, 0.0], axis=1) < 1.0
    assert hole.any()
    field = mesh_field(vertices, triangles[~hole], grid)
    points = grid.window().node_points()
    true = 8.0 - np.linalg.norm(points, axis=1).reshape(grid.shape)
    # Nodes in the hole itself may go either way.
    away = (np.abs(true) > 0.05) & (
        np.linalg.norm(points - [0.0, 8.0, 0.0], axis=1).reshape(grid.shape) > 2.0
    )
    assert np.array_equal((field.values > 0)[away], (true > 0)[away])
    assert "the mesh is open" in field.remarks[0]


@pytest.mark.parametrize("copies", ["as they are", "turned over", "of some"])
def test_triangles_that_are_there_twice_count_once(sphere_mesh, copies):
    vertices, triangles = sphere_mesh(8.0, 48)
    again = {"as they are": triangles, "turned over": triangles[:, ::-1], "of some": triangles[::7]}
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5)
    field = mesh_field(vertices, np.vstack([triangles, again[copies]]), grid)
    assert np.array_equal(field.values, mesh_field(vertices, triangles, grid).values)
    assert field.remarks == (
        f"{len(again[copies])} triangles of the mesh are there more than once: each counts once",
    )


def test_solids_that_overlap_in_one_mesh_are_one(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0, 48)
    both = np.vstack([vertices, vertices + np.array([9.0, 0.3, 0.2])])
    grid = Grid.enclosing(both.min(axis=0), both.max(axis=0), 0.5)
    field = mesh_field(both, np.vstack([triangles, triangles + len(vertices)]), grid)
    points = grid.window().node_points()
    apart = [np.linalg.norm(points - c, axis=1) for c in ([0, 0, 0], [9.0, 0.3, 0.2])]
    true = (8.0 - np.minimum(*apart)).reshape(grid.shape)
    # The surface of either within the other stays a surface: distances are measured to it.
    away = (np.abs(true) > 0.1) & (np.abs(field.values) > 1e-3)
    assert np.array_equal((field.values > 0)[away], (true > 0)[away])


def test_a_cavity_is_outside(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0, 48)
    both = np.vstack([vertices, 0.5 * vertices])
    grid = Grid.enclosing(both.min(axis=0), both.max(axis=0), 0.5)
    field = mesh_field(both, np.vstack([triangles, triangles[:, ::-1] + len(vertices)]), grid)
    radius = np.linalg.norm(grid.window().node_points(), axis=1).reshape(grid.shape)
    assert np.all(field.values[radius < 3.9] < 0)
    assert np.all(field.values[(radius > 4.1) & (radius < 7.9)] > 0)


@pytest.mark.parametrize("turned", [False, True])
def test_triangles_missing_here_and_there_leave_the_rest_its_signs(sphere_mesh, turned):
    vertices, triangles = sphere_mesh(8.0, 48)
    rng = np.random.default_rng(3)
    left = triangles[rng.random(len(triangles)) > 0.01]
    if turned:
        left = np.where(rng.random(len(left))[:, None] < 0.5, left, left[:, ::-1])
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.25)
    field = mesh_field(vertices, left, grid)
    true = 8.0 - np.linalg.norm(grid.window().node_points(), axis=1).reshape(grid.shape)
    away = np.abs(true) > 0.3
    assert np.array_equal((field.values > 0)[away], (true > 0)[away])
    assert "the mesh is open" in field.remarks[0]


def test_half_a_ball_left_open_is_closed_over(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0, 48)
    low = triangles[vertices[triangles][:, :, 2].max(axis=1) < 0.3]
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5)
    points = grid.window().node_points()
    inside = mesh_field(vertices, low, grid).values.reshape(-1) > 0
    true = 8.0 - np.linalg.norm(points, axis=1)
    assert np.all(inside[(true > 0.2) & (points[:, 2] < -0.5)])
    assert not np.any(inside[(true < -0.2) | (points[:, 2] > 0.5)])


def test_slivers_and_triangles_without_area_do_no_harm(box_mesh, grid):
    vertices, triangles = box_mesh(*BOX)
    flat = np.array([[0, 0, 1], [2, 2, 2]])
    field = mesh_field(vertices, np.vstack([triangles, flat]), grid)
    assert np.array_equal(field.values, mesh_field(vertices, triangles, grid).values)


@pytest.mark.parametrize("pitch", [1.0, 0.5])
def test_the_pitch_does_not_matter_near_the_surface(sphere_mesh, pitch):
    vertices, triangles = sphere_mesh(8.0, 256)
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), pitch)
    true = 8.0 - np.linalg.norm(grid.window().node_points(), axis=1)
    error = mesh_field(vertices, triangles, grid).values.reshape(-1) - true
    assert np.abs(error[np.abs(true) < 3.0]).max() < 2e-3  # the mesh's own, by its facets


def test_closest_points_lie_on_the_surface_at_the_distance_given(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0)
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 1.0)
    field = mesh_field(vertices, triangles, grid)
    closest = field.closest_point_of_each_node.reshape(-1, 3)
    assert np.linalg.norm(closest, axis=1) == pytest.approx(8.0, abs=0.02)
    away = np.linalg.norm(closest - grid.window().node_points(), axis=1)
    assert away == pytest.approx(np.abs(field.values.reshape(-1)), abs=1e-5)


def test_sampling_between_and_beyond_the_nodes(sphere_mesh):
    vertices, triangles = sphere_mesh(8.0)
    grid = Grid.enclosing(vertices.min(axis=0), vertices.max(axis=0), 0.5)
    field = mesh_field(vertices, triangles, grid)
    points = np.random.default_rng(1).uniform(-14.0, 14.0, (500, 3))
    true = 8.0 - np.linalg.norm(points, axis=1)
    error = np.abs(sample_distance(field, points) - true)
    assert error[np.abs(true) < 4.0].max() < 0.03
    assert error[true < 0.0].max() < 0.1 * grid.pitch_mm
    nodes = grid.window(10, 11).node_points()
    assert sample_distance(field, nodes) == pytest.approx(field.values[10].reshape(-1), abs=1e-5)
    near = points[np.abs(true) < 3.0]
    inwards = -near / np.linalg.norm(near, axis=1)[:, None]
    slope = sample_gradient(field, near)
    assert np.sum(slope * inwards, axis=1) == pytest.approx(1.0, abs=0.03)


def test_a_window_of_its_own_grid_is_its_own_values(box_mesh, grid):
    field = mesh_field(*box_mesh(*BOX), grid)
    assert np.shares_memory(field.values_on_window(grid.window(2, 5)), field.values)
    other = Grid.enclosing(np.array(BOX[0]), np.array(BOX[1]), 0.3)
    true = box_distance(other.window(5, 9).node_points(), *BOX)
    got = field.values_on_window(other.window(5, 9))
    assert got.shape == other.window(5, 9).shape
    assert np.abs(got.reshape(-1) - true).max() < 0.2


@pytest.mark.parametrize(
    ("break_it", "what"),
    [
        (lambda v, t: (v, t[:0]), "no triangles"),
        (lambda v, t: (v, t + 3), "not there"),
        (lambda v, t: (v, -t), "not there"),
        (lambda v, t: (np.where(v > 6, np.nan, v), t), "not numbers"),
        (lambda v, t: (np.where(v > 6, np.inf, v), t), "not numbers"),
        (lambda v, t: (v + 1000.0, t), "outside its grid"),
        (lambda v, t: (v, t[:1]), "encloses nothing"),
        (lambda v, t: (v[:, :2], t), "not a list of triangles"),
    ],
)
def test_meshes_that_cannot_be_used_are_refused(box_mesh, grid, break_it, what):
    with pytest.raises(InputError, match=what) as error:
        mesh_field(*break_it(*box_mesh(*BOX)), grid)
    assert error.value.where
