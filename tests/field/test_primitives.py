"""Analytic bodies and features against distances measured to points on their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from lmctl.field import features, primitives

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-6.0, 6.0, (400, 3))


def turned(points: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Points of a body that stands on z = 0 along z, moved to stand along an axis."""
    z = axis / np.linalg.norm(axis)
    x = np.cross([0.3, 0.5, 0.8], z)
    x /= np.linalg.norm(x)
    return points @ np.stack([x, np.cross(z, x), z])


def disc(radius: float, count: int) -> np.ndarray:
    r, a = radius * np.sqrt(RNG.random(count)), RNG.uniform(0, 2 * np.pi, count)
    return np.column_stack([r * np.cos(a), r * np.sin(a), np.zeros(count)])


def mantle(base: float, top: float, height: float, count: int) -> np.ndarray:
    t, a = RNG.random(count), RNG.uniform(0, 2 * np.pi, count)
    r = base + (top - base) * t
    return np.column_stack([r * np.cos(a), r * np.sin(a), height * t])


BASE, AXIS = np.array([-1.0, 0.5, -2.0]), np.array([1.0, 2.0, 3.0])
HEIGHT = float(np.linalg.norm(AXIS))


def cone_surface(base: float, top: float) -> np.ndarray:
    lid = disc(top, 60_000) + np.array([0, 0, HEIGHT])
    parts = np.vstack([disc(base, 60_000), lid, mantle(base, top, HEIGHT, 120_000)])
    return BASE + turned(parts, AXIS)


def box_surface() -> np.ndarray:
    points = RNG.uniform(0, 1, (240_000, 3))
    axis = RNG.integers(0, 3, len(points))
    points[np.arange(len(points)), axis] = RNG.integers(0, 2, len(points))
    return np.array([-3.0, -1.0, -2.0]) + points * [5.0, 3.0, 6.0]


def ring_surface() -> np.ndarray:
    u, v = RNG.uniform(0, 2 * np.pi, (2, 240_000))
    r = 3.0 + 1.2 * np.cos(v)
    return BASE + turned(np.column_stack([r * np.cos(u), r * np.sin(u), 1.2 * np.sin(v)]), AXIS)


@pytest.mark.parametrize(
    ("distance", "surface", "inside", "outside"),
    [
        (lambda p: primitives.box_distance(p, [-3, -1, -2], [2, 2, 4]), box_surface(),
         [0, 0, 0], [3, 0, 0]),
        (lambda p: primitives.cylinder_distance(p, BASE, BASE + AXIS, 1.7), cone_surface(1.7, 1.7),
         BASE + 0.5 * AXIS, BASE - AXIS),
        (lambda p: primitives.cone_distance(p, BASE, BASE + AXIS, 2.0, 0.5),
         cone_surface(2.0, 0.5), BASE + 0.2 * AXIS, BASE + 1.1 * AXIS),
        (lambda p: primitives.cone_distance(p, BASE, BASE + AXIS, 0.0, 2.0),
         cone_surface(0.0, 2.0), BASE + 0.8 * AXIS, BASE + 0.05 * AXIS + [0.5, 0, 0]),
        (lambda p: primitives.torus_distance(p, BASE, AXIS, 3.0, 1.2), ring_surface(),
         BASE + turned(np.array([[3.0, 0.3, 0.2]]), AXIS)[0], BASE),
    ],
    ids=["box", "cylinder", "frustum", "cone", "torus"],
)
def test_distance_to_the_surface_and_its_sign(distance, surface, inside, outside):
    nearest = cKDTree(surface).query(POINTS)[0]
    assert np.abs(distance(POINTS)) == pytest.approx(nearest, abs=0.05)
    assert distance(np.array([inside], dtype=float))[0] > 0
    assert distance(np.array([outside], dtype=float))[0] < 0
    assert np.abs(distance(surface[::500])).max() < 1e-9


def test_sphere_and_half_space_in_closed_form():
    points = np.array([[0.0, 0, 0], [3.0, 4.0, 0], [0, 0, 9.0]])
    assert primitives.sphere_distance(points, [0, 0, 0], 2.0) == pytest.approx([2, -3, -7])
    assert primitives.half_space_distance(points, [0, 0, 2], [0, 0, 7]) == pytest.approx([2, 2, -7])


def test_every_body_has_a_gradient_of_one():
    bodies = [
        lambda p: primitives.box_distance(p, [-3, -1, -2], [2, 2, 4]),
        lambda p: primitives.cylinder_distance(p, BASE, BASE + AXIS, 1.7),
        lambda p: primitives.cone_distance(p, BASE, BASE + AXIS, 2.0, 0.5),
        lambda p: primitives.torus_distance(p, BASE, AXIS, 3.0, 1.2),
    ]
    for body in bodies:
        slope = np.stack([
            (body(POINTS + 1e-5 * e) - body(POINTS - 1e-5 * e)) / 2e-5 for e in np.eye(3)
        ])
        off_medial_axis = np.quantile(np.abs(np.linalg.norm(slope, axis=0) - 1), 0.98)
        assert off_medial_axis < 1e-4


def test_features():
    points = np.array([[1.0, 2.0, 2.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]])
    assert features.point_distance(points, [1, 2, 0]) == pytest.approx([2, np.sqrt(5), np.sqrt(22)])
    assert features.axis_distance(points, [0, 0, 5], [0, 0, -3]) == pytest.approx(
        [np.sqrt(5), 0, 4]
    )
    assert features.segment_distance(points, [0, 0, 0], [3, 0, 0]) == pytest.approx(
        [np.sqrt(8), 0, np.sqrt(10)]
    )
    assert features.segment_distance(points, [1, 2, 0], [1, 2, 0]) == pytest.approx(
        [2, np.sqrt(5), np.sqrt(22)]
    )
    assert features.plane_offset(points, [0, 0, 1], [0, 0, 2]) == pytest.approx([1, -1, 2])


@pytest.mark.parametrize("direction", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [1, 0]])
def test_what_is_no_direction_is_refused(direction):
    with pytest.raises(ValueError, match="no direction"):
        features.axis_distance(np.zeros((1, 3)), [0, 0, 0], direction)
