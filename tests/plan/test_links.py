"""Tracks linked by short bridges: fewer starts, the same deposit."""

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Point, box
from shapely.ops import unary_union

from lmctl.plan.geometry.link_lines import LONGEST_BRIDGE
from tests.plan.slices import PITCH, geometry_maker


@pytest.fixture
def geometry_of(make_part, profile):
    return geometry_maker(make_part, profile, height_mm=2.4)


def steep(points):
    """A mixture that no two contours share."""
    return np.hypot(points[:, 0], points[:, 1]) / 60 * 5 % 1


PLATE = box(0, 0, 40, 30) - unary_union(
    [Point(6 + 9 * i, 6 + 9 * j).buffer(2, 30) for i in range(4) for j in range(3)])
RING = Point(0, 0).buffer(15, 90) - Point(0, 0).buffer(7, 90)


@pytest.mark.parametrize(("poly", "starts"), [
    (box(0, 0, 20, 20), 1), (RING, 1), (Point(0, 0).buffer(12), 1), (PLATE, 12),
    (unary_union([box(0, 0, 10, 10), box(15, 0, 25, 10)]), 2)])
def test_a_region_has_few_starts(geometry_of, poly, starts):
    assert geometry_of(poly).n_tracks <= starts


def test_bridges_add_no_volume_and_leave_no_gap(geometry_of):
    linked = geometry_of(PLATE).figures
    assert linked.inside_mm2 >= 0.985 * linked.slice_mm2
    assert linked.strip_mm2 == pytest.approx(linked.slice_mm2, rel=0.02)


def test_bridges_stay_inside_and_short(geometry_of):
    """Also where two walls stand nearer to each other than tracks lie."""
    comb = unary_union([box(0, 0, 40, 8), *(box(x, 8, x + 7.5, 25) for x in range(0, 40, 8))])
    geometry = geometry_of(comb)
    for k in range(geometry.n_tracks):
        line = LineString(geometry.points_mm[geometry.track(k)])
        assert comb.buffer(1e-6).contains(line)
        assert shapely.distance(comb.exterior, line) > 0.1 * PITCH
        steps = np.linalg.norm(np.diff(geometry.points_mm[geometry.track(k)], axis=0), axis=1)
        assert steps.max() <= LONGEST_BRIDGE * PITCH


def test_only_equal_mixtures_are_linked(geometry_of):
    geometry = geometry_of(RING, lambda p: (np.hypot(p[:, 0], p[:, 1]) - 7) / 8)
    assert geometry.n_tracks == 6
    for k in range(geometry.n_tracks):
        assert np.ptp(geometry.fractions[geometry.track(k)], axis=0).max() < 0.02


def test_bridges_turn_from_layer_to_layer(geometry_of):
    """Where two contours are joined in one layer, they are not in the next."""
    def bridge_at(layer):
        geometry = geometry_of(RING, layer=layer)
        radius = np.hypot(*geometry.points_mm.T)
        across = np.abs(np.diff(radius)) > 0.5 * np.linalg.norm(
            np.diff(geometry.points_mm, axis=0), axis=1) + 1e-3
        middle = geometry.points_mm[1:][across].mean(axis=0)
        return np.arctan2(middle[1], middle[0])

    first, second = bridge_at(0), bridge_at(1)
    apart = abs((second - first + np.pi) % (2 * np.pi) - np.pi)
    assert apart == pytest.approx(np.pi * (3 - np.sqrt(5)), abs=0.5)


@pytest.mark.parametrize(("seam", "wanted"), [("aligned", (1.0, 0.0)), ((0.0, 20.0), (0.0, 1.0))])
def test_or_stay_where_the_seam_is_wanted(geometry_of, seam, wanted):
    for layer in (0, 1):
        geometry = geometry_of(RING, layer=layer, seam=seam)
        radius = np.hypot(*geometry.points_mm.T)
        across = np.abs(np.diff(radius)) > 0.5 * np.linalg.norm(
            np.diff(geometry.points_mm, axis=0), axis=1) + 1e-3
        middle = geometry.points_mm[1:][across].mean(axis=0)
        assert middle @ np.array(wanted) >= 0.8 * np.hypot(*middle)
