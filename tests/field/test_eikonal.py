"""The paper's scalar solver: first order, with the signs of what it is given."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.field.eikonal import eikonal_distance, solve_eikonal
from lmctl.field.grid import Grid


def ball(pitch: float) -> tuple[np.ndarray, Grid]:
    grid = Grid.enclosing(np.full(3, -6.0), np.full(3, 6.0), pitch)
    true = 5.0 - np.linalg.norm(grid.window().node_points(), axis=1)
    return true.astype(np.float32).reshape(grid.shape), grid


def test_error_halves_with_the_pitch():
    errors = []
    for pitch in (0.8, 0.4, 0.2):
        true, grid = ball(pitch)
        distance, frozen = np.abs(true), np.abs(true) < 1.5 * pitch
        solve_eikonal(distance, frozen, grid.pitch_mm)
        errors.append(float(np.abs(distance - np.abs(true)).mean()))
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.7 * errors[1]


def test_frozen_nodes_keep_what_they_were_given():
    true, grid = ball(0.5)
    distance, frozen = np.abs(true), np.abs(true) < 0.75
    given = distance[frozen].copy()
    solve_eikonal(distance, frozen, grid.pitch_mm)
    assert np.array_equal(distance[frozen], given)


def test_any_function_with_the_right_level_becomes_a_distance():
    true, grid = ball(0.4)
    stretched = (np.sign(true) * true**2 * 3.0 + 0.5 * true).astype(np.float32)
    distance = eikonal_distance(stretched, grid.pitch_mm)
    assert np.array_equal(distance > 0, true > 0)
    # The level is found on straight lines between nodes, where this function bends.
    assert np.abs(distance - true).max() < 1.1 * grid.pitch_mm


def test_a_plane_is_exact_and_round_corners_are_walked_around():
    distance = np.zeros((21, 21, 21), dtype=np.float32)
    frozen = np.zeros(distance.shape, dtype=bool)
    frozen[:, :, 0] = True
    assert solve_eikonal(distance, frozen, 0.5) <= 2
    assert np.abs(distance - 0.5 * np.arange(21)).max() < 1e-5


def test_without_a_start_or_a_level_there_is_nothing_to_solve():
    with pytest.raises(InputError):
        solve_eikonal(np.zeros((3, 3, 3), dtype=np.float32), np.zeros((3, 3, 3), dtype=bool), 1.0)
    with pytest.raises(InputError):
        eikonal_distance(np.ones((3, 3, 3), dtype=np.float32), 1.0)
