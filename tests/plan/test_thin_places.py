"""Walls, necks, ribs, rings and pins of about one bead are filled wherever they lie."""

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import unary_union

from tests.plan.slices import BEAD, geometry_maker

RASTER = BEAD / 8

#: Turn [degrees] and offset in nodes along x and y: on the raster, between its nodes, across it.
POSES = [(0.0, 0.0, 0.0), (90.0, 0.125, 0.25), (45.0, 0.0, 0.125), (63.1, 0.875, 0.625)]
WIDTHS = [0.6, 0.8, 1.0, 1.05, 1.25, 1.5]


@pytest.fixture
def geometry_of(make_part, profile):
    return geometry_maker(make_part, profile, height_mm=0.8)


def shape(name, width):
    """A thin thing `width` beads wide."""
    half = width * BEAD / 2
    bar = box(-12, -half, 12, half)
    return {
        "wall": lambda: bar,
        "neck": lambda: unary_union([Point(-12, 0).buffer(6), Point(12, 0).buffer(6), bar]),
        "rib": lambda: unary_union([bar, box(-24, -9, -12, 9)]),
        "ring": lambda: Point(0, 0).buffer(9 + half, 64) - Point(0, 0).buffer(9 - half, 64),
        "crossing": lambda: unary_union([bar, rotate(bar, 70)]),
        "wave": lambda: LineString(
            [(t, 2 * np.sin(t / 2)) for t in np.linspace(-12, 12, 200)]).buffer(half),
        "pin": lambda: Point(0, 0).buffer(half, 64),
        "short wall": lambda: box(-1.4 * half, -half, 1.4 * half, half),
    }[name]()


def posed(poly, pose):
    turn, right, up = pose
    return translate(rotate(poly, turn, origin=(0, 0)), right * RASTER, up * RASTER)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    "name", ["wall", "neck", "rib", "ring", "crossing", "wave", "pin", "short wall"])
def test_a_thin_thing_is_filled_wherever_it_lies(geometry_of, name, width):
    small = name in ("pin", "short wall")  # a straight track in a round pin leaves its sides
    for pose in POSES:
        poly = posed(shape(name, width), pose)
        geometry = geometry_of(poly)
        figures = geometry.figures
        assert figures.inside_mm2 >= (0.75 if small else 0.95) * poly.area
        assert figures.outside_mm2 <= (0.25 if small else 0.03) * poly.area
        assert figures.strip_mm2 == pytest.approx(poly.area, rel=0.06)
        assert figures.lost == ()
        assert poly.buffer(0.03 * BEAD).covers(shapely.points(geometry.points_mm)).all()


@pytest.mark.parametrize("turn", [0.0, 7.3, 45.0])
@pytest.mark.parametrize(("width", "count"), [
    (0.45, 0), (0.52, 1), (0.9, 1), (0.98, 1), (1.1, 1), (1.6, 1)])
def test_a_wall_is_one_line_or_one_loop_or_nothing(geometry_of, width, count, turn):
    """One line up to 1.5 pitches, which is a bead here; two tracks in one loop beyond."""
    for offset in np.arange(4) / 4:
        geometry = geometry_of(posed(shape("wall", width), (turn, offset, 0.7 * offset)))
        assert geometry.n_tracks == count
        assert geometry.is_closed.any() == (width > 1)
        assert len(geometry.figures.lost) == 1 - count


@pytest.mark.parametrize("overlap", [0.0, 0.5, 0.8])
def test_nor_does_it_depend_on_how_much_tracks_overlap(geometry_of, overlap):
    for name in ("wall", "wave"):
        poly = posed(shape(name, 1.33), POSES[-1])
        figures = geometry_of(poly, overlap=overlap).figures
        assert figures.inside_mm2 >= 0.95 * poly.area


def test_a_wedge_keeps_one_track_in_its_tip(geometry_of):
    poly = Polygon([(0, 0), (40, -5), (40, 5)])
    for pose in POSES:
        geometry = geometry_of(posed(poly, pose))
        tip = np.array(posed(Point(0, 0), pose).coords[0])
        nearest = np.linalg.norm(geometry.points_mm - tip, axis=1).min()
        assert nearest <= 0.5 * BEAD / (2 * 5 / 40) + 0.01  # where it is half a bead wide
        assert geometry.figures.inside_mm2 >= 0.97 * poly.area


def test_no_track_is_shorter_than_a_bead_beside_others(geometry_of):
    for width in WIDTHS:
        for name in ("neck", "rib", "crossing"):
            geometry = geometry_of(posed(shape(name, width), POSES[2]))
            for k in range(geometry.n_tracks):
                points = geometry.points_mm[geometry.track(k)]
                assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() >= BEAD / 2
