"""Features, profiles and blends against hand calculation, through part files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from lmctl.array_types import FloatArray
from lmctl.config.part_rules import parse_part_file
from lmctl.errors import ConfigError, InputError
from lmctl.part.materials.composition import CompositionField, inverse_distance_weights
from lmctl.part.materials.features import TriangleSheetDistance, spline_polyline
from lmctl.part.part_data import PartData
from lmctl.part.tree import BodyTree

HEAD = 'name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
BOX = '[[body]]\nkind = "box"\nlow_mm = [-50, -50, -50]\nhigh_mm = [50, 50, 50]\n'
TENTH = ('profile = { kind = "linear", near = {"WC-12Co" = 1}, far = {"316L" = 1}, '
         "over_mm = [0, 10] }\n")


def tree(text: str, folder: Path = Path()) -> BodyTree:
    return BodyTree(parse_part_file(text, name="p"), PartData(folder, 2.0))


def graded(feature: str, profile: str = TENTH, folder: Path = Path()) -> CompositionField:
    return tree(f"{HEAD}{BOX}[composition]\n{feature}\n{profile}", folder).composition_field


def steel(rule: CompositionField, *points: tuple[float, float, float]) -> FloatArray:
    fractions = rule.fractions(np.array(points, dtype=float))
    assert np.abs(fractions.sum(axis=1) - 1).max() < 1e-6
    return fractions[:, 0]


@pytest.mark.parametrize(
    ("feature", "places", "tenths"),
    [
        ('kind = "segment", start_mm = [0, 0, 0], end_mm = [10, 0, 0]',
         [(5, 3, 0), (13, 4, 0), (-6, 0, 0)], [3, 5, 6]),
        ('kind = "polyline", points_mm = [[0, 0, 0], [10, 0, 0], [10, 10, 0]]',
         [(5, 2, 0), (12, 5, 0), (10, 14, 3)], [2, 2, 5]),
        ('kind = "spline", points_mm = [[0, 0, 0], [10, 0, 0]]', [(5, 2, 0), (-3, 4, 0)], [2, 5]),
        ('kind = "plane", point_mm = [0, 0, 1], normal = [0, 0, 2]',
         [(9, 9, 4), (0, 0, -4)], [3, 5]),
    ],
)
def test_distances_to_features(
    feature: str, places: list[tuple[float, float, float]], tenths: list[float]
) -> None:
    rule = graded(f"feature = {{ {feature} }}")
    assert steel(rule, *places) == pytest.approx(np.array(tenths) / 10)


def test_a_spline_passes_its_points_and_lies_on_the_curve() -> None:
    corners = np.array([[0, 0, 0], [10, 8, 0], [20, 0, 5], [30, 4, 0.0]])
    curve = spline_polyline(corners)
    assert curve.distance(corners).max() < 1e-12
    chords = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    between = CubicSpline(chords, corners, bc_type="natural")(np.linspace(0, chords[-1], 777))
    assert curve.distance(between).max() < 2e-3


def test_a_sheet_is_measured_exactly() -> None:
    random = np.random.default_rng(3)
    sheet = TriangleSheetDistance(np.array([[[0, 0, 0], [30, 0, 0], [0, 30, 0]],
                                            [[0, 0, 0], [0, 0, 5], [9, 0, 0]]],
                                           dtype=float))
    points = random.uniform(-20, 40, (500, 3))
    dense = random.dirichlet([1, 1, 1], 40_000)
    samples = np.vstack([dense @ sheet.corners_mm[0], dense @ sheet.corners_mm[1]])
    nearest = np.array([np.linalg.norm(samples - p, axis=1).min() for p in points[:60]])
    found = sheet.distance(points)
    assert (nearest >= found[:60] - 1e-9).all()
    assert np.abs(nearest - found[:60]).max() < 0.3
    assert sheet.distance(np.array([[5, 5, 4.0], [40, 0, 0], [-3, -4, 0]])) == pytest.approx(
        [4, 10, 5])


def test_faces_of_a_mesh_by_place_and_by_name(tmp_path: Path) -> None:
    obj = ["g sides"]
    for z in (0, 10):
        obj += [f"v {x} {y} {z}" for x, y in ((0, 0), (10, 0), (10, 10), (0, 10))]
    obj += [f"f {a} {b} {b + 4} {a + 4}" for a, b in ((1, 2), (2, 3), (3, 4), (4, 1))]
    obj += ["g bottom", "f 4 3 2 1", "g top", "f 5 6 7 8"]
    (tmp_path / "b.obj").write_text("\n".join(obj) + "\n")
    mesh = '[[body]]\nname = "block"\nkind = "mesh"\nfile = "b.obj"\nunits = "mm"\n'
    for choice in ("at_mm = [5, 5, 10.1]", 'group = "top"'):
        text = f'{HEAD}{mesh}[[body]]\nkind = "moved"\nof = "block"\n[composition]\n' \
            f'feature = {{ kind = "face", of = "block", {choice} }}\n{TENTH}'
        rule = tree(text, tmp_path).composition_field
        assert steel(rule, (5, 5, 8), (5, 5, 4), (13, 5, 6)) == pytest.approx([0.2, 0.6, 0.5])
    for choice, words in (('group = "lid"', "no faces in a group 'lid'"),
                          ("at_mm = [5, 5, 30]", "no face at")):
        text = f'{HEAD}{mesh}[[body]]\nkind = "moved"\nof = "block"\n[composition]\n' \
            f'feature = {{ kind = "face", of = "block", {choice} }}\n{TENTH}'
        with pytest.raises(InputError, match=words):
            _ = tree(text, tmp_path).composition_field


def test_depth_below_another_body_and_below_an_iso_contour() -> None:
    ball = '[[body]]\nname = "ball"\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 20\n'
    of_ball = 'feature = { kind = "surface", of = "ball", level_mm = 4 }'
    rule = tree(f"{HEAD}{BOX}{ball}[composition]\n{of_ball}\n{TENTH}").composition_field
    assert steel(rule, (16, 0, 0), (11, 0, 0), (0, 0, 6), (18, 0, 0)) == pytest.approx(
        [0, 0.5, 1, 0])


def test_every_kind_of_profile() -> None:
    along = 'feature = { kind = "coordinate", along = "x" }'
    parabola = graded(along, 'profile = { kind = "parabola", near = {"316L" = 1}, '
                             'far = {"WC-12Co" = 1}, over_mm = [40, 64] }')
    assert steel(parabola, *[(x, 0, 0) for x in (39, 46, 52, 58, 70)]) == pytest.approx(
        [1, 0.9375, 0.75, 0.4375, 0])
    steps = graded(along, 'profile = { kind = "steps", steps = [{over_mm = [0, 5], '
                          'of = {"316L" = 1}}, {over_mm = [5, 8], of = {"WC-12Co" = 1}}, '
                          '{over_mm = [8, 9], of = {"316L" = 0.5, "WC-12Co" = 0.5}}] }')
    assert steel(steps, *[(x, 0, 0) for x in (-9, 0, 4.999, 5, 7.9, 8, 99)]) == pytest.approx(
        [1, 1, 1, 0, 0, 0.5, 0.5])
    ball = '[[body]]\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 8\n'
    normalised = tree(f'{HEAD}{ball}[composition]\nprofile = {{ kind = "normalised", '
                      'near = {"WC-12Co" = 1}, far = {"316L" = 1} }\n').composition_field
    assert steel(normalised, (8, 0, 0), (6, 0, 0), (0, 0, 0)) == pytest.approx([0, 0.25, 1])


def mixed(weights: str, first: str, second: str) -> str:
    point = f'[[composition.blend]]\n{first}\nfeature = {{ kind = "point", at_mm = [0, 0, 0] }}\n'
    line = (f'[[composition.blend]]\n{second}\nfeature = {{ kind = "segment", '
            "start_mm = [4, 8, -9], end_mm = [4, 8, 9] }\n")
    return f"{HEAD}{BOX}[composition]\n{weights}\n{point}{TENTH}{line}{TENTH}"


def test_a_blend_with_constant_weights() -> None:
    """r_point 4, r_line 8, f = r/10, weights .3 and .7: (.68, .32)."""
    rule = tree(mixed('weights = "constant"', "weight = 0.3", "weight = 0.7")).composition_field
    np.testing.assert_allclose(rule.fractions(np.array([[4.0, 0, 0]])), [[0.68, 0.32]], atol=1e-12)


def test_a_blend_by_inverse_distance() -> None:
    rule = tree(mixed('weights = "inverse-distance"\npower = 2', "", "")).composition_field
    near, far = 1 / 16, 1 / 64
    expected = (near * 0.4 + far * 0.8) / (near + far)
    assert steel(rule, (4, 0, 0), (0, 0, 0), (4, 8, 0)) == pytest.approx([expected, 0, 0])


def test_inverse_shares_at_extremes() -> None:
    shares = inverse_distance_weights(np.array([[0.0, 0, 1e-300, 1e5], [0.0, 3, 1e5, 1e5]]), 20.0)
    np.testing.assert_allclose(shares, [[0.5, 1, 1, 0.5], [0.5, 0, 0, 0.5]])


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [
        (mixed("", "weight = 0", "weight = 0"), "composition.blend", "sum to 0"),
        (mixed("", "weight = 0.3", "weight = 0.6"), "composition.blend", "sum to 0.9, not to 1"),
        (mixed("", "weight = 0.3", ""), "composition.blend[2].weight", "is missing"),
        (mixed('weights = "inverse-distance"', "weight = 1", ""), "composition.blend[1].weight",
         "not used"),
        (f'{HEAD}{BOX}[composition]\nprofile = {{ kind = "steps", steps = [{{over_mm = [0, 5], '
         'of = {"316L" = 1}}, {over_mm = [6, 8], of = {"WC-12Co" = 1}}] }\n',
         "composition.profile.steps", "leaves a gap after step 1: it begins at 6 mm, step 1 ends "
         "at 5 mm"),
        (f'{HEAD}{BOX}[composition]\nfeature = {{ kind = "surface", of = "bal" }}\n{TENTH}',
         "composition.feature.of", "no body 'bal'"),
        (f'{HEAD}{BOX}name = "a"\n[[body]]\nkind = "union"\nof = ["a", "b"]\n', "body[2].of",
         "no body 'b'"),
        (HEAD + '[[body]]\nname = "a"\nkind = "shell"\nof = "b"\n[[body]]\nname = "b"\n'
         'kind = "moved"\nof = "a"\n', "body[1].of", "in a circle: 'a' is made of 'b' is made of"),
        (HEAD + BOX + BOX + 'composition.profile = { kind = "constant", of = {"316L" = 1} }\n',
         "body[1].composition", "of what is it"),
    ],
)
def test_mistakes_are_named_with_their_path(text: str, path: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_part_file(text, name="p")
    said = [(f.path, f.reason) for f in caught.value.findings]
    assert any(p == path and words in reason for p, reason in said), said


def test_bodies_of_bodies_do_not_explode() -> None:
    """Forty lines that ask for 2^40 bodies are refused at once."""
    text = HEAD + BOX + 'name = "b0"\n'
    for n in range(40):
        text += f'[[body]]\nname = "b{n + 1}"\nkind = "union"\nof = ["b{n}", "b{n}"]\n'
    with pytest.raises(ConfigError, match="mistake") as caught:
        parse_part_file(text, name="p")
    assert any("in all" in f.reason for f in caught.value.findings)


def test_a_depth_without_length_is_refused() -> None:
    """Level at the deepest place, beyond it, and a body that is endlessly deep."""
    rule = 'profile = { kind = "normalised", near = {"316L" = 1}, far = {"WC-12Co" = 1} }\n'
    for level in (50.0, 60.0):
        with pytest.raises(InputError, match="has no length") as caught:
            _ = graded(f'feature = {{ kind = "surface", level_mm = {level} }}', rule)
        assert "is at 50 mm" in str(caught.value.where)
    half = ('[[body]]\nname = "h"\nkind = "half-space"\npoint_mm = [0, 0, 0]\n'
            "outward = [-1, 0, 0]\n")
    of_half = 'feature = { kind = "surface", of = "h" }'
    with pytest.raises(InputError, match="has no length") as caught:
        _ = tree(f"{HEAD}{BOX}{half}[composition]\n{of_half}\n{rule}").composition_field
    assert "no deepest place" in str(caught.value.where)
    at_49 = graded('feature = { kind = "surface", level_mm = 49 }', rule)
    assert steel(at_49, (49.5, 0, 0), (0, 0, 0), (0.5, 0, 0)) == pytest.approx([1, 0, 0.5])
