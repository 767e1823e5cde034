"""What a part lacks is added up over its layers, told by place, and refused unless allowed."""

import numpy as np
import pytest
import shapely
from shapely.geometry import Point, box
from shapely.ops import unary_union

from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.part.load import load_part
from lmctl.plan.completeness import Completeness
from lmctl.plan.geometry import layer_geometry
from lmctl.preflight.placement import place_part


def loops_of(poly):
    loops = []
    for piece in shapely.get_parts(poly):
        whole = shapely.orient_polygons(piece)
        loops += [shapely.get_coordinates(ring) for ring in (whole.exterior, *whole.interiors)]
    return loops


@pytest.fixture
def complete(make_part, profile):
    """All layers of a part whose outline is a polygon by height, added up."""
    def make(outline, height_mm=4.0, turning_mm=(), **process):
        part = make_part(lambda z: loops_of(outline(z)), lambda p: 0.5, height_mm=height_mm,
                         process=ProcessSettings(**process), turning_mm=turning_mm)
        placement = place_part(part, profile)
        found = Completeness(part.process, placement.layer_height_mm,
                             placement.uncovered_height_mm())
        for layer in range(placement.n_layers):
            found.add_layer(layer_geometry(part, placement, layer))
        return found

    return make


PLATE = box(0, 0, 20, 20)


def test_a_whole_part_is_complete(complete):
    found = complete(lambda z: PLATE)
    found.check()
    totals = found.totals()
    assert totals["complete"]
    assert 0.98 <= totals["built_fraction"] <= 1
    assert totals["surplus_fraction"] <= 0.01
    assert totals["lost"] == totals["overhangs"] == []


def test_a_lost_rib_is_one_piece_over_all_its_layers(complete):
    rib = box(20, 8, 30, 8.7)
    found = complete(lambda z: unary_union([PLATE, rib]) if z > 1.6 else PLATE)
    (piece,) = found.lost
    assert (piece.first_layer, piece.last_layer) == (2, 4)
    assert (piece.lowest_z_mm, piece.highest_z_mm) == pytest.approx((1.6, 4.0))
    assert piece.volume_mm3 == pytest.approx(rib.area * 2.4, rel=0.2)
    with pytest.raises(PlanError) as caught:
        found.check(allow_overhang=True)
    text = caught.value.render()
    assert "a piece is lost" in text
    assert "z 1.60 to 4.00 mm" in text
    assert "--allow-incomplete" in text
    assert not found.totals()["complete"]
    found.check(allow_incomplete=True, allow_overhang=True)


def test_a_lost_layer_counts_though_nothing_of_it_is_planned(complete):
    found = complete(lambda z: PLATE if z < 3.2 else box(0, 0, 20, 0.6))
    (piece,) = found.lost
    assert piece.feature.kind == "layer"
    assert found.built_fraction == pytest.approx(1600 * 0.99 / 1612, abs=0.02)


def test_surplus_does_not_hide_what_is_missing(complete):
    """A part that is half lost and twice as heavy elsewhere is still half lost."""
    found = complete(lambda z: unary_union([PLATE, box(30, 0, 70, 0.9)]))
    assert found.built_fraction <= 400 / 436 + 0.001


def test_too_little_is_refused_though_no_piece_is_lost(complete):
    found = complete(lambda z: Point(0, 0).buffer(10), min_built_fraction=0.9999)
    assert not found.lost
    with pytest.raises(PlanError, match="not the whole part"):
        found.check()


def test_narrow_places_are_refused_if_so_asked(complete):
    def outline(z):
        return unary_union([PLATE, box(20, 8, 40, 9.5)])

    complete(outline).check()
    with pytest.raises(PlanError, match="narrower than a bead"):
        complete(outline, narrow_features="refuse").check()


def test_what_starts_in_the_air_is_refused_with_its_place(complete):
    found = complete(lambda z: PLATE if z < 2 else unary_union([PLATE, box(40, 0, 50, 10)]))
    with pytest.raises(PlanError) as caught:
        found.check(allow_incomplete=True)
    text = caught.value.render()
    assert "start in the air in one place" in text
    assert "x 45.0" in text
    assert "z 1.60 to 2.40 mm" in text
    found.check(allow_overhang=True)


@pytest.mark.parametrize(("lean_deg", "refused", "warned"), [
    (20, False, False), (40, False, True), (55, True, True)])
def test_leaning_walls(complete, lean_deg, refused, warned):
    slope = np.tan(np.radians(lean_deg))
    found = complete(lambda z: box(0, 0, 20 + slope * z, 20))
    assert bool(found.overhangs) == warned
    assert bool(found.steep_overhangs()) == refused
    if warned:
        (wall,) = found.overhangs
        assert wall.angle_deg == pytest.approx(lean_deg, abs=3)
        assert wall.at_mm[0] > 20
        assert wall.last_layer == 4
    if refused:
        with pytest.raises(PlanError, match="more than 45°"):
            found.check()
        complete(lambda z: box(0, 0, 20 + slope * z, 20), max_overhang_deg=60).check()


