"""Measured fields: specks change sides, bounds ignore burrs, real bodies stay."""

from __future__ import annotations

import numpy as np
import pytest

from lmctl.field.field import DistanceField
from lmctl.field.grid import Grid
from lmctl.part.bodies.formulas import Sphere
from lmctl.part.bodies.measured import is_closed, remove_specks, zero_level_bounds


@pytest.fixture
def ball() -> DistanceField:
    grid = Grid.enclosing(np.full(3, -5.0), np.full(3, 5.0), 0.5)
    return DistanceField(grid, Sphere((0, 0, 0), 5).distance(grid.window()), None, np.empty((0, 3)))


def with_values(field: DistanceField, *changes: tuple[tuple[slice, ...], float]) -> DistanceField:
    values = field.values.copy()
    for where, value in changes:
        values[where] = value
    return DistanceField(field.grid, values, None, field.surface_mm)


def test_a_sound_field_is_left_alone(ball: DistanceField) -> None:
    cleared, count = remove_specks(ball)
    assert cleared is ball
    assert count == 0


def test_islands_and_voids_change_sides_and_nothing_else(ball: DistanceField) -> None:
    island = (slice(1, 3), slice(1, 3), slice(1, 2))
    void = (slice(12, 14), slice(12, 13), slice(12, 13))
    cleared, count = remove_specks(with_values(ball, (island, 0.2), (void, -0.3)))
    assert count == 2
    assert (cleared.values[island] == np.float32(-0.2)).all()
    assert (cleared.values[void] == np.float32(0.3)).all()
    same = np.ones(ball.values.shape, dtype=bool)
    same[island] = same[void] = False
    np.testing.assert_array_equal(cleared.values[same], ball.values[same])


def test_a_second_body_of_some_size_stays(ball: DistanceField) -> None:
    post = (slice(0, 3), slice(0, 3), slice(0, 3))
    cleared, count = remove_specks(with_values(ball, (post, 0.2)))
    assert count == 0
    assert (cleared.values[post] > 0).all()


def test_the_only_body_stays_however_small() -> None:
    grid = Grid.enclosing(np.full(3, -1.0), np.full(3, 1.0), 1.0)
    small = DistanceField(grid, Sphere((0, 0, 0), 1.2).distance(grid.window()), None,
                          np.empty((0, 3)))
    assert remove_specks(small)[1] == 0


def test_bounds_ignore_burrs_thinner_than_a_bead(ball: DistanceField) -> None:
    burr = (slice(0, 8), slice(13, 14), slice(13, 14))
    spiked = with_values(ball, (burr, 0.2))
    assert zero_level_bounds(spiked)[0][2] == pytest.approx(ball.grid.origin_mm[2])
    low, _ = zero_level_bounds(spiked, least_area_mm2=1.0)
    assert low[2] == pytest.approx(-5, abs=0.1)


def test_bounds_ignore_scattered_nodes_that_are_off(ball: DistanceField) -> None:
    values = ball.values.copy()
    random = np.random.default_rng(2)
    face = np.flatnonzero(np.abs(ball.grid.axis_mm(2) + 5.5) < 1e-9)[0]
    for _ in range(25):  # more than a bead's area of them, but not together
        j, i = random.integers(0, 8, 2) * 3
        values[face, j, i] = 0.3
    low, _ = zero_level_bounds(DistanceField(ball.grid, values, None, ball.surface_mm),
                               least_area_mm2=3.0)
    assert low[2] == pytest.approx(-5, abs=0.15)


def test_a_field_without_inside_has_no_bounds(ball: DistanceField) -> None:
    empty = DistanceField(ball.grid, -np.abs(ball.values) - 0.1, None, ball.surface_mm)
    with pytest.raises(ValueError, match="without inside has no bounds"):
        zero_level_bounds(empty)


def test_a_narrow_body_has_bounds_too(ball: DistanceField) -> None:
    low, high = zero_level_bounds(ball, least_area_mm2=1e6)
    assert low == pytest.approx([-5, -5, -5], abs=1e-5)
    assert high == pytest.approx([5, 5, 5], abs=1e-5)


def test_a_leak_is_seen(ball: DistanceField) -> None:
    assert is_closed(ball)
    assert not is_closed(with_values(ball, ((slice(0, 1), slice(5, 6), slice(5, 6)), 0.1)))
