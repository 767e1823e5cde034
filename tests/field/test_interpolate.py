"""What a stored field gives back between its nodes, at places exactly on the true surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lmctl.field.field import DistanceField, sample_distance
from lmctl.field.grid import Grid
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.primitives import (
    box_distance,
    cylinder_distance,
    sphere_distance,
    torus_distance,
)
from tests.field.stored_field import stored_field

OFFSETS = [np.zeros(3), np.array([0.13, 0.37, 0.71]), np.array([0.5, 0.5, 0.5])]


def directions(count: int) -> np.ndarray:
    d = np.random.default_rng(0).normal(size=(count, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def box_surface(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Faces, edges and corners."""
    rng = np.random.default_rng(1)
    faces, edges = rng.uniform(0, 1, (3000, 3)), rng.uniform(0, 1, (3000, 3))
    axis = rng.integers(0, 3, 3000)
    faces[np.arange(3000), axis] = rng.integers(0, 2, 3000)
    for other in (1, 2):
        edges[np.arange(3000), (axis + other) % 3] = rng.integers(0, 2, 3000)
    corners = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
    return low + np.vstack([faces, edges, corners]) * (high - low)


def stored(distance: Callable[[np.ndarray], np.ndarray], reach: float,
           pitch: float) -> DistanceField:
    return stored_field(distance, Grid.enclosing(np.full(3, -reach), np.full(3, reach), pitch))


@pytest.mark.parametrize("offset", OFFSETS, ids=["on nodes", "off nodes", "between nodes"])
def test_a_sphere_at_a_coarse_pitch(offset):
    field = stored(lambda p: sphere_distance(p, offset, 20.0), 21.0, 1.0)
    assert np.abs(sample_distance(field, offset + 20.0 * directions(5000))).max() < 1e-5


@pytest.mark.parametrize("offset", OFFSETS, ids=["on nodes", "off nodes", "between nodes"])
def test_faces_edges_and_corners_of_a_box(offset):
    half = np.array([15.0, 11.0, 8.0])
    low, high = offset - half, offset + half
    field = stored(lambda p: box_distance(p, low, high), 16.0, 1.0)
    assert np.abs(sample_distance(field, box_surface(low, high))).max() < 1e-6


def test_two_pitches_meet_in_one_union():
    large = stored(lambda p: sphere_distance(p, [0, 0, 0], 20.0), 21.0, 1.0)
    centre = np.array([18.0, 3.0, -2.0])
    grid = Grid.enclosing(centre - 6.0, centre + 6.0, 0.25)
    small = stored_field(lambda p: sphere_distance(p, centre, 6.0), grid)
    points = np.vstack([20.0 * directions(4000), centre + 6.0 * directions(4000)])
    exact = np.maximum(20.0 - np.linalg.norm(points, axis=1),
                       6.0 - np.linalg.norm(points - centre, axis=1))
    surface = np.abs(exact) < 1e-9
    union = np.maximum(sample_distance(large, points), sample_distance(small, points))
    assert np.abs(union[surface]).max() < 1e-5


def test_error_on_smooth_surfaces_is_of_third_order():
    """On average: cells across a sharp bend of the torus keep a second-order rest."""
    worst = []
    for pitch in (1.0, 0.5):
        field = stored(lambda p: torus_distance(p, [0, 0, 0], [0.3, 0.2, 0.9], 12, 5), 18, pitch)
        axis = np.array([0.3, 0.2, 0.9]) / np.linalg.norm([0.3, 0.2, 0.9])
        ring = np.cross(axis, directions(4000))
        ring /= np.linalg.norm(ring, axis=1)[:, None]
        turn = np.random.default_rng(2).uniform(0, 2 * np.pi, 4000)[:, None]
        points = (12 + 5 * np.cos(turn)) * ring + 5 * np.sin(turn) * axis
        worst.append(np.sqrt(np.mean(sample_distance(field, points) ** 2)))
    assert worst[0] < 2e-4
    assert worst[1] < worst[0] / 6


def test_planes_that_meet_in_a_round_edge_stay_planes():
    field = stored(lambda p: cylinder_distance(p, [0.1, 0, -6.2], [0.1, 0, 6.3], 8.0), 10, 1.0)
    rng = np.random.default_rng(3)
    radius, turn = 8 * np.sqrt(rng.random(4000)), rng.uniform(0, 2 * np.pi, 4000)
    lid = np.column_stack([0.1 + radius * np.cos(turn), radius * np.sin(turn), 0 * turn + 6.3])
    assert np.abs(sample_distance(field, lid)).max() < 1e-6


def test_a_groove_is_as_sharp_as_a_ridge():
    def ell(points: np.ndarray) -> np.ndarray:
        """The outside of a box: its edges, seen from the body, are grooves."""
        return -box_distance(points, [-5.3, -4.1, -3.7], [5.2, 4.4, 3.9])

    surface = box_surface(np.array([-5.3, -4.1, -3.7]), np.array([5.2, 4.4, 3.9]))
    assert np.abs(sample_distance(stored(ell, 8.0, 1.0), surface)).max() < 1e-6


def test_a_mesh_is_read_back_as_its_own_facets(box_mesh):
    low, high = [-6.13, -4.32, -2.71], [6.2, 4.4, 3.1]
    field = mesh_field(*box_mesh(low, high), Grid.enclosing(np.array(low), np.array(high), 0.7))
    surface = box_surface(np.array(low), np.array(high))
    assert np.abs(sample_distance(field, surface)).max() < 1e-6
    trilinear = sample_distance(replace(field, exact=False), surface)
    assert np.abs(trilinear).max() > 0.05  # what it would be without


def test_nodes_themselves_give_their_own_values():
    field = stored(lambda p: sphere_distance(p, [0.1, 0.2, 0.3], 5.0), 6.0, 0.8)
    nodes = field.grid.window().node_points()
    assert sample_distance(field, nodes) == pytest.approx(field.values.reshape(-1), abs=1e-5)
