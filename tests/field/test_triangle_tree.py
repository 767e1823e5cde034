"""Distances asked of triangles, against libigl: near and far, on meshes of many kinds."""

from __future__ import annotations

import igl
import numpy as np
import pytest

from lmctl.field.mesh.triangle_tree import TriangleTree
from lmctl.field.primitives import box_distance
from tests.field.random_meshes import random_mesh


def asked_points(vertices: np.ndarray, triangles: np.ndarray, rng: np.random.Generator,
                 count: int) -> np.ndarray:
    """Beside the surface, within the box, and far outside of it."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    on_it = np.einsum("nk,nkc->nc", rng.dirichlet([1.0, 1.0, 1.0], count),
                      vertices[triangles[rng.integers(len(triangles), size=count)]])
    near = on_it + rng.normal(size=(count, 3)) * rng.choice([1e-3, 0.05, 0.5], (count, 1))
    far = rng.uniform(low - 2 * (high - low), high + 2 * (high - low), (count, 3))
    return np.vstack([near, far, rng.uniform(low, high, (count, 3))])


def true_distance(vertices: np.ndarray, triangles: np.ndarray, points: np.ndarray) -> np.ndarray:
    """By libigl: squared distances and winding numbers, which share nothing with ours."""
    squared = igl.point_mesh_squared_distance(points, vertices, triangles)[0]
    inside = igl.winding_number(vertices, triangles, points) > 0.5
    return np.where(inside, 1.0, -1.0) * np.sqrt(squared)


@pytest.mark.parametrize("seed", range(12))
def test_distances_and_signs_are_those_of_libigl(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices, triangles = random_mesh(rng)
    points = asked_points(vertices, triangles, rng, 200)
    true = true_distance(vertices, triangles, points)
    tree = TriangleTree.of(vertices[triangles])
    got = tree.signed_distance(points)
    np.testing.assert_allclose(np.abs(got), np.abs(true), atol=1e-9)
    away = np.abs(true) > 1e-9
    assert np.array_equal(got[away] > 0, true[away] > 0)
    assert np.array_equal(tree.is_inside(points)[away], true[away] > 0)
    closest, again = tree.closest_points(points)
    np.testing.assert_array_equal(again, got)
    np.testing.assert_allclose(np.linalg.norm(closest - points, axis=1), np.abs(got), atol=1e-12)


@pytest.mark.parametrize("order", ["as they are", "backwards", "shuffled"])
def test_the_order_of_places_does_not_matter(order: str) -> None:
    rng = np.random.default_rng(5)
    vertices, triangles = random_mesh(rng)
    points = asked_points(vertices, triangles, rng, 300)
    rows = {"as they are": np.arange(len(points)), "backwards": np.arange(len(points))[::-1],
            "shuffled": rng.permutation(len(points))}[order]
    tree = TriangleTree.of(vertices[triangles])
    alone = np.array([tree.signed_distance(point[None])[0] for point in points])
    np.testing.assert_allclose(tree.signed_distance(points[rows]), alone[rows], atol=1e-12)


def test_places_straight_below_edges_and_corners_have_their_signs(box_mesh) -> None:
    """Rays upwards through shared edges and corners are counted once, on and off the diagonal."""
    low, high = [-3.0, -2.0, -2.0], [3.0, 2.0, 2.0]
    vertices, triangles = box_mesh(low, high)
    steps = np.linspace(-4.0, 4.0, 17)
    points = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    true = box_distance(points, low, high)
    got = TriangleTree.of(vertices[triangles]).signed_distance(points)
    np.testing.assert_allclose(np.abs(got), np.abs(true), atol=1e-12)
    away = np.abs(true) > 0
    assert np.array_equal(got[away] > 0, true[away] > 0)


@pytest.mark.parametrize("shift", [0.0, 5e4])
def test_slivers_and_triangles_without_area_do_no_harm(box_mesh, shift: float) -> None:
    vertices, triangles = box_mesh([0.0, 0.0, 0.0], [10.0, 10.0, 10.0])
    first = vertices[triangles[0]]
    middle = 0.5 * (first[0] + first[1])  # halves the triangle, with a sliver on its open edge
    corners = np.vstack([
        vertices[triangles[1:]],
        [[first[0], middle, first[2]], [middle, first[1], first[2]], [first[0], first[1], middle]],
    ]) + shift
    points = np.random.default_rng(1).uniform(-15.0, 25.0, (3000, 3))
    true = box_distance(points, [0.0] * 3, [10.0] * 3)
    got = TriangleTree.of(corners).signed_distance(points + shift)
    np.testing.assert_allclose(got, true, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9, 31, 64, 65])
def test_any_number_of_triangles(count: int) -> None:
    rng = np.random.default_rng(count)
    corners = rng.uniform(-5.0, 5.0, (count, 3, 3))
    points = rng.uniform(-8.0, 8.0, (100, 3))
    squared = igl.point_mesh_squared_distance(
        points, corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))[0]
    got = TriangleTree.of(corners).signed_distance(points)
    np.testing.assert_allclose(np.abs(got), np.sqrt(squared), atol=1e-9)
