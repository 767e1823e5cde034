"""Alloy rules: regions hold what they say, ways round are short and clear, blends keep out."""

import itertools

import numpy as np
import pytest

from lmctl.config.alloy_rules import AlloyRuleSettings
from lmctl.config.part_rules import parse_part_file
from lmctl.errors import ConfigError, InputError
from lmctl.part.load import part_from_text
from lmctl.part.materials.allowed_mixtures import AllowedMixtures
from lmctl.part.materials.alloy_rules import alloy_rules_of
from lmctl.part.materials.laid_mixtures import LaidMixtures, nearest_listed_mixtures
from lmctl.part.materials.ways_round import shortest_way, simplex_grid, way_length
from lmctl.part.sources.alloy_maps import AlloyMap

NAMES = ("Fe", "V", "Ti")
EVERY = np.ones(3, bool)


def settings(**keys):
    return AlloyRuleSettings.model_validate(
        {"name": "brittle", "powders": ("Fe", "Ti"), "reason": "FeTi and Fe2Ti", "margin": 0.0,
         **keys})


def rules(named=None, names=NAMES, cells=None, **keys):
    found = alloy_rules_of([(settings(**keys), cells)], names,
                           np.eye(len(names)) if named is None else np.array(named))
    assert found is not None
    return found


FE_TI = ({"Fe": (0.1, 1.0), "Ti": (0.1, 1.0)},)


def test_a_region_holds_where_all_its_intervals_do():
    mixtures = simplex_grid(20, 3) / 20
    expected = (mixtures[:, 0] >= 0.3) & (mixtures[:, 0] <= 0.6) & (mixtures[:, 2] >= 0.2)
    found = rules(forbidden=({"Fe": (0.3, 0.6), "Ti": (0.2, 1.0)},)).regions.rule_at(mixtures) >= 0
    assert (found == expected).all()


def test_inequalities_and_polygons_hold_what_they_enclose():
    mixtures = np.random.default_rng(1).dirichlet(np.ones(3), 4000)
    half = rules(inequalities=({"of": {"Fe": 1.0, "Ti": -2.0}, "at_least": 0.1},))
    assert ((half.regions.rule_at(mixtures) >= 0)
            == (mixtures[:, 0] - 2 * mixtures[:, 2] >= 0.1)).all()
    corners = [[0.2, 0.2, 0.6], [0.6, 0.2, 0.2], [0.3, 0.3, 0.4], [0.2, 0.6, 0.2]]  # not convex
    bent = rules(powders=NAMES, polygon=tuple(
        dict(zip(NAMES, corner, strict=True)) for corner in corners))
    from shapely import Polygon, points
    inside = Polygon([corner[:2] for corner in corners]).contains(points(mixtures[:, :2]))
    assert ((bent.regions.rule_at(mixtures) >= 0) == inside).mean() > 0.999


def test_a_map_forbids_the_mixtures_nearest_to_its_cells():
    grid = simplex_grid(10, 3) / 10
    flags = np.random.default_rng(2).random(len(grid)) < 0.3
    found = rules(powders=NAMES, map_file="map.csv", cells=AlloyMap(NAMES, grid[flags], 0.1))
    mixtures = np.random.default_rng(3).dirichlet(np.ones(3), 3000)
    nearest = np.linalg.norm(mixtures[:, None] - grid[None], axis=2).argmin(axis=1)
    assert ((found.regions.rule_at(mixtures) >= 0) == flags[nearest]).all()


def test_a_margin_is_kept_in_every_fraction():
    own = rules(margin=0.05, forbidden=({"Fe": (0.3, 0.6)},))
    allowed = AllowedMixtures(own, 0.0)
    fe = np.array([0.2, 0.2499, 0.2501, 0.45, 0.6499, 0.6501])
    mixtures = np.column_stack([fe, 1 - fe, np.zeros(6)])
    assert (allowed.rule_at(mixtures) >= 0).tolist() == [False, False, True, True, True, False]


def test_rounding_is_kept_in_powders_that_are_fed_only():
    """A rule that begins at a trace leaves the mixtures in which a hopper is shut."""
    allowed = AllowedMixtures(rules(margin=0.02, forbidden=({"Fe": (0.02, 1), "Ti": (0.02, 1)},)),
                              0.022)
    assert allowed.rule_at(np.array([[0, 0.5, 0.5], [0.5, 0.5, 0], [0.5, 0, 0.5]])).tolist() == [
        -1, -1, 0]


