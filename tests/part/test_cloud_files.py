"""Point clouds: the ways scanners write columns, and what is refused with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.errors import InputError
from lmctl.part.sources.cloud_files import MIN_POINTS, PointCloud, read_cloud
from lmctl.part.sources.files import DataFile

POINTS = np.round(np.random.default_rng(3).uniform(-20, 20, (150, 3)), 3)


def read(data: bytes | str, suffix: str = "xyz", units: str = "mm") -> PointCloud:
    raw = data.encode() if isinstance(data, str) else data
    return read_cloud(DataFile(Path(f"scan.{suffix}"), raw, ""), units)


def refused(data: bytes | str, suffix: str = "xyz") -> InputError:
    with pytest.raises(InputError) as caught:
        read(data, suffix)
    assert f"scan.{suffix}" in caught.value.what
    return caught.value


def rows(separator: str = " ", before: str = "", after: str = "") -> str:
    lines = [before + separator.join(f"{v:.3f}" for v in p) + after for p in POINTS]
    return "\n".join(lines) + "\n"


def in_order(cloud: PointCloud) -> bool:
    return bool(np.array_equal(cloud.points, np.unique(POINTS, axis=0)))


@pytest.mark.parametrize(
    ("text", "suffix"),
    [
        (rows(), "xyz"),
        (rows("\t"), "txt"),
        (rows("   ", before="  "), "asc"),
        (rows(","), "csv"),
        (rows(", "), "csv"),
        (rows(";"), "csv"),
        ("# a scan\n\n" + rows() + "\n\n", "xyz"),
        ("x,y,z\n" + rows(","), "csv"),
        ('"X [mm]";"Y [mm]";"Z [mm]"\n' + rows(";"), "csv"),
        ("//X Y Z\n" + rows(), "txt"),
        (rows().replace("\n", "\r\n"), "xyz"),
        (rows().rstrip("\n"), "xyz"),
    ],
)
def test_columns_as_scanners_write_them(text: str, suffix: str) -> None:
    cloud = read(text, suffix)
    assert in_order(cloud)
    assert cloud.notes == ()


def test_other_columns_are_ignored_and_that_is_said() -> None:
    cloud = read("id,z,y,x\n" + "".join(
        f"{i},{z},{y},{x}\n" for i, (x, y, z) in enumerate(POINTS.tolist())
    ), "csv")
    assert in_order(cloud)
    assert "4, 3, 2 are read as x, y, z" in cloud.notes[0]
    assert "1, 2, 3" in read(rows(after=" 0 0 1")).notes[0]


def test_ply_clouds_and_meshes_read_as_clouds() -> None:
    assert in_order(read(trimesh.PointCloud(POINTS).export(file_type="ply"), "ply")) is False  # f4
    cloud = read(trimesh.PointCloud(POINTS).export(file_type="ply"), "ply")
    np.testing.assert_allclose(cloud.points, np.unique(POINTS, axis=0), atol=1e-5)
    mesh = read(trimesh.creation.icosphere(2, 10).export(file_type="ply"), "ply")
    assert len(mesh.points) == 162
    assert "320 faces are not used" in mesh.notes[0]


def test_points_there_twice_count_once() -> None:
    cloud = read(rows() + rows())
    assert in_order(cloud)
    assert "150 points are there twice" in cloud.notes[0]


def test_order_of_points_does_not_matter() -> None:
    lines = rows().splitlines()
    backwards = read("\n".join(lines[::-1]))
    np.testing.assert_array_equal(backwards.points, read(rows()).points)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("\n# nothing\n", "no points"),
        ("x,y,z\n", "0 points"),
        ("x,y\n1,2\n", "no column z"),
        ("x,x,y,z\n1,2,3,4\n", "no column x"),
        ("1 2\n3 4\n", "no three columns"),
        (rows() + "1 2\n" + rows(), "line 151"),
        (rows() + "1 2 oops\n" + rows(), "line 151"),
        (rows()[:-9], "line 150"),
        (rows() + "nan 1 2\n", "not numbers"),
        (rows() + "1 inf 2\n", "not numbers"),
        ("0 0 0\n9 9 9\n", "2 points"),
        ("\n".join(rows().splitlines()[: MIN_POINTS - 1]), "99 points"),
        (rows().replace(" ", "\0"), "not text"),
    ],
)
def test_what_is_refused(text: str, words: str) -> None:
    assert words in refused(text).what


@settings(max_examples=60, deadline=None)
@given(st.binary(min_size=1, max_size=200), st.sampled_from(["xyz", "csv", "ply", "pcd"]))
def test_garbage_is_refused(data: bytes, suffix: str) -> None:
    refused(data, suffix)


def test_flat_small_and_far_clouds() -> None:
    flat = "\n".join(f"{x} {y} 5" for x, y, _ in POINTS.tolist())
    assert "flat" in refused(flat).what
    small = "\n".join(f"{x / 1000} {y / 1000} {z / 1000}" for x, y, z in POINTS.tolist())
    assert "in m" in refused(small).hint


def with_normals(separator: str = " ", names: str = "") -> tuple[str, np.ndarray]:
    """Each point with a normal away from the middle."""
    normals = np.round(POINTS / np.linalg.norm(POINTS, axis=1)[:, None], 5)
    lines = [separator.join(f"{v:.5f}" for v in row) for row in np.hstack([POINTS, normals])]
    return "\n".join([names, *lines] if names else lines) + "\n", normals


def belongs(cloud: PointCloud) -> bool:
    """Every point still has its own normal."""
    assert cloud.normals is not None
    size = np.linalg.norm(cloud.points, axis=1)[:, None]
    return bool(np.allclose(cloud.normals, cloud.points / size, atol=2e-5))


@pytest.mark.parametrize(
    ("separator", "names"),
    [(" ", ""), (",", ""), (",", "x,y,z,nx,ny,nz"), (";", "X;Y;Z;Normal_X;Normal_Y;Normal_Z"),
     (",", "//X,Y,Z,Nx,Ny,Nz")],
)
def test_normals_behind_the_coordinates_are_read(separator: str, names: str) -> None:
    cloud = read(with_normals(separator, names)[0], "csv")
    assert belongs(cloud)
    assert any("normals" in note for note in cloud.notes)


@pytest.mark.parametrize("ascii_form", [True, False])
def test_normals_of_a_ply_are_read(ascii_form: bool) -> None:
    _, normals = with_normals()
    names = ["x", "y", "z", "nx", "ny", "nz"]
    head = "\n".join(
        ["ply", f"format {'ascii' if ascii_form else 'binary_little_endian'} 1.0",
         f"element vertex {len(POINTS)}", *(f"property float {n}" for n in names), "end_header", ""]
    ).encode()
    table = np.hstack([POINTS, normals])
    body = with_normals()[0].encode() if ascii_form else table.astype("<f4").tobytes()
    assert belongs(read(head + body, "ply"))


@pytest.mark.parametrize("extra", ["255 128 0", "0.5 0.5 0.5", "0 0 1", "a b c", "nan nan nan"])
def test_further_columns_that_are_no_normals_are_left_alone(extra: str) -> None:
    """Colours, an intensity, or the same direction everywhere."""
    cloud = read(rows(after=" " + extra))
    assert in_order(cloud)
    assert cloud.normals is None
    assert not any("normals" in note for note in cloud.notes)
