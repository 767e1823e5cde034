"""Mesh files: whole ones read exactly, everything else refused with what, where and what next."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from lmctl.errors import InputError
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.mesh_files import Mesh, read_mesh


def read(data: bytes | str, suffix: str, units: str = "mm") -> Mesh:
    raw = data.encode() if isinstance(data, str) else data
    return read_mesh(DataFile(Path(f"part.{suffix}"), raw, ""), units)


def refused(data: bytes | str, suffix: str, units: str = "mm") -> InputError:
    with pytest.raises(InputError) as caught:
        read(data, suffix, units)
    assert f"part.{suffix}" in caught.value.what
    assert caught.value.hint
    return caught.value


@pytest.fixture
def exports(making: Any) -> dict[str, bytes]:
    """One box in every form that is read."""
    vertices, triangles = making.box((0, 0, 0), (10, 20, 30))
    box = trimesh.Trimesh(vertices, triangles, process=False)
    forms = {
        "binary.stl": making.stl((vertices, triangles)),
        "text.stl": box.export(file_type="stl_ascii"),
        "binary.ply": box.export(file_type="ply"),
        "text.ply": box.export(file_type="ply", encoding="ascii"),
        "text.obj": box.export(file_type="obj"),
        "quads.obj": "\n".join([
            "# four corners a face", "mtllib /etc/passwd", "usemtl x",
            *(f"v {x} {y} {z}" for x, y, z in vertices.tolist()),
            "f 1 2 4 3", "f 5 7 8 6", "f 1 5 6 2", "f 3 4 8 7", "f 1 3 7 5", "f 2 6 8 4", "",
        ]),
    }
    return {name: d if isinstance(d, bytes) else d.encode() for name, d in forms.items()}


FORMS = ("binary.stl", "text.stl", "binary.ply", "text.ply", "text.obj", "quads.obj")


@pytest.mark.parametrize("form", FORMS)
def test_every_form_reads_to_the_same_solid(exports: dict[str, bytes], form: str) -> None:
    mesh = read(exports[form], form.split(".")[1])
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    assert len(mesh.triangles) == 12
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(6000, rel=1e-6)


@pytest.mark.parametrize(("units", "factor"), [("cm", 10), ("inch", 25.4)])
def test_units_scale(exports: dict[str, bytes], units: str, factor: float) -> None:
    mesh = read(exports["binary.stl"], "stl", units)
    assert mesh.vertices.max() == pytest.approx(30 * factor)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.97])
def test_truncated_files_are_refused(exports: dict[str, bytes], form: str, share: float) -> None:
    data = exports[form]
    if form.endswith("obj"):
        # OBJ has no end and no counts: what is left may be a whole, smaller file. It is then open,
        # and refused as that (test_mesh_report). Here only: no traceback.
        with contextlib.suppress(InputError):
            read(data[: int(share * len(data))], "obj")
        return
    error = refused(data[: int(share * len(data))], form.split(".")[1])
    assert any(word in error.what for word in ("truncated", "not a", "damaged")), error.what


def test_binary_stl_at_every_length(exports: dict[str, bytes]) -> None:
    data = exports["binary.stl"]
    for length in range(1, len(data)):
        refused(data[:length], "stl")
    refused(data + b"\0", "stl")
    refused(data + data[84:134], "stl")


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.binary(max_size=300), st.sampled_from(["stl", "ply", "obj"]))
@example(b"solid x\nfacet normal 0 0 1\nvertex 1 2\nendsolid", "stl")
@example(b"ply\nformat ascii 1.0\nelement vertex 1\n"
         b"property list int int x\nend_header\n9 9", "ply")
@example(b"ply\nformat binary_little_endian 1.0\nelement face 2\n"
         b"property list uint uint v\nend_header\n\xff\xff\xff\xff\xff\xff\xff\xff", "ply")
@example(b"f 1 2 3\n", "obj")
@example(b"v 0 0 0\nf 1 1 -9\n", "obj")
def test_garbage_is_refused(data: bytes, suffix: str) -> None:
    refused(data, suffix) if data else None


def test_hostile_counts_allocate_nothing(exports: dict[str, bytes]) -> None:
    stl = exports["binary.stl"]
    assert "4,294,967,295" in refused(stl[:80] + b"\xff\xff\xff\xff" + stl[84:], "stl").where[0]
    for form in ("text.ply", "binary.ply"):
        huge = exports[form].replace(b"element vertex 8", b"element vertex 99999999999")
        assert "truncated" in refused(huge, "ply").what
        refused(exports[form].replace(b"element vertex 8", b"element vertex -8"), "ply")


@pytest.mark.parametrize("word", ["nan", "inf", "-inf", "1e999"])
def test_coordinates_that_are_not_numbers(exports: dict[str, bytes], word: str) -> None:
    text = exports["quads.obj"].replace(b"v 10.0 20.0 30.0", f"v 10.0 {word} 30.0".encode())
    error = refused(text, "obj")
    assert "not numbers" in error.what
    assert "corner 8" in error.where[0]
    ply = exports["text.ply"].decode().replace("20.00000000", word)
    assert "not numbers" in refused(ply, "ply").what
    stl = exports["text.stl"].decode().replace("vertex 10.0 20.0 30.0", f"vertex 10.0 {word} 30.0")
    assert "not numbers" in refused(stl, "stl").what


def test_words_that_are_no_numbers_lose_nothing_silently(exports: dict[str, bytes]) -> None:
    refused(exports["quads.obj"].replace(b"v 0.0 20.0 0.0", b"v 0.0 abc 0.0"), "obj")
    refused(exports["text.stl"].replace(b"vertex 10.0", b"vertex ten", 1), "stl")
    refused(exports["text.ply"].replace(b"20.00000000", b"twenty", 1), "ply")


def test_corners_that_are_not_there(exports: dict[str, bytes]) -> None:
    refused(exports["quads.obj"].replace(b"f 2 6 8 4", b"f 2 6 99 4"), "obj")
    refused(exports["text.ply"].rstrip().rsplit(b"\n", 1)[0] + b"\n3 1 2 99\n", "ply")


@pytest.mark.parametrize(
    ("size", "units", "meant"),
    [(0.06, "mm", "m"), (60, "m", "mm"), (2.5, "m", "mm"), (0.5, "mm", "inch"), (1e9, "mm", "")],
)
def test_a_size_no_part_has_asks_for_the_units(
    making: Any, size: float, units: str, meant: str
) -> None:
    data = making.stl(making.box((0, 0, 0), (size, size / 2, size / 3)))
    error = refused(data, "stl", units)
    assert f"read in {units}" in error.what
    assert "1 mm and 2 m" in error.where[0]
    named = {word.strip("?") for word in error.hint.split()} & {"mm", "cm", "m", "inch"}
    assert (meant in named) if meant else not named
    assert units not in named


def test_flat_far_and_pointless_meshes(making: Any) -> None:
    assert "flat" in refused(making.stl(making.box((0, 0, 0), (10, 10, 0))), "stl").what
    far = making.box((0, 0, 0), (10, 10, 10))
    assert "origin" in refused(making.stl((far[0] + 1e6, far[1])), "stl").what
    cloud = trimesh.PointCloud(np.eye(3)).export(file_type="ply")
    assert "cloud" in refused(cloud, "ply").hint
    assert "STL, PLY, OBJ, OFF and 3MF" in refused(b"abc", "step").hint


def test_names_in_other_encodings_do_not_matter(exports: dict[str, bytes]) -> None:
    assert len(read(b"o gr\xfcn\n" + exports["quads.obj"], "obj").triangles) == 12
    text = b"solid gr\xfcn\n" + exports["text.stl"].partition(b"\n")[2]
    assert len(read(text, "stl").triangles) == 12
