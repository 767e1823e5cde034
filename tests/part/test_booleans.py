"""Booleans as true distances: the table of discs, laws of sets, bodies that nest, touch, agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.array_types import FloatArray
from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.formulas import Box, Cylinder, Sphere, Torus
from lmctl.part.bodies.half_space import HalfSpace
from lmctl.part.bodies.prism import Prism
from lmctl.part.bodies.stored import FieldSolid
from lmctl.part.bodies.transformed import TransformedBody, similarity_transform
from lmctl.part.booleans.combined import CombinedBody, Operation
from tests.field.stored_field import stored_field

OPERATIONS: tuple[Operation, ...] = ("union", "intersection", "difference")
A, B = Cylinder((0, 0, -40), (0, 0, 40), 10), Cylinder((12, 0, -40), (12, 0, 40), 10)


def combined(operation: Operation, bodies: tuple[Body, ...], pitch: float = 0.5) -> CombinedBody:
    low = np.min([b.enclosing_box_mm[0] for b in bodies], axis=0)
    high = np.max([b.enclosing_box_mm[1] for b in bodies], axis=0)
    return CombinedBody(operation, bodies, Grid.enclosing(low, np.maximum(low, high), pitch))


def places(bodies: tuple[Body, ...], count: int, seed: int = 0) -> FloatArray:
    low = np.min([b.tight_bounds_mm[0] for b in bodies], axis=0) - 2
    high = np.max([b.tight_bounds_mm[1] for b in bodies], axis=0) + 2
    return np.random.default_rng(seed).uniform(low, high, (count, 3))


def inside(operation: Operation, bodies: tuple[Body, ...], points: FloatArray) -> NDArray[np.bool_]:
    each = [body.distance_at(points) > 0 for body in bodies]
    if operation == "union":
        return reduce(np.logical_or, each)
    if operation == "intersection":
        return reduce(np.logical_and, each)
    return each[0] & ~reduce(np.logical_or, each[1:])


@pytest.mark.parametrize("operation", OPERATIONS)
def test_slopes_are_one_nearly_everywhere(operation: Operation) -> None:
    """|∇d| = 1 ± 0.02 at 95 % of nodes, those of the medial axis among them."""
    grid = Grid.enclosing(np.array([-12.0, -12, -1]), np.array([24.0, 12, 1]), 0.25)
    middle = grid.shape[0] // 2
    body = CombinedBody(operation, (A, B), grid)
    values = body.distance(grid.window(middle - 1, middle + 2)).astype(float)
    slopes = np.array(np.gradient(values, 0.25))[:, 1]
    assert np.mean(np.abs(np.linalg.norm(slopes, axis=0) - 1) < 0.02) > 0.97


NESTED = (Box((0, 0, 0), (10, 8, 6)), Sphere((5, 4, 3), 2))
OVERLAPPING = (Box((0, 0, 0), (10, 8, 6)), Box((4, 3, 2), (14, 12, 9)))
DISJOINT = (Sphere((0, 0, 0), 4), Sphere((10, 1, 0), 3))
TOUCHING = (Box((0, 0, 0), (10, 8, 6)), Box((10, 0, 0), (16, 8, 6)))
TANGENT = (Sphere((0, 0, 0), 5), Sphere((8, 0, 0), 3))
SAME = (Sphere((0, 0, 0), 5), Sphere((0, 0, 0), 5))
FLUSH = (Box((0, 0, 0), (10, 8, 6)), Box((3, 2, 0), (7, 8, 9)))  # one foot and one side in common
SQUARE = np.array([(0.0, 0), (10, 0), (10, 8), (0, 8), (0, 0)])
TWINS = (Box((0, 0, 0), (10, 8, 6)), Prism(SQUARE, 0.0, 6.0))  # the same, and not known to be


@pytest.mark.parametrize(
    ("operation", "bodies", "truth", "tolerance"),
    [
        ("union", NESTED, NESTED[0].distance_at, 1e-9),
        ("intersection", NESTED, NESTED[1].distance_at, 1e-9),
        ("difference", NESTED,
         lambda p: np.minimum(NESTED[0].distance_at(p), -NESTED[1].distance_at(p)), 1e-9),
        ("intersection", OVERLAPPING, Box((4, 3, 2), (10, 8, 6)).distance_at, 1e-3),
        ("union", DISJOINT,
         lambda p: np.maximum(DISJOINT[0].distance_at(p), DISJOINT[1].distance_at(p)), 1e-9),
        ("difference", DISJOINT, DISJOINT[0].distance_at, 1e-9),
        ("union", TOUCHING, Box((0, 0, 0), (16, 8, 6)).distance_at, 1e-9),
        ("difference", TOUCHING, TOUCHING[0].distance_at, 1e-9),
        ("intersection", FLUSH, Box((3, 2, 0), (7, 8, 6)).distance_at, 1e-9),
        ("union", TWINS, TWINS[0].distance_at, 1e-9),
        ("intersection", TWINS, TWINS[0].distance_at, 1e-9),
        ("union", TANGENT,
         lambda p: np.maximum(TANGENT[0].distance_at(p), TANGENT[1].distance_at(p)), 1e-9),
        ("union", SAME, SAME[0].distance_at, 1e-9),
        ("intersection", SAME, SAME[0].distance_at, 1e-9),
    ],
)
def test_bodies_that_nest_touch_or_agree(
    operation: Operation, bodies: tuple[Body, ...], truth: Callable[[FloatArray], FloatArray],
    tolerance: float,
) -> None:
    points = places(bodies, 4000)
    body = combined(operation, bodies)
    found, true = body.distance_at(points), truth(points)
    assert np.abs(found - true).max() < tolerance
    feet = body.closest_points(points)
    assert np.abs(np.linalg.norm(feet - points, axis=1) - np.abs(found)).max() < 0.01


@pytest.mark.parametrize(
    ("operation", "bodies"),
    [("difference", SAME), ("difference", TWINS), ("intersection", DISJOINT),
     ("intersection", TOUCHING), ("intersection", TANGENT), ("difference", (NESTED[1], NESTED[0]))],
)
def test_nothing_left(operation: Operation, bodies: tuple[Body, ...]) -> None:
    with pytest.raises(InputError, match=f"the {operation} of the bodies leaves nothing"):
        _ = combined(operation, bodies).tight_bounds_mm


def test_a_lens_thinner_than_the_pitch_is_found() -> None:
    lens = combined("intersection", (Sphere((0, 0, 0), 10), Sphere((19.9, 0, 0), 10)), pitch=0.5)
    assert lens.tight_bounds_mm[0] == pytest.approx([9.9, -1, -1], abs=0.01)
    assert lens.distance_at(np.array([[9.95, 0, 0]])) == pytest.approx([0.05])


def test_difference_of_several_and_bodies_without_end() -> None:
    plate = Box((0, 0, 0), (20, 10, 4))
    holes = tuple(Cylinder((x, 5, -9), (x, 5, 9), 2) for x in (4.0, 10.0, 16.0))
    body = combined("difference", (plate, *holes))
    assert body.tight_bounds_mm[1] == pytest.approx([20, 10, 4])
    assert body.distance_at(np.array([[10.0, 5, 2], [7, 5, 2], [10, 5, -3]])) == pytest.approx(
        [-2, 1, -np.hypot(2, 3)], abs=1e-3)
    half = CombinedBody("intersection", (Sphere((0, 0, 0), 6), HalfSpace((0, 0, 0), (0, 0, -1))),
                        Grid.enclosing(np.array([-6.0, -6, 0]), np.full(3, 6.0), 0.5))
    assert half.tight_bounds_mm[0] == pytest.approx([-6, -6, 0], abs=0.01)
    assert half.distance_at(np.array([[0, 0, 2.0], [8, 0, -2], [0, 0, -3]])) == pytest.approx(
        [2, -np.hypot(2, 2), -3], abs=1e-6)


def test_stored_leaves_of_different_pitch_meet_at_the_true_surface() -> None:
    """Sphere R 20 at pitch 1 with sphere R 6 at pitch 0.25: ≤ 1e-4 mm at the true surface."""
    balls = (Sphere((0, 0, 0), 20), Sphere((21, 3, 2), 6))
    leaves = tuple(
        FieldSolid(stored_field(ball.distance_at, Grid.enclosing(*ball.tight_bounds_mm, pitch)))
        for ball, pitch in zip(balls, (1.0, 0.25), strict=True)
    )
    union = combined("union", leaves, pitch=1.0)
    points = places(balls, 6000, seed=4)
    surface = np.vstack([ball.closest_points(points) for ball in balls])
    surface = surface[np.maximum(*(ball.distance_at(surface) for ball in balls)) < 1e-9]
    assert len(surface) > 7000
    assert np.abs(union.distance_at(surface)).max() <= 1e-4
    exact = combined("union", balls, pitch=1.0)
    near = np.random.default_rng(1).uniform(*balls[1].tight_bounds_mm, (1000, 3))
    assert np.quantile(np.abs(union.distance_at(near) - exact.distance_at(near)), 0.99) < 0.02


#: Fields are slow to make: what is found is not made smaller.
FOUND = (Phase.explicit, Phase.generate)
BLOCK = Box((-10, -10, -10), (10, 10, 10))

# Whole numbers now and then, so that faces lie flush.
lengths = st.floats(-4, 4) | st.integers(-4, 4).map(float)
sizes = st.floats(1, 4) | st.integers(1, 4).map(float)
balls = st.builds(Sphere, st.tuples(*[lengths] * 3), sizes)
boxes = st.builds(
    lambda c, h: Box(tuple(c[k] - h[k] for k in range(3)), tuple(c[k] + h[k] for k in range(3))),
    st.tuples(*[lengths] * 3), st.tuples(*[sizes] * 3),
)
turned = st.builds(
    lambda box, axis,
    degrees: TransformedBody(box, similarity_transform(1.0, axis, degrees, (0, 0, 0), (0.3, 0, 0))),
    boxes, st.sampled_from([(0, 0, 1), (1, 2, 3)]), st.floats(10, 80),
)
bodies_of_all_kinds = balls | boxes | turned


def united(*bodies: Body) -> CombinedBody:
    return combined("union", bodies, 1.0)


def common(*bodies: Body) -> CombinedBody:
    return combined("intersection", bodies, 1.0)


def less(*bodies: Body) -> CombinedBody:
    return combined("difference", bodies, 1.0)


Law = Callable[[Body, Body, Body], tuple[Body, Body]]
LAWS: dict[str, Law] = {
    "De Morgan of a union": lambda a, b, c: (
        less(BLOCK, united(a, b)), common(less(BLOCK, a), less(BLOCK, b))),
    "De Morgan of an intersection": lambda a, b, c: (
        less(BLOCK, common(a, b)), united(less(BLOCK, a), less(BLOCK, b))),
    "order of a union": lambda a, b, c: (united(a, b), united(b, a)),
    "order of an intersection": lambda a, b, c: (common(a, b), common(b, a)),
    "grouping of a union": lambda a, b, c: (united(united(a, b), c), united(a, united(b, c))),
    "grouping of an intersection": lambda a, b, c: (
        common(common(a, b), c), common(a, common(b, c))),
    "distribution": lambda a, b, c: (common(a, united(b, c)), united(common(a, b), common(a, c))),
    "a body with itself": lambda a, b, c: (united(a, a), a),
    "a difference by what is common": lambda a, b, c: (less(a, common(a, b)), less(a, b)),
    "absorption by a union": lambda a, b, c: (united(a, common(a, b)), a),
    "absorption by an intersection": lambda a, b, c: (common(a, united(a, b)), a),
}


@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=3, deadline=None, phases=FOUND, derandomize=True)
@given(bodies_of_all_kinds, bodies_of_all_kinds, bodies_of_all_kinds)
def test_laws_of_sets(law: str, a: Body, b: Body, c: Body) -> None:
    """Everywhere within 0.05 mm, at a pitch of 1 mm; equally empty where one is."""
    points = np.random.default_rng(1).uniform(-9, 9, (300, 3))
    found = [at_or_empty(body, points) for body in LAWS[law](a, b, c)]
    assert (found[0] is None) == (found[1] is None)
    if found[0] is not None and found[1] is not None:
        assert np.abs(found[0] - found[1]).max() < 0.05


def at_or_empty(body: Body, points: FloatArray) -> FloatArray | None:
    try:
        _ = body.tight_bounds_mm
    except InputError:
        return None
    return body.distance_at(points)


def test_a_body_less_itself_is_refused_however_it_is_said() -> None:
    a, b = Box((0, 0, 0), (6, 5, 4)), Sphere((2, 2, 2), 3)
    for nothing in (less(a, a), less(common(a, b), a), less(a, united(a, b)),
                    common(less(a, b), b), less(b, united(common(a, b), less(b, a)))):
        with pytest.raises(InputError, match="of the bodies leaves nothing"):
            _ = nothing.tight_bounds_mm


def surface_of(body: Sphere | Box, count: int, rng: np.random.Generator) -> FloatArray:
    """Points spread over a ball or a box."""
    if isinstance(body, Sphere):
        ways = rng.normal(size=(count, 3))
        return np.array(body.centre_mm) + body.radius_mm * (
            ways / np.linalg.norm(ways, axis=1)[:, None])
    low, high = np.array(body.low_mm), np.array(body.high_mm)
    size = high - low
    areas = np.repeat([size[1] * size[2], size[0] * size[2], size[0] * size[1]], 2)
    faces = rng.choice(6, size=count, p=areas / areas.sum())
    points = rng.uniform(low, high, (count, 3))
    axis = faces // 2
    points[np.arange(count), axis] = np.where(faces % 2 == 0, low[axis], high[axis])
    return points


Set = Callable[[Sequence[NDArray[np.bool_]]], NDArray[np.bool_]]
TREES: dict[str, tuple[Callable[[Body, Body, Body], Body], Set]] = {
    "(a | b) - c": (lambda a, b, c: less(united(a, b), c), lambda s: (s[0] | s[1]) & ~s[2]),
    "a - (b - c)": (lambda a, b, c: less(a, less(b, c)), lambda s: s[0] & ~(s[1] & ~s[2])),
    "(a & b) | c": (lambda a, b, c: united(common(a, b), c), lambda s: (s[0] & s[1]) | s[2]),
    "a & (b | c)": (lambda a, b, c: common(a, united(b, c)), lambda s: s[0] & (s[1] | s[2])),
    "a ^ b": (lambda a, b, c: united(less(a, b), less(b, a)), lambda s: s[0] ^ s[1]),
}


def random_leaf(rng: np.random.Generator) -> Sphere | Box:
    centre, half = rng.uniform(-4, 4, 3), rng.uniform(1, 4, 3)
    if rng.random() < 0.5:
        return Sphere(tuple(centre), half[0])
    return Box(tuple(centre - half), tuple(centre + half))


@pytest.mark.parametrize("tree", TREES)
@settings(max_examples=4, deadline=None, phases=FOUND, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_trees_against_a_dense_sample_of_their_surface(tree: str, seed: int) -> None:
    """The sample is never nearer than the surface, and misses it by its spacing at most."""
    build, holds = TREES[tree]
    rng = np.random.default_rng(seed)
    leaves = [random_leaf(rng) for _ in range(3)]
    samples = []
    for number, leaf in enumerate(leaves):
        on = surface_of(leaf, 20_000, rng)
        sides = [other.distance_at(on) > 0 for other in leaves]
        with_it, without = list(sides), list(sides)
        with_it[number], without[number] = np.ones(len(on), bool), np.zeros(len(on), bool)
        samples.append(on[holds(with_it) != holds(without)])
    surface = np.concatenate(samples)
    points = rng.uniform(-8, 8, (400, 3))
    found = at_or_empty(build(*leaves), points)
    if found is None:
        assert len(surface) < 50  # a crumb, if anything
        return
    np.testing.assert_array_equal(found > 0,
                                  holds([leaf.distance_at(points) > 0 for leaf in leaves]))
    if len(surface) > 3000:  # a crumb is sampled too thinly
        sampled = cKDTree(surface).query(points)[0]
        assert (np.abs(found) < sampled + 0.05).all()
        assert (np.abs(found) > sampled - 0.3).all()


@pytest.mark.parametrize("seed", range(12))
def test_no_corner_is_missed_where_a_ball_cuts_an_edge(seed: int) -> None:
    """Such a corner belongs to the body, so nothing is farther away from the body than from it;
    around it the body fills as little of all directions as the ball leaves of the edge."""
    rng = np.random.default_rng(seed)
    corner, way = np.array([rng.uniform(1, 3), 4, 4]), rng.uniform((0.3, -3, -3), (2, 1, 1))
    ball = Sphere(tuple(corner + way), float(np.linalg.norm(way)))
    body = less(Box((0, 0, 0), (4, 4, 4)), ball)
    points = corner + rng.uniform((-1, 0, 0), (1, 2, 2), (200, 3))
    away = np.linalg.norm(points - corner, axis=1)
    assert (np.abs(body.distance_at(points)) <= away + 1e-6).all()


def test_walls_that_bodies_share_hide_no_others() -> None:
    """a less ((a ∪ b) less c) is a ∩ c, also where a is said twice and several walls are near."""
    corners = [(6, 7), (14, 7), (14, 13), (6, 13), (6, 12.2667), (5.9994, 9.6049), (6, 7.8229)]
    loop = np.array([*corners, corners[0]], dtype=float)
    a, again = Prism(loop, 3, 9), Prism(loop.copy(), 3, 9)
    b, c = Torus((6, 9, 10), (1, 0, 0), 3, 1), Cylinder((7, 12, 5), (0, 12, 5), 5)
    said = combined("difference", (a, combined("difference", (
        combined("union", (again, b), 0.49), c), 0.49)), 0.49)
    points = np.random.default_rng(0).uniform((2, 4, 1), (9, 15, 11), (6000, 3))
    meant = combined("intersection", (a, c), 0.49).distance_at(points)
    np.testing.assert_allclose(said.distance_at(points), meant, atol=1e-4)


@settings(max_examples=6, deadline=None, phases=FOUND, derandomize=True)
@given(st.tuples(bodies_of_all_kinds, bodies_of_all_kinds))
def test_distances_are_bounded_by_those_of_min_and_max(bodies: tuple[Body, Body]) -> None:
    """A true distance is nowhere less deep than max and min of the bodies' say, and changes by at
    most 1 mm per mm."""
    points = places(bodies, 300)
    steps = np.random.default_rng(2).normal(size=points.shape) * 0.3
    union = combined("union", bodies, 1.0)
    found, beside = union.distance_at(points), union.distance_at(points + steps)
    assert (found >= np.maximum(*(b.distance_at(points) for b in bodies)) - 1e-9).all()
    excess = np.abs(found - beside) - np.linalg.norm(steps, axis=1)
    assert np.quantile(excess, 0.99) < 0.02


def test_the_largest_depth_of_nested_booleans_is_refined() -> None:
    bar = united(Box((0, 0, 0), (10, 8, 6)), Box((10, 0, 0), (16, 8, 6)))
    assert bar.maximum_depth_mm == pytest.approx(3, abs=1e-3)
    # A cube with a hollow cube in it, and in that a solid one: deepest in the corners around.
    hollow = less(Box((5, 5, 5), (15, 15, 15)), Box((7, 7, 7), (13, 13, 13)))
    cube = less(Box((0, 0, 0), (20, 20, 20)), hollow)
    assert cube.maximum_depth_mm == pytest.approx(5 * 3**0.5 / (1 + 3**0.5), abs=1e-3)