@pytest.mark.parametrize("beside", [0.0, 0.3, 0.8])
def test_the_way_round_a_disc_is_its_tangents_and_the_arc_between(beside):
    across = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2.0], [6.0]])
    radius, middle, turn = 0.1, np.full(3, 1 / 3), np.linspace(0, 2 * np.pi, 128, endpoint=False)
    centre = np.array([0.0, -beside * radius])
    disc = centre + radius * np.column_stack([np.cos(turn), np.sin(turn)])
    ends = np.array([[-0.28, 0.0], [0.28, 0.0]])
    own = rules(powders=NAMES, polygon=tuple(
        dict(zip(NAMES, map(float, middle + p @ across), strict=True)) for p in disc))
    way = shortest_way(*(middle + ends @ across), AllowedMixtures(own, 0.0), EVERY)
    arms = ends - centre
    reach = np.linalg.norm(arms, axis=1)
    arc = 2 * np.arctan2(abs(arms[0, 0]), arms[0, 1]) - np.arccos(radius / reach).sum()
    known = np.sqrt(reach**2 - radius**2).sum() + radius * arc
    assert 0.999 < way_length(way) / known < 1.01
    share = np.linspace(0, 1, 50)[:, None]
    for a, b in itertools.pairwise(way):
        in_plane = ((a + share * (b - a) - middle) @ across.T) - centre
        assert np.linalg.norm(in_plane, axis=1).min() > radius * 0.999


def test_there_is_no_way_through_a_wall_and_none_without_the_powder_it_needs():
    wall = AllowedMixtures(rules(forbidden=({"Fe": (0.4, 0.6)},)), 0.0)
    start, end = np.array([0.9, 0.0, 0.1]), np.array([0.1, 0.0, 0.9])
    assert shortest_way(start, end, wall, EVERY) is None
    block = AllowedMixtures(rules(forbidden=FE_TI), 0.0)
    assert shortest_way(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), block, EVERY) is not None
    assert shortest_way(np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), block,
                        np.array([True, False, True])) is None


def test_a_blend_goes_round_in_one_piece_and_never_through():
    mixtures = LaidMixtures(rules(margin=0.02, forbidden=FE_TI), 0.02)
    share = np.linspace(0, 1, 4001)[:, None]
    blend = (1 - share) * [1.0, 0, 0] + share * [0, 0, 1.0]
    laid, rule = mixtures.laid(blend)
    assert np.abs(np.diff(laid, axis=0)).max() < 0.002
    assert (laid[rule < 0] == blend[rule < 0]).all()
    assert (np.minimum(laid[:, 0], laid[:, 2]) < 0.1 - 0.02).all()
    assert laid[:, 1].max() > 0.8
    np.testing.assert_allclose(mixtures.laid(laid)[0], laid, atol=1e-9)


def test_a_jump_takes_the_nearer_side_and_adds_no_powder():
    mixtures = LaidMixtures(rules(way="jump", margin=0.02, forbidden=FE_TI), 0.02)
    share = np.linspace(0, 1, 1001)[:, None]
    laid, _ = mixtures.laid((1 - share) * [1.0, 0, 0] + share * [0, 0, 1.0])
    assert (laid[:, 1] == 0).all()
    step = np.abs(np.diff(laid[:, 0]))
    assert (step > 0.01).sum() == 1
    assert share[np.argmax(step), 0] == pytest.approx(0.5, abs=0.01)


def test_a_mixture_of_several_blends_becomes_the_nearest_allowed():
    mixtures = LaidMixtures(
        rules(powders=NAMES, margin=0.02, forbidden=({"V": (0.3, 0.5)},)), 0.02)
    inside = np.random.default_rng(4).dirichlet(np.ones(3), 3000)
    inside = inside[(inside[:, 1] > 0.3) & (inside[:, 1] < 0.5)]
    laid, rule = mixtures.laid(inside)
    assert (rule == 0).all()
    assert ((laid[:, 1] <= 0.28) | (laid[:, 1] >= 0.52)).all()
    off = np.minimum(inside[:, 1] - 0.28, 0.52 - inside[:, 1])
    assert (np.abs(laid - inside).max(axis=1) <= off + 0.03).all()


def test_the_nearest_mixture_is_the_nearest_of_the_same_powders():
    """Against all of them, compared one by one; also for many mixtures of four powders."""
    grid = simplex_grid(8, 4) / 8
    wanted = np.random.default_rng(5).dirichlet(np.ones(4), 300)
    wanted[:150, 1] = 0.0
    wanted /= wanted.sum(axis=1, keepdims=True)
    found = nearest_listed_mixtures(wanted, grid)
    assert (found[:150, 1] == 0).all()
    for own, chosen in zip(wanted, found, strict=True):
        others = grid if own[1] > 0 else grid[grid[:, 1] == 0]
        best = np.abs(others - own).max(axis=1).min()
        assert np.abs(chosen - own).max() == pytest.approx(best)
    many = np.random.default_rng(6).dirichlet(np.ones(4), 50_000)
    assert np.abs(nearest_listed_mixtures(many, simplex_grid(50, 4) / 50) - many).max() <= 1 / 50


