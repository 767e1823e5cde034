"""Walls, necks, ribs, rings and pins of about one bead: laid wherever they lie, however turned.

The truth is shapely's: what a bead can reach is the outline opened by half a bead, and what is
laid is the tracks' own buffer.
"""

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import unary_union

from lmctl.plan.tracks import in_plane_tracks

BEAD = 2.0
PITCH = BEAD * (1 - 0.333)
RASTER = 0.25

#: Turn [degrees] and way in pitches along x and y: on the raster, between it, across it.
POSES = [(0.0, 0.0, 0.0), (0.0, 0.5, 0.375), (90.0, 0.125, 0.25), (45.0, 0.0, 0.125),
         (7.3, 0.25, 0.0), (63.1, 0.875, 0.625)]
WIDTHS = [1.0, 1.04, 1.05, 1.125, 1.25, 1.5]


def outlines(poly):
    loops = []
    for piece in shapely.get_parts(poly):
        whole = shapely.orient_polygons(piece)
        loops += [np.array(ring.coords) for ring in (whole.exterior, *whole.interiors)]
    return loops


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
        "two pins": lambda: unary_union(
            [Point(-2, 0).buffer(half), Point(2, 0).buffer(half), box(-2, -0.6, 2, 0.6)]),
        "short wall": lambda: box(-1.4 * half, -half, 1.4 * half, half),
    }[name]()


def laid_by(tracks):
    return unary_union([LineString(track.points).buffer(BEAD / 2) for track in tracks])


def posed(poly, pose):
    turn, right, up = pose
    return translate(rotate(poly, turn, origin=(0, 0)), right * RASTER, up * RASTER)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize(
    "name", ["wall", "neck", "rib", "ring", "crossing", "wave", "pin", "two pins", "short wall"])
def test_a_thin_thing_is_laid_wherever_it_lies(section, name, width):
    lengths = []
    for pose in POSES:
        poly = posed(shape(name, width), pose)
        tracks = in_plane_tracks(section(outlines(poly), RASTER), BEAD, PITCH)
        reach = poly.buffer(-BEAD / 2 + 1e-6).buffer(BEAD / 2)
        laid = laid_by(tracks)
        small = "pin" in name or name == "short wall"  # the corners weigh more
        assert (reach - laid).area <= (0.12 if small else 0.035) * reach.area
        assert (laid - poly.buffer(0.06 * BEAD)).area < 0.01
        for track in tracks:
            assert shapely.distance(poly.boundary, LineString(track.points)) >= 0.445 * BEAD
        lengths.append(sum(track.length_mm for track in tracks))
    assert max(lengths) <= 1.15 * min(lengths)


@pytest.mark.parametrize("raster", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("width", [1.05, 1.125, 1.3])
def test_nor_does_it_depend_on_how_fine_the_raster_is(section, width, raster):
    for name in ("wall", "neck", "pin"):
        poly = posed(shape(name, width), POSES[-1])
        tracks = in_plane_tracks(section(outlines(poly), raster), BEAD, PITCH)
        reach = poly.buffer(-BEAD / 2 + 1e-6).buffer(BEAD / 2)
        assert (reach - laid_by(tracks)).area <= 0.05 * reach.area


@pytest.mark.parametrize("turn", [0.0, 7.3, 45.0])
@pytest.mark.parametrize(("width", "count"), [(0.85, 0), (0.9, 1), (0.95, 1), (1.0, 1), (1.1, 1)])
def test_a_wall_is_one_line_or_one_loop_or_nothing(section, width, count, turn):
    for offset in np.arange(8) / 8:
        poly = posed(shape("wall", width), (turn, offset, 0.7 * offset))
        tracks = in_plane_tracks(section(outlines(poly), RASTER), BEAD, PITCH)
        assert len(tracks) == count
        assert all(track.closed == (width > 1.04) for track in tracks)


@pytest.mark.parametrize("raster", [0.1, 0.4])
def test_nor_on_how_much_tracks_overlap(section, raster):
    for overlap in (0.0, 0.5, 0.8):
        for name in ("wall", "wave"):
            poly = posed(shape(name, 1.33), POSES[-1])
            tracks = in_plane_tracks(section(outlines(poly), raster), BEAD, BEAD * (1 - overlap))
            reach = poly.buffer(-BEAD / 2 + 1e-6).buffer(BEAD / 2)
            assert (reach - laid_by(tracks)).area <= 0.05 * reach.area


def test_a_ring_hardly_wider_than_a_bead_is_two_rings(section):
    poly = shape("ring", 1.08)
    tracks = in_plane_tracks(section(outlines(poly), RASTER), BEAD, PITCH)
    radii = sorted(float(np.hypot(*track.points.T).mean()) for track in tracks)
    assert radii == pytest.approx([8.92, 9.08], abs=0.01)


def test_a_pin_of_one_bead_is_a_ring_as_wide_as_the_inset_may_err(section):
    (track,) = in_plane_tracks(section(outlines(shape("pin", 1.0)), RASTER), BEAD, PITCH)
    assert np.hypot(*track.points.T).max() == pytest.approx(0.05 * BEAD, abs=0.01)
    assert track.closed
    assert in_plane_tracks(section(outlines(shape("pin", 0.92)), RASTER), BEAD, PITCH) == []


def test_a_wedge_keeps_one_track_in_its_tip(section):
    poly = Polygon([(0, 0), (40, -5), (40, 5)])
    for pose in POSES:
        tracks = in_plane_tracks(section(outlines(posed(poly, pose)), RASTER), BEAD, PITCH)
        reach = posed(poly, pose).buffer(-BEAD / 2).buffer(BEAD / 2)
        assert (reach - laid_by(tracks)).area <= 0.01 * reach.area
