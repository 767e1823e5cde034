"""Material rules against hand calculation; sums are 1 whatever is asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from lmctl.config.part_rules import parse_part_file
from lmctl.part.materials.composition import CompositionField
from lmctl.part.materials.profiles import PowerLawProfile, TabulatedProfile
from lmctl.part.part_data import PartData
from lmctl.part.tree import BodyTree

HEAD = 'name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
BODY = '[[body]]\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 10\n'


def rule(composition: str, body: str = BODY, head: str = HEAD) -> CompositionField:
    return rule_in(f"{head}{body}[composition]\n{composition}\n")


def rule_in(text: str) -> CompositionField:
    return BodyTree(parse_part_file(text, name="p"), PartData(Path(), 2.0)).composition_field


def steel(found: CompositionField, *points: tuple[float, float, float]) -> list[float]:
    return [float(v) for v in found.fractions(np.array(points, dtype=float))[:, 0]]


CUTTER = {
    "linear": 'kind = "linear", near = {"316L" = 1}, far = {"WC-12Co" = 1}, over_mm = [40, 64]',
    "table": 'kind = "table", points = [{at_mm = 40, of = {"316L" = 1}}, '
    '{at_mm = 64, of = {"WC-12Co" = 1}}]',
    "power": 'kind = "power", near = {"316L" = 1}, far = {"WC-12Co" = 1}, k = 2, '
    "over_mm = [40, 64]",
}


@pytest.mark.parametrize(
    ("profile", "expected"),
    [
        ("linear", [1, 1, 0.75, 0.5, 0.25, 0, 0]),
        ("table", [1, 1, 0.75, 0.5, 0.25, 0, 0]),
        ("power", [1, 1, 0.9375, 0.75, 0.4375, 0, 0]),
    ],
)
def test_boring_cutter(profile: str, expected: list[float]) -> None:
    """The paper's boring cutter: explicit in x, linear and parabolic."""
    along = 'feature = { kind = "coordinate", along = "x" }'
    found = rule(f"{along}\nprofile = {{ {CUTTER[profile]} }}")
    at = [(x, 3, -2) for x in (0, 40, 46, 52, 58, 64, 76)]
    assert steel(found, *at) == pytest.approx(expected, abs=1e-12)


def test_axis_distance() -> None:
    found = rule('feature = { kind = "axis", point_mm = [0, 0, 5], direction = [0, 0, -3] }\n'
                 'profile = { kind = "linear", near = {"316L" = 1}, far = {"WC-12Co" = 1}, '
                 "over_mm = [0, 10] }")
    places = [(0.0, 0.0, 99.0), (3.0, 4.0, 0.0), (6.0, 8.0, -7.0), (20.0, 0.0, 0.0)]
    assert steel(found, *places) == pytest.approx([1, 0.5, 0, 0])
    slanted = rule('feature = { kind = "axis", point_mm = [0, 0, 0], direction = [1, 1, 0] }\n'
                   'profile = { kind = "linear", near = {"316L" = 1}, far = {"WC-12Co" = 1}, '
                   "over_mm = [0, 10] }")
    assert steel(slanted, (5, 5, 0), (0, 0, 4), (np.sqrt(2), -np.sqrt(2), 0)) == pytest.approx(
        [1, 0.6, 0.8])


def test_point_distance() -> None:
    found = rule('feature = { kind = "point", at_mm = [1, 1, 1] }\nprofile = { kind = "table", '
                 'points = [{at_mm = 2, of = {"316L" = 0.9, "WC-12Co" = 0.1}}, '
                 '{at_mm = 4, of = {"316L" = 0.5, "WC-12Co" = 0.5}}, '
                 '{at_mm = 12, of = {"316L" = 0.1, "WC-12Co" = 0.9}}] }')
    assert steel(found, (1, 1, 1), (1, 1, 4), (1, 9, 1), (1, 1, 99)) == pytest.approx(
        [0.9, 0.7, 0.3, 0.1])


