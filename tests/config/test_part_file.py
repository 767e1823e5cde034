"""Part files: what is accepted, and every mistake named with its path, all at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lmctl.config.part_file import PartFile
from lmctl.config.part_rules import cross_key_findings, load_part_file, parse_part_file
from lmctl.errors import ConfigError, MissingFileError

ONE_MATERIAL = 'name = "p"\n[[material]]\nname = "316L"\n'
BOX = '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [1, 2, 3]\n'
GRADED = (
    'name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n' + BOX
    + '[composition]\nfeature = { kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }\n'
)
STEEL_TO_CARBIDE = 'near = { "316L" = 1 }, far = { "WC-12Co" = 1 }'


def findings(text: str) -> list[tuple[str, str]]:
    with pytest.raises(ConfigError) as caught:
        parse_part_file(text, name="part.toml")
    assert caught.value.what.startswith("part.toml has ")
    return [(f.path, f.reason) for f in caught.value.findings]


def profile(text: str) -> str:
    return f"{GRADED}profile = {{ {text} }}\n"


def test_least_part_file() -> None:
    part = parse_part_file(ONE_MATERIAL + BOX, name="part.toml")
    assert isinstance(part, PartFile)
    assert part.pitch_mm is None
    assert part.placement is None
    assert part.composition is None
    assert part.process.bead_width_mm == 2.0


def test_a_file_as_windows_editors_save_it(tmp_path: Path) -> None:
    (tmp_path / "part.toml").write_bytes(
        b"\xef\xbb\xbf" + (ONE_MATERIAL + BOX).replace("\n", "\r\n").encode())
    part, text = load_part_file(tmp_path / "part.toml")
    assert part.name == "p"
    assert text == ONE_MATERIAL + BOX


@pytest.mark.parametrize(
    "text",
    [
        f'kind = "linear", {STEEL_TO_CARBIDE}, over_mm = [0, 5]',
        f'kind = "power", {STEEL_TO_CARBIDE}, over_mm = [0, 5], a = 2, k = 0.5',
        'kind = "constant", of = { "316L" = 0.25, "WC-12Co" = 0.75 }',
        'kind = "table", points = [{ at_mm = -1, of = { "316L" = 1 } }, '
        '{ at_mm = 4, of = { "WC-12Co" = 1 } }]',
    ],
)
def test_every_profile_is_accepted(text: str) -> None:
    parse_part_file(profile(text), name="part.toml")


@pytest.mark.parametrize(
    ("text", "path", "words"),
    [
        (BOX, "name", "missing"),
        ('name = "p"\n' + BOX, "material", "missing"),
        ('name = "p"\nmaterial = []\n' + BOX, "material", "at least one"),
        (ONE_MATERIAL, "body", "missing"),
        (ONE_MATERIAL + BOX + "colour = 3\n", "body[1].colour", "no such key"),
        ("pitch = 1\n" + ONE_MATERIAL + BOX, "pitch", "no such key"),
        ("pitch_mm = 0\n" + ONE_MATERIAL + BOX, "pitch_mm", "at least 0.0001"),
        ("pitch_mm = nan\n" + ONE_MATERIAL + BOX, "pitch_mm", "finite"),
        (ONE_MATERIAL + '[[body]]\nfile = "a.stl"\n', "body[1]", "`kind`"),
        (ONE_MATERIAL + '[[body]]\nkind = "ball"\n', "body[1]", "'sphere'"),
        (ONE_MATERIAL + '[[body]]\nkind = "mesh"\nfile = "a.stl"\n', "body[1].units", "missing"),
        (ONE_MATERIAL + '[[body]]\nkind = "mesh"\nfile = "a.stl"\nunits = "mm"\ngroup = "lid"\n',
         "body[1].group", "only OBJ"),
        (ONE_MATERIAL + '[[body]]\nkind = "mesh"\nfile = "a.stl"\nunits = "furlong"\n',
         "body[1].units", "'inch'"),
        (ONE_MATERIAL + BOX.replace("[1, 2, 3]", "[1, 0, 3]"), "body[1]", "low_mm is not below"),
        (ONE_MATERIAL + BOX.replace("[1, 2, 3]", "[1, 2]"), "body[1].high_mm[3]", "missing"),
        (ONE_MATERIAL + BOX.replace("[1, 2, 3]", "[1, 2, 1e300]"), "body[1].high_mm[3]", "100000"),
        (ONE_MATERIAL + '[[body]]\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = -1\n',
         "body[1].radius_mm", "above 0"),
        (ONE_MATERIAL + '[[body]]\nkind = "cylinder"\nbase_mm = [0, 0, 0]\ntop_mm = [0, 0, 0]\n'
         "radius_mm = 1\n", "body[1]", "same point"),
        (ONE_MATERIAL + BOX + BOX, "combine", "missing"),
        ('combine = "glue"\n' + ONE_MATERIAL + BOX + BOX, "combine", "'union'"),
        ('combine = "union"\n' + ONE_MATERIAL + BOX, "combine", "one body"),
        ('name = "p"\n[[material]]\nname = "316L"\n[[material]]\nname = "316L"\n' + BOX,
         "material[2].name", "twice"),
        ('name = "p"\n[[material]]\nname = "316l stainless"\n' + BOX,
         "material[1].density_g_cm3", "missing"),
        ('name = "p"\n[[material]]\nname = "IN 625"\n' + BOX,
         "material[1].density_g_cm3", "did you mean 'IN625'?"),
        (ONE_MATERIAL + "catch_efficiency = 1.2\n" + BOX,
         "material[1].catch_efficiency", "at most 1"),
        (GRADED.partition("[composition]")[0], "composition", "missing"),
        (GRADED, "composition.profile", "missing"),
        (profile('kind = "constant", of = { "316L" = 0.5 }'), "composition.profile.of", "0.5"),
        (profile('kind = "constant", of = { "316L" = 0.7, "WC-12Co" = 0.4 }'),
         "composition.profile.of", "1.1"),
        (profile('kind = "constant", of = { "316L" = 1.5, "WC-12Co" = -0.5 }'),
         "composition.profile.of.WC-12Co", "at least 0"),
        (profile('kind = "constant", of = { "WC-12C" = 1 }'),
         "composition.profile.of", "did you mean 'WC-12Co'?"),
        (profile('kind = "constant", of = { "gold" = 1 }'),
         "composition.profile.of", "materials are 316L, WC-12Co"),
        (profile('kind = "constant", of = {}'), "composition.profile.of", "at least one"),
        (profile('kind = "constant", of = { "316L" = nan }'),
         "composition.profile.of.316L", "finite"),
        (profile(f'kind = "linear", {STEEL_TO_CARBIDE}'), "composition.profile.over_mm", "missing"),
        (profile(f'kind = "linear", {STEEL_TO_CARBIDE}, over_mm = [5, 5]'),
         "composition.profile.over_mm", "below"),
        (profile(f'kind = "power", {STEEL_TO_CARBIDE}, over_mm = [0, 5]'),
         "composition.profile.k", "missing"),
        (profile(f'kind = "power", {STEEL_TO_CARBIDE}, over_mm = [0, 5], k = 0'),
         "composition.profile.k", "above 0"),
        (profile('kind = "table", points = []'), "composition.profile.points", "at least one"),
        (profile('kind = "table", points = [{ at_mm = 1, of = { "316L" = 1 } }, '
                 '{ at_mm = 1, of = { "316L" = 0.9 } }]'),
         "composition.profile.points[2].of", "0.9"),
        (profile('kind = "table", points = [{ at_mm = 1, of = { "316L" = 1 } }, '
                 '{ at_mm = 1, of = { "316L" = 1 } }]'),
         "composition.profile.points", "does not lie beyond"),
        (profile('kind = "wave"'), "composition.profile", "'table'"),
        (GRADED.replace("[0, 0, 1]", "[0, 0, 0]") + 'profile = { kind = "constant", '
         'of = { "316L" = 1 } }\n', "composition.feature.direction", "nowhere"),
        (ONE_MATERIAL + BOX + "[placement]\norigin_mm = [0, 0, inf]\n",
         "placement.origin_mm[3]", "finite"),
        (ONE_MATERIAL + BOX + "[process]\nbead_width_mm = -2\n",
         "process.bead_width_mm", "at least 0.05"),
    ],
)
def test_a_mistake_is_named_with_its_path(text: str, path: str, words: str) -> None:
    assert any(p == path and words in reason for p, reason in findings(text)), findings(text)


def test_a_list_is_not_also_called_empty_where_all_its_items_are_wrong() -> None:
    text = 'name = "p"\n[[material]]\nname = "316L"\n[[body]]\nkind = "sphere"\n'
    with pytest.raises(ConfigError) as error:
        parse_part_file(text + "centre_mm = [0, 0, nan]\nradius_mm = -2\n", name="p.toml")
    assert [f.path for f in error.value.findings] == ["body[1].centre_mm[3]", "body[1].radius_mm"]


def test_all_mistakes_at_once_also_across_keys() -> None:
    text = profile('kind = "linear", near = { "316l" = 1 }, far = { "WC-12Co" = 0.5 }') + (
        "[process]\nlayer_height_mm = 0\n[[body]]\nkind = 'mesh'\nfile = 'a.stl'\n"
    )
    paths = {path for path, _ in findings("pitch = 2\n" + text)}
    assert paths == {
        "pitch", "process.layer_height_mm", "body[2].units", "combine",
        "composition.profile.near", "composition.profile.far", "composition.profile.over_mm",
    }


def test_own_surface_needs_no_range() -> None:
    text = profile(f'kind = "linear", {STEEL_TO_CARBIDE}')
    text = text.replace(
        '{ kind = "axis", point_mm = [0, 0, 0], direction = [0, 0, 1] }', '{ kind = "surface" }'
    )
    parse_part_file(text, name="part.toml")


@given(st.lists(st.floats(0, 1), min_size=2, max_size=2), st.floats(-0.5, 0.5))
def test_fractions_must_sum_to_one(shares: list[float], error: float) -> None:
    a = shares[0]
    b = min(max(1 - a + error, 0.0), 1.0)
    text = profile(f'kind = "constant", of = {{ "316L" = {a!r}, "WC-12Co" = {b!r} }}')
    if abs(a + b - 1) <= 1e-6:
        parse_part_file(text, name="part.toml")
    else:
        assert any("sum to" in reason for _, reason in findings(text))


@given(st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(["kind", "name", "of", "near", "points", "file"]), inner),
    max_leaves=8,
))
def test_cross_checks_survive_any_shape_of_data(value: object) -> None:
    for key in ("material", "body", "composition"):
        list(cross_key_findings({key: value}))
        list(cross_key_findings({"composition": {"profile": value, "feature": value}, key: value}))


def test_files_that_are_not_part_files(tmp_path: Path) -> None:
    for name, data in {"empty.toml": b"", "binary.toml": b"\xff\xfe\x00", "cut.toml": b"a = [1,",
                       "deep.toml": b"a = " + b"[" * 5000}.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ConfigError, match=name):
            load_part_file(tmp_path / name)
    with pytest.raises(MissingFileError, match="no file"):
        load_part_file(tmp_path / "missing.toml")
    with pytest.raises(ConfigError, match="folder"):
        load_part_file(tmp_path)


def test_a_body_that_its_own_composition_names_is_of_the_part() -> None:
    own = (
        'composition.feature = { kind = "surface", of = "A" }\n'
        f"composition.profile = {{ kind = \"linear\", {STEEL_TO_CARBIDE}, over_mm = [0, 1] }}\n"
    )
    two = GRADED.partition(BOX)[0] + BOX + 'name = "A"\n' + own + BOX + 'name = "B"\n'
    of_steel = 'composition.profile = { kind = "constant", of = { "316L" = 1 } }\n'
    paths = [path for path, _ in findings(two + of_steel)]
    assert paths == ["combine"]  # which of two bodies is no longer passed over without a word
    part = parse_part_file('combine = "union"\n' + two + of_steel, name="part.toml")
    assert (part.root_body_indices(), part.reference_body_indices()) == ((0, 1), ())
    part = parse_part_file(two + own, name="part.toml")
    assert (part.root_body_indices(), part.reference_body_indices()) == ((1,), (0,))
