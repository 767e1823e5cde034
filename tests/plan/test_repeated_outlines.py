"""What an outline alone decides is kept while it repeats; that changes no plan."""

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Point, Polygon, box

from lmctl.field.outline_distance import distance_outside, plane_distance
from lmctl.field.plane import PlaneGrid
from lmctl.part.sources.slicing import MeshSlicer
from lmctl.plan.geometry.intended_slice import without_straight_vertices
from lmctl.plan.polyline import resampled_polyline
from tests.plan.slices import geometry_maker

STAR = Polygon([(r * np.cos(a), r * np.sin(a))
                for r, a in zip([12, 6] * 5, np.arange(10) * np.pi / 5, strict=True)])


@pytest.fixture
def geometry_of(make_part, profile):
    return geometry_maker(make_part, profile, height_mm=2.4)


@pytest.mark.parametrize("layer", [1, 2])
def test_a_layer_is_the_same_after_another_of_its_outline(geometry_of, layer):
    geometry_of(box(0, 0, 9, 9))  # takes the place of what was kept before
    alone = geometry_of(STAR, layer=layer)
    geometry_of(box(0, 0, 9, 9))
    geometry_of(STAR, layer=0)
    after = geometry_of(STAR, layer=layer)
    for name in ("points_mm", "starts", "strip_width_mm", "fractions", "is_closed", "island"):
        np.testing.assert_array_equal(getattr(after, name), getattr(alone, name))
    assert after.figures == alone.figures


def test_straight_walls_have_one_outline_at_every_height():
    """Each wall is two triangles, so that sections cross their diagonal, elsewhere each time."""
    ring = np.array(STAR.exterior.coords)[:-1]
    n = len(ring)
    vertices = np.vstack([np.column_stack([ring, np.full(n, z)]) for z in (0.0, 7.0)])
    low, nxt = np.arange(n), (np.arange(n) + 1) % n
    walls = np.vstack([np.column_stack([low, nxt, nxt + n]),
                       np.column_stack([low, nxt + n, low + n])])
    slicer = MeshSlicer(vertices, walls.astype(np.int64))
    (lower,), (upper,) = slicer.loops(1.3), slicer.loops(5.9)
    assert len(lower) > n + 1
    np.testing.assert_array_equal(
        without_straight_vertices(lower), without_straight_vertices(upper))
    assert shapely.equals_exact(
        Polygon(without_straight_vertices(lower)).normalize(), STAR.normalize(), 1e-12)


def test_a_curve_and_a_spike_keep_their_vertices():
    circle = np.array(Point(0, 0).buffer(10, 64).exterior.coords)
    assert len(without_straight_vertices(circle)) == len(circle)
    spike = np.array([(0, 0), (4, 0), (9, 0), (4, 0), (4, 3), (0, 3), (0, 0)], float)
    assert [9.0, 0.0] in without_straight_vertices(spike).tolist()


@pytest.mark.parametrize("line", [
    np.array(STAR.exterior.coords), np.array(Point(0, 0).buffer(5, 90).exterior.coords),
    np.array([(0.0, 0.0), (0.01, 0.0), (0.01, 3.0)])])
def test_points_set_anew_stay_on_the_line_and_near_each_other(line):
    found = resampled_polyline(line, 0.2, 0.004)
    steps = np.linalg.norm(np.diff(found, axis=0), axis=1)
    assert steps.max() <= 0.2 + 1e-9
    assert shapely.hausdorff_distance(LineString(line), LineString(found), 0.01) <= 0.004 + 1e-9
    np.testing.assert_array_equal(found[[0, -1]], line[[0, -1]])
    assert len(found) <= LineString(line).length / 0.2 + len(line) + 2


@pytest.mark.parametrize("shape", [STAR, box(-1, -1, 1, 1), Point(3, 3).buffer(0.3)])
def test_the_way_out_of_a_slice_is_its_distance_outside(shape):
    loops = [np.array(shapely.geometry.polygon.orient(shape).exterior.coords)]
    grid = PlaneGrid((-14.03, -14.11), 0.25, (113, 113))
    distance = plane_distance(loops, grid)
    wanted = np.zeros(grid.shape, np.bool_)
    wanted[20:90, 30:100] = True
    np.testing.assert_allclose(
        distance_outside(loops, grid, wanted), np.where(wanted, np.maximum(-distance, 0), 0),
        atol=1e-3)