def test_own_surface_normalised_by_the_largest_depth() -> None:
    """(5): f = d / max(d); material at the surface is `near`."""
    found = rule('profile = { kind = "linear", near = {"WC-12Co" = 1}, far = {"316L" = 1} }')
    assert steel(found, (10, 0, 0), (7.5, 0, 0), (0, 0, 0), (11, 0, 0)) == pytest.approx(
        [0, 0.25, 1, 0])
    box = rule('profile = { kind = "linear", near = {"WC-12Co" = 1}, far = {"316L" = 1} }',
               '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [30, 20, 8]\n')
    assert steel(box, (15, 10, 4), (15, 10, 1), (2, 10, 4)) == pytest.approx([1, 0.25, 0.5])


def test_own_surface_with_a_range_and_power() -> None:
    """(4): f1 = (a·d)^k, clamped."""
    found = rule('feature = { kind = "surface" }\nprofile = { kind = "power", a = 2, k = 3, '
                 'near = {"WC-12Co" = 1}, far = {"316L" = 1}, over_mm = [1, 5] }')
    places = [(10 - depth, 0, 0) for depth in (0, 1, 2, 3, 4, 9)]
    assert steel(found, *places) == pytest.approx([0, 0, 0.125, 1, 1, 1])


def test_many_materials_in_their_own_order() -> None:
    head = 'name = "p"\n' + "".join(
        f'[[material]]\nname = "{m}"\n' for m in ("Cu", "316L", "IN625", "WC"))
    found = rule('feature = { kind = "coordinate", along = "z" }\nprofile = { kind = "table", '
                 'points = [{at_mm = 0, of = {"WC" = 0.2, "Cu" = 0.8}}, '
                 '{at_mm = 2, of = {"IN625" = 1}}] }', head=head)
    np.testing.assert_allclose(found.fractions(np.array([[0, 0, 0], [0, 0, 1], [0, 0, 5.0]])),
                               [[0.8, 0, 0, 0.2], [0.4, 0, 0.5, 0.1], [0, 0, 1, 0]])


def test_one_material_needs_no_rule() -> None:
    found = rule_in('name = "p"\n[[material]]\nname = "316L"\n' + BODY)
    np.testing.assert_array_equal(found.fractions(np.zeros((4, 3))), np.ones((4, 1)))


mixtures = st.lists(st.floats(0, 1), min_size=3, max_size=3).filter(lambda v: sum(v) > 1e-3).map(
    lambda v: np.array(v) / sum(v))
distances = st.lists(st.floats(-1e5, 1e5), min_size=1, max_size=20).map(np.array)


@settings(max_examples=100)
@given(mixtures, mixtures, st.floats(-1e4, 1e4), st.floats(1e-3, 1e4), st.floats(1e-3, 1000),
       st.floats(0.01, 100), distances)
def test_spans_sum_to_one(near, far, start, length, a, k, distance):
    found = PowerLawProfile(near, far, (start, start + length), a, k).fractions(distance)
    assert np.abs(found.sum(axis=1) - 1).max() < 1e-6
    assert (found >= 0).all()


@settings(max_examples=100)
@example([(1e-197, np.array([0.0, 0.0, 1.0])), (-21.5, np.array([0.5, 0.25, 0.25]))], np.zeros(1))
@given(st.lists(st.tuples(st.floats(-1e4, 1e4), mixtures), min_size=1, max_size=8,
                unique_by=lambda row: round(row[0], 3)), distances)
def test_tables_sum_to_one(rows, distance):
    rows.sort(key=lambda row: row[0])
    table = TabulatedProfile(np.array([r[0] for r in rows]), np.stack([r[1] for r in rows]))
    found = table.fractions(distance)
    assert np.abs(found.sum(axis=1) - 1).max() < 1e-6
    assert (found >= 0).all()


def test_a_million_points_sum_to_one() -> None:
    found = rule(f'feature = {{ kind = "surface" }}\nprofile = {{ {CUTTER["power"]} }}')
    points = np.random.default_rng(0).uniform(-10, 10, (1_000_000, 3))
    fractions = found.fractions(points)
    assert np.abs(fractions.sum(axis=1) - 1).max() < 1e-6
