"""Equal corners and edges of triangle soups, against numpy's own unique."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.part.sources import mesh_topology
from lmctl.part.sources.mesh_topology import edge_counts, edge_numbers, merge_equal_vertices


def soup(n, seed=0):
    rng = np.random.default_rng(seed)
    vertices = rng.integers(-3, 6, (n, 3)) * np.where(rng.random((n, 1)) < 0.2, -0.0, 1.0)
    return vertices, rng.integers(0, n, (2 * n, 3))


@pytest.mark.parametrize("n", [1, 4, 300, 5000])
def test_equal_corners_become_one_and_no_triangle_moves(n):
    vertices, triangles = soup(n)
    points, numbers = merge_equal_vertices(vertices, triangles)
    assert (points[numbers] == vertices[triangles]).all()
    assert len(points) == len(np.unique(vertices + 0.0, axis=0))
    assert (np.lexsort(points.T) == np.arange(len(points))).all()  # the same numbers every time


def test_corners_whose_mixed_bits_agree_are_still_told_apart(monkeypatch):
    monkeypatch.setattr(mesh_topology, "_MIXING", np.zeros(3, dtype=np.uint64))
    vertices, triangles = soup(300)
    points, numbers = merge_equal_vertices(vertices, triangles)
    assert (points[numbers] == vertices[triangles]).all()
    assert len(points) == len(np.unique(vertices + 0.0, axis=0))


def test_a_mesh_of_nothing_stays_one():
    points, numbers = merge_equal_vertices(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    assert points.shape == numbers.shape == (0, 3)
    assert len(edge_counts(numbers)) == 0


def test_edges_are_counted_as_they_are_numbered():
    _, triangles = soup(200, seed=1)
    assert sorted(edge_counts(triangles)) == sorted(edge_numbers(triangles)[1])
