"""Strips fill what was drawn: walls of any width, tips, rings, holes; and say what they do not."""

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree
from shapely.affinity import rotate
from shapely.geometry import LineString, Point, Polygon, box
from shapely.ops import unary_union

from tests.plan.slices import BEAD, PITCH, geometry_maker


@pytest.fixture
def geometry_of(make_part, profile):
    return geometry_maker(make_part, profile, height_mm=1.6)


def star(points=7, outer=25.0, inner=9.0):
    turn = np.arange(2 * points) * np.pi / points
    radius = np.where(np.arange(2 * points) % 2 == 0, outer, inner)
    return Polygon(np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1))


SHAPES = {
    "box": box(0, 0, 20, 20),
    "disc": Point(0, 0).buffer(10, 90),
    "ring": Point(0, 0).buffer(15, 90) - Point(0, 0).buffer(9, 90),
    "star": star(),
    "wedge": Polygon([(0, -7), (50, 0), (0, 7)]),
    "wall turned": rotate(box(0, 0, 30, 6.1), 33),
    "plate with holes": box(0, 0, 40, 30) - unary_union(
        [Point(6 + 9 * i, 6 + 9 * j).buffer(2, 30) for i in range(4) for j in range(3)]),
    "corner of walls": unary_union([box(0, 0, 30, 4.4), box(0, 0, 7, 30)]),
    "crossing of walls": unary_union([box(-15, -1, 15, 1), rotate(box(-15, -1, 15, 1), 70)]),
    "two lumps and a neck": unary_union(
        [Point(-12, 0).buffer(6), Point(12, 0).buffer(6), box(-12, -1.3, 12, 1.3)]),
    "wave": LineString([(t, 4 * np.sin(t / 3)) for t in np.linspace(-15, 15, 200)]).buffer(1.7),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_is_filled_and_little_is_doubled_or_outside(geometry_of, name):
    figures = geometry_of(SHAPES[name]).figures
    assert figures.slice_mm2 == pytest.approx(SHAPES[name].area, rel=1e-6)
    assert figures.inside_mm2 >= 0.975 * figures.slice_mm2
    assert figures.double_mm2 <= 0.04 * figures.slice_mm2
    assert figures.outside_mm2 <= 0.01 * figures.slice_mm2
    assert figures.lost == ()
    assert figures.inside_mm2 + figures.double_mm2 + figures.outside_mm2 == pytest.approx(
        figures.strip_mm2, rel=0.01)


@pytest.mark.parametrize("turn", [0.0, 17.3])
def test_walls_of_one_to_eight_beads(geometry_of, turn):
    """Their volume, the number of tracks across, and how near these come to each other."""
    across_before = 0
    for width in np.arange(1.0, 8.0, 0.35) * BEAD:
        geometry = geometry_of(rotate(box(0, 0, 40, width), turn, origin=(20, width / 2)))
        assert geometry.figures.strip_mm2 == pytest.approx(40 * width, rel=0.03)
        middle = LineString([(20, -20), (20, width + 20)])
        middle = rotate(middle, turn, origin=(20, width / 2))
        places = np.vstack([
            shapely.get_coordinates(LineString(geometry.points_mm[geometry.track(k)])
                                    .intersection(middle))
            for k in range(geometry.n_tracks)])
        across = len(places)
        assert across >= across_before, f"{width} mm: fewer tracks than in a thinner wall"
        across_before = across
        if across > 1:
            gap = np.diff(np.sort(np.linalg.norm(places - places[0], axis=1)))
            gap = np.linalg.norm(places[:, None] - places, axis=2)
            assert gap[gap > 1e-6].min() >= 0.6 * PITCH
    assert across_before == round(15.3 / PITCH)


def test_strips_stay_within_their_limits(geometry_of):
    for name, shape in SHAPES.items():
        strip = geometry_of(shape).strip_width_mm / PITCH
        assert strip.min() >= 0.69, name
        assert strip.max() <= 1.51, name


def test_the_outermost_track_lies_half_a_pitch_inside(geometry_of):
    geometry = geometry_of(SHAPES["box"])
    depth = shapely.distance(SHAPES["box"].exterior, shapely.points(geometry.points_mm))
    assert depth.min() == pytest.approx(PITCH / 2, abs=0.05 * PITCH)


def test_or_half_a_bead_inside(geometry_of):
    geometry = geometry_of(SHAPES["box"], outer_track="half-bead")
    depth = shapely.distance(SHAPES["box"].exterior, shapely.points(geometry.points_mm))
    assert depth.min() == pytest.approx(BEAD / 2, abs=0.05 * PITCH)
    side = 20 - (BEAD - PITCH)
    assert geometry.figures.slice_mm2 == pytest.approx(side**2, rel=0.002)


def test_an_allowance_moves_the_outline(geometry_of):
    geometry = geometry_of(SHAPES["disc"], allowance_mm=0.7)
    assert geometry.figures.slice_mm2 == pytest.approx(np.pi * 10.7**2, rel=0.003)
    assert geometry.figures.inside_mm2 >= 0.98 * geometry.figures.slice_mm2
    radius = np.hypot(*geometry.points_mm.T)
    assert radius.max() == pytest.approx(10.7 - PITCH / 2, abs=0.1)


def test_contours_of_a_disc_are_round_and_evenly_spaced(geometry_of):
    def graded(points):  # so steeply that no two contours hold the same, and none are linked
        return np.hypot(points[:, 0], points[:, 1]) / 12

    geometry = geometry_of(SHAPES["disc"], graded)
    assert geometry.n_tracks == 7
    radii = []
    for k in range(geometry.n_tracks):
        radius = np.hypot(*geometry.points_mm[geometry.track(k)].T)
        assert np.ptp(radius) < 0.15
        radii.append(radius.mean())
    gaps = np.diff(np.sort(radii))
    assert gaps.min() >= 0.9 * PITCH
    assert gaps.max() <= 1.12 * PITCH


@pytest.mark.parametrize("overlap", [0.0, 0.2, 0.5, 0.8])
def test_at_any_overlap(geometry_of, overlap):
    for name in ("box", "ring", "corner of walls"):
        figures = geometry_of(SHAPES[name], overlap=overlap).figures
        assert figures.inside_mm2 >= 0.97 * figures.slice_mm2, name
        assert figures.outside_mm2 <= 0.01 * figures.slice_mm2, name


def test_what_is_narrower_than_a_bead_and_half_of_one_gets_one_track(geometry_of):
    plate = box(0, 0, 20, 20)
    narrow = {"rib": box(20, 8, 30, 9.4), "pin": Point(30, 20).buffer(0.8),
              "wall": box(24, 14, 34, 15.1)}
    whole = unary_union([plate, *narrow.values()])
    geometry = geometry_of(whole)
    assert geometry.figures.lost == ()
    assert geometry.figures.narrow_mm2 >= 20
    near = cKDTree(geometry.points_mm)
    for name, piece in narrow.items():
        distance, _ = near.query(np.array(piece.centroid.coords[0]))
        assert distance < 0.2, name


@pytest.mark.parametrize("policy", ["deposit", "omit"])
def test_every_thing_too_thin_is_listed_with_place_size_and_remedy(geometry_of, policy):
    plate = box(0, 0, 20, 20)
    thin = [box(20, 8, 30, 8.6), Point(30, 20).buffer(0.3), box(-6, 3, 0, 3.05)]
    if policy == "omit":
        thin.append(box(4, 20, 5.4, 29))
    lost = geometry_of(unary_union([plate, *thin]), narrow_features=policy).figures.lost
    assert len(lost) == len(thin)
    for piece in thin:
        place = np.array(piece.centroid.coords[0])
        (found,) = [item for item in lost if np.hypot(*(np.array(item.at_mm) - place)) < 1.5]
        assert found.kind == ("island" if piece.area < 0.3 and piece.bounds[0] > 25 else "rib")
        assert found.area_mm2 == pytest.approx(piece.area, rel=0.5)
        assert found.reason
        assert found.remedy


def test_a_slice_without_a_track_is_a_lost_layer(geometry_of):
    geometry = geometry_of(box(0, 0, 30, 0.5))
    assert geometry.n_tracks == 0
    (lost,) = geometry.figures.lost
    assert lost.kind == "layer"
    assert lost.size_mm == pytest.approx((30, 0.5), rel=0.01)
    assert "half a bead" in lost.reason


def test_specks_are_listed_though_they_fall_between_nodes(geometry_of):
    rng = np.random.default_rng(5)
    specks = [box(x, y, x + 0.2, y + 0.2)
              for x, y in np.stack([np.arange(30) + 0.13, 22 + rng.random(30)], axis=1)]
    lost = geometry_of(unary_union([box(0, 0, 30, 20), *specks])).figures.lost
    assert len(lost) == 30
    assert {item.kind for item in lost} == {"island"}


@pytest.mark.parametrize("width", [7.0, 10.0, 13.3, 16.0, 24.0, 30.0])
def test_tracks_of_neighbouring_layers_do_not_lie_upon_each_other(geometry_of, width):
    """In walls of five tracks and more; the outermost always lies half a pitch inside."""
    wall = box(0, 0, 60, width)
    middle = LineString([(30, -1), (30, width + 1)])
    across = []
    for layer in (0, 1):
        geometry = geometry_of(wall, lambda p: p[:, 1] * 100 % 1, layer=layer)
        assert geometry.figures.inside_mm2 >= 0.98 * wall.area
        places = np.concatenate([
            shapely.get_coordinates(LineString(geometry.points_mm[geometry.track(k)])
                                    .intersection(middle))[:, 1]
            for k in range(geometry.n_tracks)])
        across.append(np.sort(places))
    assert across[0][0] == pytest.approx(across[1][0], abs=0.15 * PITCH)
    inner = across[0][2:-2]
    apart = np.abs(inner[:, None] - across[1]).min(axis=1)
    assert np.median(apart) >= 0.25 * PITCH


@pytest.mark.parametrize("pitches", [11.05, 11.6, 12.47, 13.9, 17.5])
def test_tracks_of_a_wide_wall_lie_half_a_pitch_from_those_of_other_layers(geometry_of, pitches):
    """From one side to the other: where they drifted together, beads lay on beads in the middle."""
    wall = box(0, 0, 50, pitches * PITCH)
    middle = LineString([(25, -1), (25, pitches * PITCH + 1)])
    across = []
    for layer in (0, 1):
        geometry = geometry_of(wall, lambda p: p[:, 1] * 100 % 1, layer=layer)
        across.append(np.sort(np.concatenate([
            shapely.get_coordinates(LineString(geometry.points_mm[geometry.track(k)])
                                    .intersection(middle))[:, 1]
            for k in range(geometry.n_tracks)])))
    apart = np.abs(across[0][2:-2, None] - across[1]).min(axis=1)
    assert apart.min() >= 0.38 * PITCH


@pytest.mark.parametrize("seed", range(4))
def test_crumbs_of_any_size_have_a_track_or_are_listed(geometry_of, seed):
    """From far below a node of the raster to half a bead, wherever they lie between its nodes."""
    rng = np.random.default_rng(seed)
    crumbs = []
    for k in range(24):
        width, turn = rng.uniform(0.05, 1.3), rng.uniform(0, 90)
        x, y = 1 + 3 * (k % 12) + rng.uniform(0, 0.5), 24 + 4 * (k // 12) + rng.uniform(0, 0.5)
        crumbs.append(rotate(box(x, y, x + width, y + width * rng.uniform(0.3, 1)), turn))
    geometry = geometry_of(unary_union([box(0, 0, 36, 20), *crumbs]))
    places = np.array([item.at_mm for item in geometry.figures.lost]).reshape(-1, 2)
    for crumb in crumbs:
        middle = np.array(crumb.centroid.coords[0])
        listed = (np.hypot(*(places - middle).T) < 0.5).any()
        near = np.hypot(*(geometry.points_mm - middle).T).min() < 0.3
        assert listed != near


@pytest.mark.parametrize("beads", np.arange(2.4, 8.0, 0.4))
def test_the_surface_is_true_in_walls_of_four_tracks_and_more(geometry_of, beads):
    """The outermost track lies half a pitch inside whatever the width, but of three tracks."""
    width = beads * BEAD
    wall = box(0, 0, 40, width)
    geometry = geometry_of(wall, lambda p: p[:, 1] * 100 % 1)
    depth = shapely.distance(wall.exterior, shapely.points(geometry.points_mm))
    middle = np.abs(geometry.points_mm[:, 0] - 20) < 10
    assert depth[middle].min() == pytest.approx(PITCH / 2, abs=0.02)


@pytest.mark.parametrize("sides", [4, 6, 8, 24, 64])
def test_polygons_are_filled_to_their_middle(geometry_of, sides):
    """The middle is a point that lines of nodes need not meet, and where many spokes do."""
    corner = np.arange(sides) * 2 * np.pi / sides + 0.1
    around = np.stack([np.cos(corner), np.sin(corner)], axis=1) / np.cos(np.pi / sides)
    for radius in np.arange(1.35, 8.0, 0.35):  # of the circle inside
        shape = Polygon(radius * around)
        for layer in (0, 1):
            figures = geometry_of(shape, layer=layer).figures
            assert figures.inside_mm2 >= 0.975 * figures.slice_mm2, (radius, layer)
            assert figures.strip_mm2 == pytest.approx(shape.area, rel=0.04), (radius, layer)
