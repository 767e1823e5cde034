"""Nearest neighbours are those a search tree finds, whatever the cloud is like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lmctl.array_types import FloatArray
from lmctl.field.cloud.neighbour_search import nearest_neighbours, sort_into_cells


def sphere(n: int, rng: np.random.Generator) -> FloatArray:
    ways = rng.normal(size=(n, 3))
    return 10.0 * ways / np.linalg.norm(ways, axis=1)[:, None]


def a_dense_clump(rng: np.random.Generator) -> FloatArray:
    """Half of all points in a hundredth of the surface."""
    return np.vstack([sphere(1500, rng), [10.0, 0.0, 0.0] + 0.1 * rng.normal(size=(1500, 3))])


def dense_lines(rng: np.random.Generator) -> FloatArray:
    points = rng.uniform(0.0, 20.0, (3000, 3))
    points[:, 1] = np.rint(points[:, 1])
    points[:, 2] = np.sin(points[:, 0])
    return points


def two_far_apart(rng: np.random.Generator) -> FloatArray:
    """More cells between them than any table should have."""
    return np.vstack([sphere(1000, rng), sphere(1000, rng) + 1e6])


def a_lattice(_: np.random.Generator) -> FloatArray:
    """Many neighbours as far away as each other."""
    steps = np.arange(14.0)
    return np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(
    "cloud", [lambda rng: sphere(3000, rng), a_dense_clump, dense_lines, two_far_apart, a_lattice]
)
def test_neighbours_are_those_of_a_tree(cloud: Callable[[np.random.Generator], FloatArray]) -> None:
    points = cloud(np.random.default_rng(4))
    distance, rows = nearest_neighbours(sort_into_cells(points, 24), 24)
    expected = cKDTree(points).query(points, k=25)[0][:, 1:]
    np.testing.assert_allclose(distance, expected, rtol=0, atol=1e-9)
    away = np.linalg.norm(points[rows] - points[:, None], axis=2)
    np.testing.assert_allclose(away, distance, rtol=0, atol=1e-9)
    assert not (rows == np.arange(len(points))[:, None]).any()
    assert all(len(set(row)) == 24 for row in rows.tolist())


def test_only_those_asked_about_are_answered() -> None:
    cells = sort_into_cells(sphere(2000, np.random.default_rng(5)), 24)
    some = np.array([3, 1999, 0, 700])
    distance, rows = nearest_neighbours(cells, 6, some)
    everything = nearest_neighbours(cells, 6)
    np.testing.assert_array_equal(distance, everything[0][some])
    np.testing.assert_array_equal(rows, everything[1][some])