PART = """
name = "part"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "box"
low_mm = [0, 0, 0]
high_mm = [10, 10, 2]
[composition]
feature = {{ kind = "coordinate", along = "x" }}
[composition.profile]
kind = "linear"
near = {{ "316L" = 1 }}
far = {{ "WC-12Co" = 1 }}
over_mm = [0, 9]
{rules}
"""


def test_every_mistake_in_rules_is_reported_at_once():
    with pytest.raises(ConfigError) as caught:
        parse_part_file(PART.format(rules="""
[[alloy_rule]]
name = "one"
powders = ["316L", "WC-12C"]
forbidden = [{ "316L" = [0.6, 0.4] }, { "316L" = [0.2, 1.4] }]
reason = "x"
way = "around"
[[alloy_rule]]
name = "one"
powders = ["316L", "WC-12Co"]
forbidden = [{ "316L" = [0.6, 1], "WC-12Co" = [0.6, 1] }]
[[alloy_rule]]
name = "two"
powders = ["316L", "WC-12Co"]
polygon = [{ "316L" = 0.5, "WC-12Co" = 0.4 }]
reason = "x"
[[alloy_rule]]
name = "three"
powders = ["316L", "WC-12Co"]
reason = "x"
"""), name="part.toml")
    text = "\n".join(f"{f.path}: {f.reason}" for f in caught.value.findings)
    for wanted in (
        "alloy_rule[1].powders: there is no material 'WC-12C': did you mean 'WC-12Co'?",
        "alloy_rule[1].forbidden[1].316L: goes from 0.6 down to 0.4",
        "alloy_rule[1].forbidden[2].316L[2]: must be at most 1",
        "alloy_rule[1].way: there is no way round with two powders",
        "alloy_rule[2].name: 'one' is there twice",
        "alloy_rule[2].reason: is missing",
        "alloy_rule[2].forbidden[1]: contradicts itself: its least fractions sum to 1.2",
        "alloy_rule[3].polygon: lies in the plane of three powders; the rule names 2",
        "alloy_rule[3].polygon[1]: the fractions sum to 0.9, not to 1",
        "alloy_rule[4]: forbids nothing",
    ):
        assert wanted in text


RULE_WITH_MAP = """
[[alloy_rule]]
name = "computed"
powders = ["316L", "WC-12Co"]
map_file = "map.csv"
reason = "x"
"""


def test_a_map_file_is_read_and_its_mistakes_are_named(tmp_path):
    text = PART.format(rules=RULE_WITH_MAP)
    head, rows = "WC-12Co, 316L ,forbidden", [
        f"{k / 4},{1 - k / 4},{int(k in (1, 2))}" for k in range(5)]
    (tmp_path / "map.csv").write_text("\n".join(["# eta phase", head, *rows]))
    part = part_from_text(text, tmp_path, "part")
    share = np.array([0.05, 0.2, 0.5, 0.7, 0.95])
    found = part.alloy_rules.regions.rule_at(np.column_stack([1 - share, share]))
    assert found.tolist() == [-1, 0, 0, -1, -1]
    assert "map.csv" in part.sources
    for lines, wanted in (
        ([head, *rows[:-1]], "not a whole map"), ([head, *rows[:-1], "1,0,maybe"], "line 6"),
        ([head.replace("316L", "304L"), *rows], "columns"), ([head, *rows, rows[0]], "whole map"),
    ):
        (tmp_path / "map.csv").write_text("\n".join(lines))
        with pytest.raises(InputError, match=wanted):
            part_from_text(text, tmp_path, "part")


def test_rules_that_several_parts_share_come_from_a_file(tmp_path):
    (tmp_path / "shop.toml").write_text("""
[[alloy_rule]]
name = "eta phase"
powders = ["316L", "WC-12Co", "Co"]
forbidden = [{ "316L" = [0.4, 0.6], "WC-12Co" = [0.2, 1] }]
reason = "cracks"
[[alloy_rule]]
name = "titanium"
powders = ["Ti", "316L"]
forbidden = [{ "Ti" = [0.1, 0.9] }]
reason = "FeTi"
""")
    text = PART.format(rules="").replace('name = "part"',
                                         'name = "part"\nalloy_rule_files = ["shop.toml"]')
    part = part_from_text(text, tmp_path, "part")
    assert [rule.name for rule in part.alloy_rules.rules] == ["eta phase"]
    assert any("titanium" in note for note in part.notes)
    assert "shop.toml" in part.sources
