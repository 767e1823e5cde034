"""Parts and data files that cannot be meant: what is wrong, where, and what to do about it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lmctl.errors import InputError, LmctlError
from lmctl.part.load import load_part, part_from_model
from tests.error_facts import assert_states
from tests.part.angle_solid import binary_stl, read
from tests.part_files import block_file

Folder = Callable[..., Path]

STEEL = 'name = "p"\n[[material]]\nname = "316L"\n'
TWO = STEEL + '[[material]]\nname = "WC-12Co"\n'
HALF = ('[[body]]\nname = "{name}"\nkind = "half-space"\npoint_mm = [0, 0, {z}]\n'
        "outward = [0, 0, 1]\n")
MAP = ('[[alloy_rule]]\nname = "computed"\npowders = ["316L", "WC-12Co"]\nmap_file = "map.csv"\n'
       'reason = "x"\n')
RED = 'profile = { kind = "constant", of = { "316L" = 1 } }\n'
GRADED = block_file((9, 9, 4), RED)
HEAD = "316L,WC-12Co,forbidden\n"
SHOP = 'alloy_rule_files = ["shop.toml"]\n'
MORE = "".join(f'[[material]]\nname = "{name}"\n' for name in ("IN625", "IN718", "Ti-6Al-4V"))
SLIVER = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]])
LIDS = ("v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\ng solid\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
        "v nan 0 0\nv 1 0 0\nv 0 1 0\ng lid\nf 5 6 7\n")


#: A block that a body far away is taken off, on a surface.
SUBSTRATE = (
    'combine = "difference"\n' + block_file((9, 9, 4))
    + '[[body]]\nname = "far"\nkind = "box"\nlow_mm = [60, 0, -5]\nhigh_mm = [69, 9, 0]\n'
    '[substrate]\nkind = "mesh"\nfile = "s.stl"\nunits = "mm"\n')
AROUND = np.array([[-9, -9, 0], [18, -9, 0], [18, 18, 0], [-9, 18, 0]])
BESIDE = np.array([[-90, 0, 0], [-80, 0, 0], [-90, 9, 0], [90, 0, 0], [99, 0, 0], [90, 9, 0]])


def face(keys: str) -> str:
    """A composition of the body b that measures from a face of its own."""
    return ('name = "b"\ncomposition.feature = { kind = "face", of = "b", ' + keys
            + " }\ncomposition." + RED)


@pytest.mark.parametrize(
    ("text", "files", "facts"),
    [
        (block_file((9, 9, 4), "#").partition("[composition]")[0] + face("at_mm = [0, 0, 0]"), {},
         ("'b' has no faces to choose from", "it is a box", "patches of a mesh")),
        (TWO + '[[body]]\nkind = "mesh"\nfile = "a.stl"\nunits = "mm"\n'
         + face('group = "lid"'), {"a__stl": binary_stl()},
         ("a.stl has no named faces", "only OBJ files", "at_mm")),
        (TWO + '[[body]]\nkind = "mesh"\nfile = "a.obj"\nunits = "mm"\n'
         'group = "solid"\n' + face('group = "lid"'), {"a__obj": LIDS},
         ("a.obj has coordinates that are not numbers", "export it again")),
        (block_file(
            (9, 9, 4), 'feature = { kind = "sheet", file = "s.stl", units = "mm" }\n' + RED),
         {"s__stl": binary_stl(np.array([[0, 1, 2]]), SLIVER)},
         ("s.stl has no triangle with an area", "export it again")),
        (GRADED + MAP, {"map__csv": b"316L,WC-12Co,forbidden\n\xff"},
         ("map.csv is not text", "CSV, UTF-8")),
        (GRADED + MAP, {"map__csv": "# computed\n\n"},
         ("map.csv has no rows", "only blank lines and comments")),
        (GRADED + MAP, {"map__csv": HEAD + "1,0,0\n" * 25_000},
         ("map.csv has too many rows", "25,001; at most 25,000", "coarser step")),
        (GRADED + MAP, {"map__csv": "316L,WC-12Co,forbidden\n1,0,0\n"},
         ("map.csv has too few mixtures", "1 rows")),
        (GRADED + MAP,
         {"map__csv": "316L,WC-12Co,forbidden\n0,1,0\n0.3,0.7,1\n1,0,0\n"},
         ("map.csv is not a whole map", "row 2 of 3: 0.3, 0.7", "steps of 1/2")),
        (GRADED + MAP, {"map__csv": HEAD + "0,1,0\n0.5,0.5,1\n0.5,0.5,1\n"},
         ("map.csv is not a whole map", "3 rows", "steps of 1/2 are 3, each once",
          "add the missing mixtures")),
        (SUBSTRATE + 'of = "far"\n',
         {"s__stl": binary_stl(np.array([[0, 1, 2], [0, 2, 3]]), AROUND)},
         ("s.stl does not lie over 'far'", "42.0 mm beside it", "register")),
        (SUBSTRATE, {"s__stl": binary_stl(np.array([[0, 1, 2], [3, 4, 5]]), BESIDE)},
         ("s.stl has no surface over the part", "coordinates, and its units")),
        (SHOP + block_file((9, 9, 4)), {"shop__toml": b"\xff"},
         ("shop.toml is not text", "save it as UTF-8")),
        (SHOP + GRADED.replace("[[body]]", MORE + "[[body]]"),
         {"shop__toml": MAP.replace('map_file = "map.csv"', 'forbidden = [{ "316L" = [0, 1] }]')},
         ("up to 4 materials", "block has 5", "'computed' concerns it", "leave materials out")),
        (SHOP + block_file((9, 9, 4)),
         {"shop__toml": MAP.replace('map_file = "map.csv"\n', "") + MAP},
         ("shop.toml has 2 mistakes", "alloy_rule[1]: forbids nothing",
          "'computed' is there twice")),
        ('combine = "intersection"\n' + block_file((9, 9, 9)) + HALF.format(name="b", z=4)
         + '[[body]]\nkind = "shell"\nof = "b"\nto_mm = 1\n', {},
         ("the shell of 'b' has no end", "cut it with a body that has one")),
        ('combine = "intersection"\n' + block_file((9, 9, 9)) + HALF.format(name="a", z=4)
         + HALF.format(name="c", z=9) + '[[body]]\nname = "b"\nkind = "union"\nof = ["a", "c"]\n'
         + '[[body]]\nkind = "moved"\nof = "b"\nby_mm = [1, 0, 0]\n', {},
         ("the union of 'a', 'c' has no end", "cut its half-spaces")),
        (STEEL + f'[[body]]\nkind = "mesh"\nfile = "{"m" * 300}.stl"\nunits = "mm"\n', {},
         ("cannot read", "File name too long")),
    ],
)
def test_a_part(text: str, files: dict[str, str | bytes], facts: tuple[str, ...],
                folder: Folder) -> None:
    path = folder(part__toml=text, **files) / "part.toml"
    with pytest.raises(LmctlError) as refused:
        load_part(path).composition(np.array([[1.0, 1.0, 1.0]]))
    assert_states(refused.value, *facts)


@pytest.mark.parametrize(
    ("data", "suffix", "facts"),
    [
        (binary_stl()[:40] + b"\0", "stl", ("41 bytes; the shortest has 84",)),
        ("solid p\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 l 0\nendfacet\nendsolid p\n", "stl",
         ("a corner is not three numbers: '0 l 0'",)),
        ("v 0 0 0\nv 1 0 0\nv 0 l 0\nf 1 2 3\n", "obj", ("line 3", "three numbers are wanted")),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "obj", ("line 4", "corners are whole numbers")),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "obj", ("line 4", "three corners or more")),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 l 0\n3 0 1 2\n", "off", ("a corner is not three numbers",)),
    ],
)
def test_a_mesh(data: str | bytes, suffix: str, facts: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as refused:
        read(data, suffix)
    assert_states(refused.value, *facts)


def test_a_mesh_of_more_triangles_than_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lmctl.part.sources.mesh_files.MAX_TRIANGLES", 10)
    with pytest.raises(InputError, match=r"20 triangles; at most 10 are read") as refused:
        read(binary_stl(), "stl")
    assert "reduce the mesh" in refused.value.hint


def test_a_number_that_only_a_program_reads_is_found_in_its_line(tmp_path: Path) -> None:
    rows = [f"{x} {y} 0" for x in range(10) for y in range(10)]
    rows[7] = "1_0 2 3"
    (tmp_path / "a.xyz").write_text("\n".join(rows))
    with pytest.raises(InputError, match="line 8: three numbers are wanted") as refused:
        part_from_model(tmp_path / "a.xyz", "mm")
    assert "'1_0 2 3'" in refused.value.where[0]


def test_a_file_whose_name_no_part_file_can_state(tmp_path: Path) -> None:
    path = tmp_path / "a\udcff.stl"
    path.write_bytes(binary_stl())
    with pytest.raises(InputError, match="not valid text") as refused:
        part_from_model(path, "mm")
    assert refused.value.hint == "rename it"


def test_a_cloud_without_points(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n"
        "0 0\n")
    with pytest.raises(InputError, match="holds no points") as refused:
        part_from_model(tmp_path / "a.ply", "mm")
    assert "x, y and z" in refused.value.where[0]


def test_a_flat_surface_is_measured_from_and_deposited_on(folder: Folder) -> None:
    """Neither is a solid: a plane face exported alone was refused for having no volume."""
    square = np.array([[-5, -5, 0], [20, -5, 0], [20, 20, 0], [-5, 20, 0]])
    flat = binary_stl(np.array([[0, 1, 2], [0, 2, 3]]), square)
    linear = ('profile = { kind = "linear", near = { "316L" = 1 }, far = { "WC-12Co" = 1 }, '
              "over_mm = [0, 4] }\n")
    text = block_file(
        (9, 9, 4), 'feature = { kind = "sheet", file = "s.stl", units = "mm" }\n' + linear)
    text += '[substrate]\nkind = "mesh"\nfile = "s.stl"\nunits = "mm"\n'
    part = load_part(folder(part__toml=text, s__stl=flat) / "part.toml")
    assert part.composition(np.array([[4.0, 4.0, 1.0]]))[0] == pytest.approx([0.75, 0.25])
    assert part.layer_stack is None  # level, as on a plate


def test_solids_of_which_nothing_is_left_when_they_are_united(
    folder: Folder, making: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lmctl.part.sources.mesh_solids.OVERLAP_MM", 1000.0)
    boxes = making.join([making.box((0, 0, 0), (9, 9, 9)), making.box((5, 5, 5), (15, 15, 15))])
    text = STEEL + '[[body]]\nkind = "mesh"\nfile = "a.stl"\nunits = "mm"\n'
    path = folder(part__toml=text, a__stl=making.stl(boxes)) / "part.toml"
    with pytest.raises(InputError) as refused:
        load_part(path)
    assert_states(refused.value, "the solids of the mesh a.stl cannot be united", "2 shells",
                  "unite them in the program they came from")


def test_a_cloud_whose_fitted_surface_leaves_its_grid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lmctl.part.bodies.is_closed", lambda field: False)
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    points = 8 * directions / np.linalg.norm(directions, axis=1)[:, None]
    np.savetxt(tmp_path / "a.xyz", points)
    with pytest.raises(InputError) as refused:
        part_from_model(tmp_path / "a.xyz", "mm")
    assert_states(refused.value, "fitted to the point cloud is not closed",
                  "reaches the edge of its grid", "larger pitch_mm")