def test_height_that_whole_layers_do_not_fill_is_missing(complete):
    found = complete(lambda z: PLATE, height_mm=1.1)
    assert found.built_fraction == pytest.approx(0.8 / 1.1, abs=0.015)
    assert any("less than the part is tall" in text for fine, text in found.findings() if not fine)


@pytest.mark.parametrize("low_mm", [0.02, 0.7, 1.25, 2.05, 3.65])
def test_what_is_flatter_than_a_layer_is_listed_wherever_it_lies(complete, low_mm):
    """A rib of 0.2 mm height meets no plane at which layers are cut."""
    rib, high_mm = box(20, 8, 30, 12), low_mm + 0.2

    def outline(z):
        return unary_union([PLATE, rib]) if low_mm <= z < high_mm else PLATE

    found = complete(outline, turning_mm=(0.0, low_mm, high_mm, 4.0))
    (piece,) = found.lost
    assert piece.feature.kind == "flat"
    assert piece.feature.at_mm == pytest.approx((25, 10), abs=1)
    assert "layer_height_mm" in piece.feature.remedy
    with pytest.raises(PlanError, match="a piece is lost"):
        found.check(allow_overhang=True)


def test_a_slope_is_no_flat_piece(complete):
    found = complete(lambda z: box(0, 0, 20 + z, 20), turning_mm=(0.0, 1.5, 1.6, 4.0))
    assert not found.lost


def test_every_feature_has_its_own_fraction(complete):
    """A plate that splits into a tower and a thin wall: three features, each by place."""
    def outline(z):
        return PLATE if z < 1.6 else unary_union([box(0, 0, 6, 6), box(10, 10, 20, 11.2)])

    found = complete(outline)
    assert len(found.features) == 3
    places = {tuple(np.round(f.at_mm)): f for f in found.features}
    assert set(places) == {(10, 10), (3, 3), (15, 11)}
    tower = places[3, 3]
    assert (tower.first_layer, tower.last_layer) == (2, 4)
    assert tower.volume_mm3 == pytest.approx(36 * 2.4)
    assert all(0.9 <= f.built_fraction <= 1 for f in found.features)
    totals = found.totals()
    assert totals["feature_count"] == 3
    least = min(f.built_fraction for f in found.features)
    assert totals["features"][0]["built_fraction"] == pytest.approx(least, abs=1e-5)


def test_pieces_that_stand_close_are_distinguished(complete):
    """Specks nearer to each other than a bead: as many pieces as there are, not as many a layer."""
    specks = [box(x, y, x + 0.2, y + 0.2) for x in np.arange(1, 19, 1.5) for y in (22, 23.3)]
    found = complete(lambda z: unary_union([PLATE, *specks]))
    assert len(found.lost) == len(specks)
    assert all((piece.first_layer, piece.last_layer) == (0, 4) for piece in found.lost)
    assert all(piece.feature.size_mm == pytest.approx((0.2, 0.2), abs=0.01)
               for piece in found.lost)


def test_lost_pieces_name_their_body(profile, tmp_path):
    """Also where a whole layer consists of pieces of two bodies, and one body is cut from another.
    """
    file = tmp_path / "fins.toml"
    file.write_text("""
name = "fins"
combine = "union"
[[material]]
name = "316L"
[[body]]
name = "block"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 20, 4]
[[body]]
name = "hole"
kind = "cylinder"
base_mm = [5, 5, -1]
top_mm = [5, 5, 5]
radius_mm = 2
[[body]]
name = "plate"
kind = "difference"
of = ["block", "hole"]
[[body]]
name = "fin"
kind = "box"
low_mm = [10, 10, 3]
high_mm = [18, 10.6, 7.2]
[[body]]
name = "pin"
kind = "cylinder"
base_mm = [4, 15, 3]
top_mm = [4, 15, 5.6]
radius_mm = 0.3
""")
    part = load_part(file)
    placement = place_part(part, profile)
    found = Completeness(part.process, placement.layer_height_mm, 0.0, part.named_bodies)
    for layer in range(placement.n_layers):
        found.add_layer(layer_geometry(part, placement, layer))
    lost = found.totals()["lost"]
    assert sorted(piece["body"] for piece in lost) == ["fin", "pin"]
    with pytest.raises(PlanError, match="2 pieces are lost") as caught:
        found.check()
    assert "of body 'fin' at x 14.0" in caught.value.render()
    assert [name for name, _ in part.named_bodies.bodies] == ["block", "fin", "pin"]
