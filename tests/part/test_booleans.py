"""Booleans as true distances: the table of discs, laws of sets, bodies that nest, touch, agree."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.stored import stored_field
from lmctl.part.bodies import Body, FieldSolid
from lmctl.part.combined import Combined, Operation
from lmctl.part.formulas import Box, Cylinder, HalfSpace, Sphere

FloatArray = NDArray[np.float64]
OPERATIONS: tuple[Operation, ...] = ("union", "intersection", "difference")
A, B = Cylinder((0, 0, -40), (0, 0, 40), 10), Cylinder((12, 0, -40), (12, 0, 40), 10)


def combined(operation: Operation, bodies: tuple[Body, ...], pitch: float = 0.5) -> Combined:
    low = np.min([b.bounds_mm[0] for b in bodies], axis=0)
    high = np.max([b.bounds_mm[1] for b in bodies], axis=0)
    return Combined(operation, bodies, Grid.around(low, high, pitch))


def places(bodies: tuple[Body, ...], count: int, seed: int = 0) -> FloatArray:
    low = np.min([b.bounds_mm[0] for b in bodies], axis=0) - 2
    high = np.max([b.bounds_mm[1] for b in bodies], axis=0) + 2
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def inside(operation: Operation, bodies: tuple[Body, ...], points: FloatArray) -> NDArray[np.bool_]:
    each = [body.at(points) > 0 for body in bodies]
    if operation == "union":
        return reduce(np.logical_or, each)
    if operation == "intersection":
        return reduce(np.logical_and, each)
    return each[0] & ~reduce(np.logical_or, each[1:])


@pytest.mark.parametrize("operation", OPERATIONS)
def test_slopes_are_one_nearly_everywhere(operation: Operation) -> None:
    """|∇d| = 1 ± 0.02 at 95 % of nodes, those of the medial axis among them."""
    grid = Grid.around(np.array([-12.0, -12, -1]), np.array([24.0, 12, 1]), 0.25)
    middle = grid.shape[0] // 2
    body = Combined(operation, (A, B), grid)
    values = body.distance(grid.window(middle - 1, middle + 2)).astype(float)
    slopes = np.array(np.gradient(values, 0.25))[:, 1]
    assert np.mean(np.abs(np.linalg.norm(slopes, axis=0) - 1) < 0.02) > 0.97


NESTED = (Box((0, 0, 0), (10, 8, 6)), Sphere((5, 4, 3), 2))
OVERLAPPING = (Box((0, 0, 0), (10, 8, 6)), Box((4, 3, 2), (14, 12, 9)))
DISJOINT = (Sphere((0, 0, 0), 4), Sphere((10, 1, 0), 3))
TOUCHING = (Box((0, 0, 0), (10, 8, 6)), Box((10, 0, 0), (16, 8, 6)))
TANGENT = (Sphere((0, 0, 0), 5), Sphere((8, 0, 0), 3))
SAME = (Sphere((0, 0, 0), 5), Sphere((0, 0, 0), 5))


@pytest.mark.parametrize(
    ("operation", "bodies", "truth", "tolerance"),
    [
        ("union", NESTED, NESTED[0].at, 1e-9),
        ("intersection", NESTED, NESTED[1].at, 1e-9),
        ("difference", NESTED, lambda p: np.minimum(NESTED[0].at(p), -NESTED[1].at(p)), 1e-9),
        ("intersection", OVERLAPPING, Box((4, 3, 2), (10, 8, 6)).at, 0.02),
        ("union", DISJOINT, lambda p: np.maximum(DISJOINT[0].at(p), DISJOINT[1].at(p)), 1e-9),
        ("difference", DISJOINT, DISJOINT[0].at, 1e-9),
        ("union", TOUCHING, Box((0, 0, 0), (16, 8, 6)).at, 0.25),
        ("difference", TOUCHING, TOUCHING[0].at, 1e-9),
        ("union", TANGENT, lambda p: np.maximum(TANGENT[0].at(p), TANGENT[1].at(p)), 1e-9),
        ("union", SAME, SAME[0].at, 1e-9),
        ("intersection", SAME, SAME[0].at, 1e-9),
    ],
)
def test_bodies_that_nest_touch_or_agree(
    operation: Operation, bodies: tuple[Body, ...], truth: Callable[[FloatArray], FloatArray],
    tolerance: float,
) -> None:
    points = places(bodies, 4000)
    body = combined(operation, bodies)
    found, true = body.at(points), truth(points)
    assert np.abs(found - true).max() < tolerance
    assert np.mean(np.abs(found - true) < 0.02) > 0.99
    feet = body.feet(points)
    assert np.abs(np.linalg.norm(feet - points, axis=1) - np.abs(found)).max() < 0.01


@pytest.mark.parametrize(
    ("operation", "bodies"),
    [("difference", SAME), ("intersection", DISJOINT), ("intersection", TOUCHING),
     ("intersection", TANGENT), ("difference", (NESTED[1], NESTED[0]))],
)
def test_nothing_left(operation: Operation, bodies: tuple[Body, ...]) -> None:
    with pytest.raises(InputError, match=f"the {operation} of the bodies leaves nothing"):
        _ = combined(operation, bodies).bounds_mm


def test_a_lens_thinner_than_the_pitch_is_found() -> None:
    lens = combined("intersection", (Sphere((0, 0, 0), 10), Sphere((19.9, 0, 0), 10)), pitch=0.5)
    assert lens.bounds_mm[0] == pytest.approx([9.9, -1, -1], abs=0.01)
    assert lens.at(np.array([[9.95, 0, 0]])) == pytest.approx([0.05])


def test_difference_of_several_and_bodies_without_end() -> None:
    plate = Box((0, 0, 0), (20, 10, 4))
    holes = tuple(Cylinder((x, 5, -9), (x, 5, 9), 2) for x in (4.0, 10.0, 16.0))
    body = combined("difference", (plate, *holes))
    assert body.bounds_mm[1] == pytest.approx([20, 10, 4])
    assert body.at(np.array([[10.0, 5, 2], [7, 5, 2], [10, 5, -3]])) == pytest.approx(
        [-2, 1, -np.hypot(2, 3)], abs=1e-3)
    half = Combined("intersection", (Sphere((0, 0, 0), 6), HalfSpace((0, 0, 0), (0, 0, -1))),
                    Grid.around(np.array([-6.0, -6, 0]), np.full(3, 6.0), 0.5))
    assert half.bounds_mm[0] == pytest.approx([-6, -6, 0], abs=0.01)
    assert half.at(np.array([[0, 0, 2.0], [8, 0, -2], [0, 0, -3]])) == pytest.approx(
        [2, -np.hypot(2, 2), -3], abs=1e-6)


def test_stored_leaves_of_different_pitch_meet_at_the_true_surface() -> None:
    """Sphere R 20 at pitch 1 with sphere R 6 at pitch 0.25: ≤ 1e-4 mm at the true surface."""
    balls = (Sphere((0, 0, 0), 20), Sphere((21, 3, 2), 6))
    leaves = tuple(
        FieldSolid(stored_field(ball.at, Grid.around(*ball.bounds_mm, pitch)))
        for ball, pitch in zip(balls, (1.0, 0.25), strict=True)
    )
    union = combined("union", leaves, pitch=1.0)
    points = places(balls, 6000, seed=4)
    surface = np.vstack([ball.feet(points) for ball in balls])
    surface = surface[np.maximum(*(ball.at(surface) for ball in balls)) < 1e-9]
    assert len(surface) > 7000
    assert np.abs(union.at(surface)).max() <= 1e-4
    exact = combined("union", balls, pitch=1.0)
    near = np.random.default_rng(1).uniform(*balls[1].bounds_mm, (1000, 3))
    assert np.quantile(np.abs(union.at(near) - exact.at(near)), 0.99) < 0.02


#: Fields are slow to make: what is found is not made smaller.
FOUND = (Phase.explicit, Phase.generate)

centres = st.tuples(*[st.floats(-4, 4)] * 3)
balls = st.builds(Sphere, centres, st.floats(1.5, 5))
boxes = st.builds(
    lambda c, h: Box(tuple(c[k] - h[k] for k in range(3)), tuple(c[k] + h[k] for k in range(3))),
    centres, st.tuples(*[st.floats(1, 4)] * 3),
)
pairs = st.tuples(balls | boxes, balls | boxes)


@settings(max_examples=8, deadline=None, phases=FOUND)
@given(pairs)
def test_laws_of_sets(bodies: tuple[Body, Body]) -> None:
    """Signs are those of the sets; union and intersection do not mind their order; De Morgan:
    what is in neither is what is outside of both."""
    points = places(bodies, 400)
    for operation in OPERATIONS:
        try:
            body = combined(operation, bodies, 1.0)
            found = body.at(points)
        except InputError:
            assert not inside(operation, bodies, points).any()
            continue
        clear = np.abs(found) > 1e-9
        np.testing.assert_array_equal((found > 0)[clear], inside(operation, bodies, points)[clear])
        if operation != "difference":
            turned = combined(operation, bodies[::-1], 1.0).at(points)
            np.testing.assert_allclose(turned, found, atol=0.05)
    # De Morgan within a block around both: ¬(A ∪ B) = ¬A ∩ ¬B
    block = Box((-15, -15, -15), (15, 15, 15))
    neither = combined("difference", (block, *bodies), 1.0).at(points)
    outsides = tuple(combined("difference", (block, body), 1.0) for body in bodies)
    assert np.quantile(
        np.abs(neither - combined("intersection", outsides, 1.0).at(points)), 0.98) < 0.05


@settings(max_examples=8, deadline=None, phases=FOUND)
@given(pairs)
def test_distances_are_bounded_by_those_of_min_and_max(bodies: tuple[Body, Body]) -> None:
    """A true distance is nowhere less deep than max and min of the bodies' say, and changes by at
    most 1 mm per mm."""
    points = places(bodies, 300)
    steps = np.random.default_rng(2).normal(size=points.shape) * 0.3
    union = combined("union", bodies, 1.0)
    found, beside = union.at(points), union.at(points + steps)
    assert (found >= np.maximum(*(b.at(points) for b in bodies)) - 1e-9).all()
    excess = np.abs(found - beside) - np.linalg.norm(steps, axis=1)
    assert np.quantile(excess, 0.99) < 0.02
