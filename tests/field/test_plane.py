"""Outlines and the in-plane distance, against polygons and circles measured directly."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.errors import InputError
from lmctl.field.outline_distance import plane_distance
from lmctl.field.plane import PlaneGrid, iso_loops, loop_area_mm2, section_loops

GRID = PlaneGrid((-16.0, -16.0), 0.25, (129, 129))


def nodes(grid: PlaneGrid) -> tuple[np.ndarray, np.ndarray]:
    return np.meshgrid(grid.x_mm, grid.y_mm)


def disc(grid: PlaneGrid, radius: float, centre: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    x, y = nodes(grid)
    return (radius - np.hypot(x - centre[0], y - centre[1])).astype(np.float32)


def brute_force(loops: list[np.ndarray], grid: PlaneGrid) -> np.ndarray:
    x, y = nodes(grid)
    points = shapely.points(x.ravel(), y.ravel())
    distance = shapely.distance(points, shapely.MultiLineString(loops))
    inside = np.zeros(x.size, dtype=bool)
    for loop in loops:
        inside ^= shapely.contains(shapely.Polygon(loop), points)
    return np.where(inside, distance, -distance).reshape(grid.shape)


def test_outer_loops_run_counter_clockwise_and_holes_clockwise():
    ring = np.minimum(disc(GRID, 10.0), -disc(GRID, 4.0))
    areas = sorted(loop_area_mm2(loop) for loop in section_loops(ring, GRID))
    assert areas == pytest.approx([-np.pi * 16, np.pi * 100], rel=2e-3)


def test_every_loop_is_closed_and_has_no_repeated_points():
    # Faces on the nodes: the level is met exactly at them, which makes contours stutter.
    x, y = nodes(GRID)
    square = np.minimum(5 - np.abs(x), 5 - np.abs(y)).astype(np.float32)
    (loop,) = section_loops(square, GRID)
    assert np.array_equal(loop[0], loop[-1])
    assert np.all(np.any(np.diff(loop, axis=0) != 0, axis=1))
    # Contours cut the four corners, by at most half a cell each.
    assert loop_area_mm2(loop) == pytest.approx(100.0, abs=4 * 0.5 * GRID.pitch_mm**2)


def test_nothing_inside_is_no_loop_and_minus_infinity():
    assert section_loops(np.full(GRID.shape, -1.0, dtype=np.float32), GRID) == []
    assert np.all(np.isneginf(plane_distance([], GRID)))


def test_a_part_that_reaches_the_edge_is_refused():
    with pytest.raises(InputError, match="reaches the edge"):
        section_loops(disc(GRID, 10.0, (7.0, 0.0)), GRID)


def test_a_distance_that_is_not_a_number_is_refused():
    values = disc(GRID, 5.0)
    values[30, 40] = np.nan
    with pytest.raises(InputError, match="not a number"):
        section_loops(values, GRID)


def test_values_of_another_plane_are_a_mistake_of_the_caller():
    with pytest.raises(ValueError, match=r"values of shape \(3, 3\) on a plane of shape"):
        section_loops(np.zeros((3, 3), np.float32), GRID)


def test_a_loop_left_open_is_a_mistake_of_the_caller():
    with pytest.raises(ValueError, match="repeated last"):
        plane_distance([np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [0.0, 5.0]])], GRID)


@st.composite
def polygons(draw: st.DrawFn) -> np.ndarray:
    """A star-shaped polygon of 3 to 12 corners, spiky or round, anywhere within the grid."""
    count = draw(st.integers(3, 12))
    radii = draw(st.lists(st.floats(0.6, 9.0), min_size=count, max_size=count))
    turn = draw(st.floats(0.0, 6.3))
    angles = turn + 2 * np.pi * np.arange(count) / count
    centre = draw(st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)))
    corners = np.array(centre) + np.array(radii)[:, None] * np.c_[np.cos(angles), np.sin(angles)]
    return np.vstack([corners, corners[:1]])


@settings(max_examples=40, deadline=None)
@given(polygons())
def test_distance_of_any_polygon_equals_the_direct_one(polygon: np.ndarray):
    got, true = plane_distance([polygon], GRID), brute_force([polygon], GRID)
    assert np.abs(np.abs(got) - np.abs(true)).max() < 0.02 * GRID.pitch_mm
    near = np.abs(true) < 1.5 * GRID.pitch_mm
    assert np.abs(np.abs(got) - np.abs(true))[near].max() < 1e-5
    away = np.abs(true) > 1e-5
    assert np.array_equal(got[away] > 0, true[away] > 0)


def test_corners_exactly_on_grid_lines_keep_their_parity():
    diamond = np.array([[0.0, -5.0], [5.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -5.0]])
    got, true = plane_distance([diamond], GRID), brute_force([diamond], GRID)
    assert np.abs(got - true).max() < 1e-5


def test_levels_one_apart_are_one_apart_in_the_plane():
    # The 3D distance of a sphere R 10 at z = 8 has in-plane gaps of 1.88 and 4.12 instead.
    grid = PlaneGrid((-8.0, -8.0), 0.1, (161, 161))
    x, y = nodes(grid)
    slice_at_8 = (10.0 - np.sqrt(x**2 + y**2 + 64.0)).astype(np.float32)
    distance = plane_distance(section_loops(slice_at_8, grid), grid)
    levels = (1.0, 2.0, 3.0, 4.0)
    for level, (loop,) in zip(levels, iso_loops(distance, grid, levels), strict=True):
        assert np.hypot(*loop.T) == pytest.approx(6.0 - level, abs=5e-3)


def test_two_islands_and_a_hole_are_measured_together():
    loops = section_loops(
        np.maximum(np.minimum(disc(GRID, 6.0, (-7.0, 0.0)), -disc(GRID, 2.0, (-7.0, 0.0))),
                   disc(GRID, 4.0, (8.0, 1.0))), GRID)
    assert len(loops) == 3
    got, true = plane_distance(loops, GRID), brute_force(loops, GRID)
    assert np.abs(got - true).max() < 0.02 * GRID.pitch_mm
