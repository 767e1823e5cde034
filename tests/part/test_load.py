"""From files to parts: six very different meshes, defaults that are named, and refusals."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmctl.config.bodies import MeshBody
from lmctl.config.part_rules import parse_part_file
from lmctl.errors import ConfigError, InputError, LmctlError, MissingFileError
from lmctl.field.plane import loop_area_mm2
from lmctl.part.load import load_part, part_from_model
from lmctl.part.part import Part, PartSection
from lmctl.part.resolution import checked_grid

Folder = Callable[..., Path]
SIX = ("thin", "tall", "islands", "holes", "200k", "three too many")
STEEL = 'name = "p"\n[[material]]\nname = "316L"\n'
TWO = STEEL + '[[material]]\nname = "WC-12Co"\n'
BOX = '[[body]]\nkind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [30, 20, 8]\n'
BALL = '[[body]]\nkind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 12\n'


def area(section: PartSection) -> float:
    return sum(loop_area_mm2(loop) for loop in section.loops)


def sliced_volume(part: Part, layers: int = 40) -> float:
    low, high = part.bounds_mm
    step = float(high[2] - low[2]) / layers
    heights = low[2] + step * (np.arange(layers) + 0.5)
    return step * sum(area(part.section(float(z))) for z in heights)


@pytest.fixture(scope="module")
def six(making: Any) -> dict[str, Any]:
    return dict(making.six())


@pytest.mark.parametrize("name", SIX)
def test_six_meshes_of_very_different_kinds(
    folder: Folder, making: Any, six: dict[str, Any], name: str
) -> None:
    mesh, volume = six[name]
    part = part_from_model(folder(m__stl=making.stl(mesh)) / "m.stl", units="mm")
    low, high = part.bounds_mm
    assert low == pytest.approx(mesh[0].min(axis=0), abs=1e-4)
    assert high == pytest.approx(mesh[0].max(axis=0), abs=1e-4)
    if np.isnan(volume):
        a, b, c = (mesh[0][mesh[1][:, k]] for k in range(3))
        sound = slice(0, len(mesh[1]) - 3) if name == "three too many" else slice(None)
        volume = np.einsum("ij,ij->", a[sound], np.cross(b, c)[sound]) / 6
    assert sliced_volume(part, 12 if name == "200k" else 40) == pytest.approx(volume, rel=0.01)
    assert any("left out" in text for text in part.warnings) == (name == "three too many")
    section = part.section(float(low[2] + 0.4 * (high[2] - low[2])))
    assert section.in_plane_distance.dtype == np.float32
    assert section.in_plane_distance.shape == section.grid.shape
    inside = np.count_nonzero(section.in_plane_distance > 0) * section.grid.pitch_mm**2
    rim = sum(float(np.hypot(*np.diff(loop, axis=0).T).sum()) for loop in section.loops)
    assert inside == pytest.approx(area(section), abs=0.5 * section.grid.pitch_mm * rim)
    assert section.in_plane_distance.max() >= 0.5


def test_part_file_with_a_mesh_in_inches(folder: Folder, making: Any) -> None:
    data = making.stl(making.box((0, 0, 0), (1, 2, 0.5)))
    where = folder(
        part__toml=TWO + '[[body]]\nkind = "mesh"\nfile = "m.stl"\nunits = "inch"\n'
        '[composition]\nfeature = { kind = "coordinate", along = "x" }\n'
        'profile = { kind = "linear", near = {"316L" = 1}, far = {"WC-12Co" = 1}, '
        "over_mm = [0, 25.4] }\n[placement]\norigin_mm = [5, 6, 7]\n",
        m__stl=data,
    )
    part = load_part(where / "part.toml")
    assert part.bounds_mm[1] == pytest.approx([25.4, 50.8, 12.7], rel=1e-6)
    assert part.sources == {"m.stl": hashlib.sha256(data).hexdigest()}
    assert part.text == (where / "part.toml").read_text()
    assert part.placement_mm == (5, 6, 7)
    assert part.warnings == ()
    assert [m.name for m in part.materials] == ["316L", "WC-12Co"]
    np.testing.assert_allclose(part.composition(np.array([[12.7, 0, 0]])), [[0.5, 0.5]])
    assert part.distance(part.grid.window(0, 4)).shape == (4, *part.grid.shape[1:])
    assert part.section(6.0).spatial_distance.max() == pytest.approx(6, abs=0.05)


def test_a_bare_mesh_names_its_defaults(folder: Folder, making: Any) -> None:
    where = folder(bracket__stl=making.stl(making.box((0, 0, 0), (20, 20, 10))))
    part = part_from_model(where / "bracket.stl")
    said = "\n".join(part.warnings + part.notes)
    for words in ("taken as mm", "all of it is 316L", "pitch_mm: by default 0.5",
                  "density 7.99", "catch efficiency 0.75", "bead_width_mm 2.0"):
        assert words in said
    assert part.name == "bracket"
    assert list(part.sources) == ["bracket.stl"]
    parse_part_file(part.text, name="made up")
    stated = part_from_model(where / "bracket.stl", units="cm")
    assert stated.bounds_mm[1] == pytest.approx([200, 200, 100])
    assert "taken as mm" not in "\n".join(stated.warnings)


def test_names_that_need_quoting(folder: Folder, making: Any) -> None:
    where = folder()
    for name in ('a "b" \\c.stl', "grün\x7f\x01.stl", "名.stl"):
        (where / name).write_bytes(making.stl(making.box((0, 0, 0), (20, 20, 10))))
        part = part_from_model(where / name, units="mm")
        assert list(part.sources) == [name]
        body = parse_part_file(part.text, name="again").body[0]
        assert isinstance(body, MeshBody)
        assert body.file == name


def test_materials_settle_in_order(folder: Folder) -> None:
    where = folder(
        part__toml='name = "p"\n[[material]]\nname = "316L"\npower_W = 1234\n'
        '[[material]]\nname = "dust"\ndensity_g_cm3 = 5\n' + BOX
        + '[composition]\nprofile = { kind = "constant", of = { "dust" = 1 } }\n'
        "[process]\nspeed_mm_s = 12\n",
    )
    steel, dust = load_part(where / "part.toml").materials
    assert (steel.power_W, steel.speed_mm_s) == (1234, 12)
    assert steel.density_g_mm3 == pytest.approx(7.99e-3)
    assert steel.apparent_g_mm3 == pytest.approx(4.4e-3)
    assert (dust.density_g_mm3, dust.power_W, dust.speed_mm_s) == (0.005, 1500, 12)
    assert dust.apparent_g_mm3 is None
    assert dust.catch_efficiency == 0.65
    assert steel.note() == "316L: by default density 7.99 g/cm³, catch efficiency 0.75"
    assert "catch efficiency 0.65" in dust.note()


def test_combined_bodies(folder: Folder) -> None:
    where = folder(part__toml='combine = "intersection"\n' + STEEL + BALL + BOX)
    part = load_part(where / "part.toml")
    assert part.bounds_mm[0] == pytest.approx([0, 0, 0], abs=0.01)
    assert part.bounds_mm[1] == pytest.approx([12, 12, 8], abs=0.05)
    assert area(part.section(3.0)) == pytest.approx(np.pi * (144 - 9) / 4, rel=2e-3)


def test_parts_are_the_same_every_time(folder: Folder) -> None:
    where = folder(part__toml='combine = "difference"\n' + STEEL + BOX + BALL)
    one, two = load_part(where / "part.toml"), load_part(where / "part.toml")
    np.testing.assert_array_equal(one.section(2.0).in_plane_distance,
                                  two.section(2.0).in_plane_distance)
    np.testing.assert_array_equal(one.distance(one.grid.window()), two.distance(two.grid.window()))


def test_a_formula_is_walked_by_slabs(folder: Folder) -> None:
    where = folder(part__toml="pitch_mm = 0.03\n" + STEEL + BALL)
    part = load_part(where / "part.toml")
    assert part.grid.n_nodes > 500_000_000
    window = part.grid.window(400, 401)
    assert part.distance(window).max() == pytest.approx(12, abs=0.2)


def test_a_section_outside_the_part_is_empty(folder: Folder) -> None:
    part = load_part(folder(part__toml=STEEL + BALL) / "part.toml")
    section = part.section(50.0)
    assert section.loops == []
    assert (section.in_plane_distance < 0).all()


def test_composition_takes_any_number_of_points(folder: Folder) -> None:
    text = TWO + BALL + '[composition]\nprofile = { kind = "linear", near = {"316L" = 1}, ' \
        'far = {"WC-12Co" = 1} }\n'
    part = load_part(folder(part__toml=text) / "part.toml")
    assert part.composition(np.empty((0, 3))).shape == (0, 2)
    points = np.random.default_rng(0).uniform(-12, 12, (500_001, 3))
    fractions = part.composition(points)
    assert fractions.shape == (500_001, 2)
    assert np.abs(fractions.sum(axis=1) - 1).max() < 1e-6
    assert fractions.min() >= 0
    one_by_one = part.composition(points[-1:])
    np.testing.assert_array_equal(one_by_one[0], fractions[-1])


@pytest.mark.parametrize(
    ("text", "what", "hint"),
    [
        ('pitch_mm = 0.002\n' + STEEL + BALL, "grid nodes", "pitch_mm of at least"),
        ('pitch_mm = 1e-300\n' + STEEL + BALL, "1 mistake", ""),
        (STEEL + BALL + "[process]\nbead_width_mm = 1e-300\n", "1 mistake", ""),
        ('combine = "union"\npitch_mm = 0.01\n' + STEEL + BALL + BOX, "grid nodes",
         "pitch_mm of at least"),
        (STEEL + BALL.replace("12", "90000"), "too fine", "units"),
        (STEEL + BALL.replace("12", "900") + "[process]\nbead_width_mm = 0.05\n", "too fine",
         "bead_width_mm"),
        ('combine = "difference"\n' + STEEL + BALL + BALL.replace("12", "15"),
         "leaves nothing", ""),
        ('combine = "intersection"\n' + STEEL + BALL + BOX.replace("[0, 0, 0]", "[29, 0, 0]"),
         "leaves nothing", ""),
        (STEEL + '[[body]]\nkind = "mesh"\nfile = "missing.stl"\nunits = "mm"\n', "no file", ""),
        (STEEL + '[[body]]\nkind = "mesh"\nfile = "../m.stl"\nunits = "mm"\n', "out of", "beside"),
        (STEEL + '[[body]]\nkind = "mesh"\nfile = "junk.stl"\nunits = "mm"\n', "STL", "export"),
        (STEEL + '[[body]]\nkind = "cloud"\nfile = "two.xyz"\nunits = "mm"\n', "2 points", "scan"),
    ],
)
def test_what_is_refused(folder: Folder, text: str, what: str, hint: str) -> None:
    where = folder(part__toml=text, junk__stl=b"\x00\x01" * 100, two__xyz="0 0 0\n1 1 1\n")
    with pytest.raises(LmctlError) as caught:
        load_part(where / "part.toml")
    assert what in caught.value.what
    assert hint in caught.value.hint


def test_a_pitch_that_needs_a_trillion_nodes_names_one_that_fits() -> None:
    box = np.zeros(3), np.full(3, 20.0)
    with pytest.raises(InputError, match=r"1e\+12 grid nodes, 12 TB of memory and 8") as caught:
        checked_grid(*box, 0.002, stored=True)
    pitch = float(caught.value.hint.split(",")[0].rpartition(" ")[2])
    assert 1.5e8 < checked_grid(*box, pitch, stored=True).n_nodes <= 2e9 / 12


def test_what_is_neither_part_mesh_nor_cloud(folder: Folder) -> None:
    where = folder(part__step=b"ISO-10303-21;", no__toml="name = 1\n")
    with pytest.raises(InputError, match="neither a part file, a mesh nor a point cloud"):
        part_from_model(where / "part.step")
    with pytest.raises(MissingFileError, match="no file"):
        part_from_model(where / "gone.stl")
    with pytest.raises(ConfigError):
        load_part(where / "no.toml")


def test_a_thin_mesh_graded_by_depth_needs_no_finer_pitch(folder: Folder, making: Any) -> None:
    where = folder(m__stl=making.stl(making.box((0, 0, 0), (60, 1.2, 20))))
    assert not any("thick" in text for text in part_from_model(where / "m.stl").warnings)
    (where / "part.toml").write_text(
        TWO + '[[body]]\nkind = "mesh"\nfile = "m.stl"\nunits = "mm"\n[composition]\n'
        'profile = { kind = "linear", near = {"316L" = 1}, far = {"WC-12Co" = 1} }\n'
    )
    part = load_part(where / "part.toml")
    assert not any("thick" in text for text in part.warnings)
    y = np.linspace(0.0, 1.2, 13)
    points = np.stack([np.full(13, 30.0), y, np.full(13, 10.0)], axis=1)
    depth = np.minimum(y, 1.2 - y)
    np.testing.assert_allclose(part.body.distance_at(points), depth, atol=1e-6)
    np.testing.assert_allclose(part.composition(points)[:, 1], depth / 0.6, atol=1e-3)


def test_a_cloud_too_sparse_for_its_pitch_names_one_that_fits(folder: Folder) -> None:
    random = np.random.default_rng(5)
    ball = random.normal(size=(600, 3))
    ball *= 10 / np.linalg.norm(ball, axis=1)[:, None]
    text = "\n".join(f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in ball.tolist())
    part = STEEL + '[[body]]\nkind = "cloud"\nfile = "s.xyz"\nunits = "mm"\n'
    where = folder(part__toml="pitch_mm = 0.2\n" + part, s__xyz=text)
    with pytest.raises(InputError, match=r"samples are up to .* the grid pitch is 0\.2 mm"):
        load_part(where / "part.toml")
    (where / "part.toml").write_text("pitch_mm = 1.5\n" + part)
    ball_part = load_part(where / "part.toml")
    assert area(ball_part.section(0.0)) == pytest.approx(100 * np.pi, rel=0.02)
    assert ball_part.sources.keys() == {"s.xyz"}


def test_a_body_that_is_only_measured_from_is_named(folder: Folder) -> None:
    """As a note; as a warning where it has a composition, and so was meant to be built."""
    measured = BOX + 'name = "A"\n'
    rule = ('composition.feature = { kind = "surface", of = "A" }\ncomposition.profile = { kind = '
            '"linear", near = { "316L" = 1 }, far = { "WC-12Co" = 1 }, over_mm = [0, 4] }\n')
    said = "'A' is only measured from: it is no part of the solid"
    part = load_part(folder(p__toml=TWO + measured + BOX + rule) / "p.toml")
    assert said in part.notes
    assert said not in part.warnings
    part = load_part(folder(p__toml=TWO + measured + rule + BOX + rule) / "p.toml")
    assert said in part.warnings
    assert said not in part.notes
