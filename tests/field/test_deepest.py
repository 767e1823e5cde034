"""The deepest place of bodies whose middle lies between the nodes."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.field.grid import Grid
from lmctl.field.maximum_depth import find_maximum_depth
from lmctl.field.mesh.mesh_field import mesh_field
from lmctl.field.primitives import box_distance, sphere_distance, torus_distance
from tests.field.stored_field import stored_field

MIDDLE = np.array([0.31, 0.47, -0.22])


def test_the_middle_of_a_ball_between_nodes():
    grid = Grid.enclosing(MIDDLE - 20.0, MIDDLE + 20.0, 1.0)
    field = stored_field(lambda p: sphere_distance(p, MIDDLE, 20.0), grid)
    assert field.values.max() < 19.5
    depth, place = find_maximum_depth(field)
    assert depth == pytest.approx(20.0, abs=1e-3)
    assert np.linalg.norm(place - MIDDLE) < 0.01


def test_the_middle_plane_of_a_plate(box_mesh):
    half = np.array([7.0, 5.0, 1.3])
    low, high = MIDDLE - half, MIDDLE + half
    field = mesh_field(*box_mesh(list(low), list(high)), Grid.enclosing(low, high, 0.5))
    depth, place = find_maximum_depth(field)
    assert depth == pytest.approx(1.3, abs=1e-6)
    assert box_distance(place[None], low, high)[0] == pytest.approx(1.3, abs=1e-6)


def test_a_box_of_triangles(box_mesh):
    half = np.array([15.0, 11.0, 8.0])
    low, high = MIDDLE - half, MIDDLE + half
    field = mesh_field(*box_mesh(list(low), list(high)), Grid.enclosing(low, high, 1.0))
    assert field.values.max() < 7.8
    assert find_maximum_depth(field)[0] == pytest.approx(8.0, abs=1e-6)


def test_the_circle_within_a_torus():
    grid = Grid.enclosing(np.full(3, -17.0), np.full(3, 17.0), 0.7)
    field = stored_field(lambda p: torus_distance(p, MIDDLE, [0.3, 0.2, 0.9], 11.0, 5.0), grid)
    depth, place = find_maximum_depth(field)
    true = torus_distance(place[None], MIDDLE, [0.3, 0.2, 0.9], 11.0, 5.0)[0]
    assert depth == pytest.approx(5.0, abs=0.03)
    assert true > 4.97


def test_never_less_than_a_node_says():
    grid = Grid.enclosing(np.full(3, -6.0), np.full(3, 6.0), 0.5)
    field = stored_field(lambda p: sphere_distance(p, [0, 0, 0], 6.0), grid)
    assert find_maximum_depth(field)[0] >= 6.0
