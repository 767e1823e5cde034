"""One solid with concave faces in every form and manner of writing: always the same solid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.part.load import load_part
from tests.part import angle_solid as angle
from tests.part.angle_solid import read, volume_mm3

TRIANGLE_ROWS = tuple(map(tuple, angle.TRIANGLES.tolist()))
#: Triangles and quads in turns, as programs write whose faces are no longer all alike.
MIXED = (*TRIANGLE_ROWS[:8], *angle.POLYGONS[2:])
ORDERS = ("ascii", "binary_little_endian", "binary_big_endian")


def refused(data: bytes | str, suffix: str, group: str | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read(data, suffix, group)
    assert "part." in caught.value.what
    assert caught.value.hint
    return caught.value


def whole(data: bytes | str, suffix: str, group: str | None = None) -> bool:
    """Every edge of the solid is in two triangles that run through it opposite ways."""
    mesh = read(data, suffix, group)
    rows = np.unique(
        mesh.vertices[mesh.triangles].reshape(-1, 3), axis=0, return_inverse=True)[1]
    edges = rows.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    once = len(np.unique(edges, axis=0)) == len(edges)
    closed = set(map(tuple, edges.tolist())) == set(map(tuple, edges[:, ::-1].tolist()))
    return once and closed and volume_mm3(mesh) == pytest.approx(angle.VOLUME_MM3)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("separator", [" ", "\t", "   ", " \t"])
def test_obj_polygons(separator: str, end: str) -> None:
    assert whole(angle.obj(separator, end), "obj")


def test_obj_lines_that_go_on() -> None:
    text = angle.obj().replace("f 6 5 4", "f 6 5 \\\n 4")
    assert "\\" in text
    assert whole(text, "obj")


@pytest.mark.parametrize("manner", ["of each face", "of each object", "mixed"])
def test_obj_negative_numbers_count_back_from_their_line(manner: str) -> None:
    lines = []
    for number, shift in enumerate((0.0, 30.0)):
        lines.append(f"o solid{number}")
        corners = [f"v {x + shift} {y} {z}" for x, y, z in angle.CORNERS.tolist()]
        if manner == "of each face":
            for polygon in angle.POLYGONS:
                lines += [corners[c] for c in polygon]
                lines.append("f " + " ".join(str(n - len(polygon)) for n in range(len(polygon))))
            continue
        lines += corners
        for row, polygon in enumerate(angle.POLYGONS):
            counted = [c + 1 + 12 * number if manner == "mixed" and row % 2 else c - 12
                       for c in polygon]
            lines.append("f " + " ".join(f"{c}//{c}" for c in counted))
    assert volume_mm3(read("\n".join(lines), "obj")) == pytest.approx(2 * angle.VOLUME_MM3)


def test_obj_groups_are_read_alone() -> None:
    text = "o first\ng metal\n" + angle.obj() + "g lid shiny\n" + "\n".join(
        f"v {x} {y} {z + 10}" for x, y, z in angle.CORNERS.tolist()
    ) + "\n" + "\n".join(
        "f " + " ".join(str(c - 12) for c in polygon) for polygon in angle.POLYGONS)
    assert len(read(text, "obj").triangles) == 40
    for group, low in (("metal", 0.0), ("lid", 10.0), ("shiny", 10.0), ("lid shiny", 10.0)):
        mesh = read(text, "obj", group)
        assert whole(text, "obj", group)
        assert mesh.vertices[mesh.triangles][..., 2].min() == low
    assert len(read(text, "obj", "first").triangles) == 40
    assert "metal" in refused(text, "obj", "metl").where[0]
    assert "only OBJ" in refused(angle.text_stl(), "stl", "metal").hint


def test_groups_of_one_file_are_bodies_of_their_own(tmp_path: Path) -> None:
    """Each of its own material, though they touch."""
    upper = "\n".join(f"v {x} {y} {z + 10}" for x, y, z in angle.CORNERS.tolist())
    faces = "\n".join("f " + " ".join(str(c - 12) for c in polygon) for polygon in angle.POLYGONS)
    (tmp_path / "a.obj").write_text(f"g foot\n{angle.obj()}g head\n{upper}\n{faces}\n")
    bodies = "".join(
        f'[[body]]\nkind = "mesh"\nname = "{name}"\nfile = "a.obj"\nunits = "mm"\n'
        f'group = "{name}"\n[body.composition]\nprofile = {{ kind = "constant", of = '
        f'{{ "{material}" = 1.0 }} }}\n'
        for name, material in (("foot", "316L"), ("head", "WC-12Co")))
    (tmp_path / "part.toml").write_text(
        'name = "p"\ncombine = "union"\n[[material]]\nname = "316L"\n[[material]]\n'
        f'name = "WC-12Co"\n{bodies}')
    part = load_part(tmp_path / "part.toml")
    mixture = part.composition(np.array([(3.0, 3.0, 5.0), (3.0, 3.0, 15.0)]))
    np.testing.assert_allclose(mixture, [[1.0, 0.0], [0.0, 1.0]], atol=1e-9)
    assert part.bounds_mm[1][2] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [("f 6 5 4 3 2 1", "f 6 5", "line 13"), ("f 6 5 4", "f 6 0 4", "line 13"),
     ("f 6 5 4", "f 6 -13 4", "line 13"), ("f 6 5 4", "f 6 99 4", "line 13"),
     ("f 6 5 4", "f 6 a 4", "line 13"), ("v 8.0 15.0", "v 8 x", "line 3"),
     ("v 8.0 15.0 0.0", "v 8 15", "line 3")],
)
def test_obj_lines_that_are_wrong_are_named(old: str, new: str, words: str) -> None:
    text = angle.obj()
    assert old in text
    assert words in refused(text.replace(old, new, 1), "obj").where[0]


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("flags", [False, True])
@pytest.mark.parametrize("polygons", [TRIANGLE_ROWS, MIXED, MIXED[::-1], angle.POLYGONS])
def test_ply_lists_of_any_lengths(order: str, flags: bool, polygons: Any) -> None:
    assert whole(angle.ply(order, polygons, flags), "ply")


@pytest.mark.parametrize("order", ORDERS[1:])
@pytest.mark.parametrize("polygons", [TRIANGLE_ROWS, MIXED])
def test_a_binary_ply_cut_short_is_refused_at_every_length(order: str, polygons: Any) -> None:
    data = angle.ply(order, polygons)
    for length in range(0, len(data), 3):
        refused(data[:length], "ply")


@pytest.mark.parametrize("polygons", [TRIANGLE_ROWS, MIXED, angle.POLYGONS])
def test_off_polygons(polygons: Any) -> None:
    assert whole(angle.off(polygons), "off")
    coloured = angle.off(polygons).replace("OFF", "COFF", 1).replace("10.0", "10.0 255 0 0 255")
    assert volume_mm3(read(coloured, "off")) == pytest.approx(angle.VOLUME_MM3)


def test_distances_of_a_concave_face_are_true() -> None:
    """A fan of a concave face has fins outside the solid, and nothing over its notch."""
    mesh = read(angle.obj(), "obj")
    lids = mesh.vertices[mesh.triangles]
    lids = lids[(lids[..., 2] == 10.0).all(axis=1)]
    area = np.linalg.norm(np.cross(lids[:, 1] - lids[:, 0], lids[:, 2] - lids[:, 0]), axis=1) / 2
    assert area.sum() == pytest.approx(192.0)


def test_a_polygon_that_crosses_itself_is_refused_with_its_place() -> None:
    bow_tie = "v 0 0 0\nv 10 10 0\nv 10 0 0\nv 0 10 0\nv 3 3 9\nf 1 2 3 4\nf 1 2 5\n"
    assert "crosses itself" in refused(bow_tie, "obj").what
    star = "".join(
        f"v {10 * np.cos(a)} {10 * np.sin(a)} 0\n" for a in np.arange(5) * 4 * np.pi / 5)
    assert "crosses itself" in refused(star + "v 0 0 5\nf 1 2 3 4 5\nf 1 2 6\n", "obj").what


def test_a_polygon_with_a_hole_cut_in_by_a_slit() -> None:
    square = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nv 3 3 0\nv 3 6 0\nv 6 6 0\nv 6 3 0\nv 4 4 4\n"
    mesh = read(square + "f 1 2 3 4 1 5 6 7 8 5\nf 5 6 9\n", "obj")
    flat = mesh.vertices[mesh.triangles]
    flat = flat[(flat[..., 2] == 0).all(axis=1)]
    area = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])[:, 2] / 2
    assert (area >= 0).all()
    assert area.sum() == pytest.approx(72.0)


HEADS = (b"solid x facet normal outer loop", b"ply\nformat", b"OFF", b"PK\x03\x04", b"# v 1 2 3",
         b"solid ascii\nfacet normal endsolid", bytes(range(80)))


@pytest.mark.parametrize("head", HEADS)
def test_a_binary_stl_may_begin_with_anything(head: bytes) -> None:
    assert whole(angle.binary_stl(head=head), "stl")
    short = refused(angle.binary_stl(head=head)[:-7], "stl")
    assert "20 triangles" in short.where[0] or "looks like" in short.where[0]


@pytest.mark.parametrize("name", ["part", "", "facet endsolid vertex", "a solid\tof solids"])
def test_a_text_stl_in_any_manner(name: str) -> None:
    text = angle.text_stl(name)
    assert whole(text, "stl")
    assert whole("\n \n" + text.upper(), "stl")
    assert whole(text.replace("\n", "\r\n"), "stl")
    assert whole(text.replace(" outer loop\n", " outer loop ").replace("\n  v", " v"), "stl")
    assert volume_mm3(read(text + text, "stl")) == pytest.approx(2 * angle.VOLUME_MM3)


def test_pieces_of_a_long_text_stl_fit_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lmctl.part.sources.stl_files._PIECE_BYTES", 150)
    assert whole(angle.text_stl(), "stl")


@pytest.mark.parametrize(
    ("data", "suffix", "looks"),
    [(angle.obj(), "stl", "an OBJ file"), (angle.text_stl(), "obj", "text STL"),
     (angle.off(), "stl", "an OFF file"), (angle.ply("ascii"), "stl", "a PLY file"),
     (b"PK\x03\x04" + bytes(100), "stl", "zip"), (b"<!DOCTYPE html>" + b"x" * 100, "stl", "page"),
     (b"ISO-10303-21;\n" + b"x" * 100, "stl", "STEP"), (angle.ply("ascii"), "off", "a PLY file"),
     (b"version https://git-lfs.github.com/spec/v1\noid sha256:1\n", "ply", "Git LFS"),
     (angle.text_stl(), "3mf", "text STL"), (angle.binary_stl(), "ply", "begin with")],
)
def test_what_a_file_really_is_is_said(data: bytes | str, suffix: str, looks: str) -> None:
    """A text of 537,555,055 triangles is not claimed."""
    error = refused(data, suffix)
    assert looks in str(error.where) or "holds no triangles" in error.what
    assert "triangles, its" not in str(error.where)
