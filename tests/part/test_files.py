"""Where data files may lie, and which are refused before a byte of them is parsed."""

from __future__ import annotations

import codecs
import hashlib
import os
from pathlib import Path

import pytest
import trimesh

from lmctl.errors import InputError, MissingFileError
from lmctl.part.faces import triangles_of_group
from lmctl.part.sources.cloud_files import read_cloud
from lmctl.part.sources.files import MAX_DATA_BYTES, read_data_file
from lmctl.part.sources.mesh_files import read_mesh


def test_a_file_is_read_and_hashed(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.STL").write_bytes(b"abc")
    file = read_data_file("sub/a.STL", tmp_path)
    assert (file.data, file.suffix) == (b"abc", "stl")
    assert file.sha256 == hashlib.sha256(b"abc").hexdigest()


BOX = trimesh.creation.box(extents=(30.0, 22.0, 16.0))


def marked(folder: Path, name: str, data: bytes) -> Path:
    """A file as Windows editors save text."""
    (folder / name).write_bytes(codecs.BOM_UTF8 + data)
    return folder


@pytest.mark.parametrize("suffix", ["stl_ascii", "obj", "off", "ply"])
def test_a_mesh_as_text_may_begin_with_a_byte_order_mark(tmp_path: Path, suffix: str) -> None:
    kind = suffix.partition("_")[0]
    text = BOX.export(file_type=suffix, **({"encoding": "ascii"} if kind == "ply" else {}))
    data = text.encode() if isinstance(text, str) else text
    name = f"box.{kind}"
    file = read_data_file(name, marked(tmp_path, name, data))
    assert file.sha256 == hashlib.sha256(codecs.BOM_UTF8 + data).hexdigest()
    mesh = read_mesh(file, "mm")
    assert len(mesh.triangles) == 12
    assert abs(mesh.vertices[mesh.triangles] - BOX.triangles).max() < 1e-6


def test_points_and_faces_of_text_with_a_byte_order_mark_are_all_there(tmp_path: Path) -> None:
    rows = "\n".join(f"{i},{i % 11},{i % 7}" for i in range(100))
    cloud = read_cloud(read_data_file("a.csv", marked(tmp_path, "a.csv", rows.encode())), "mm")
    assert len(cloud.points) == 100
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\ng lid\nf 1 2 3\n"
    file = read_data_file("a.obj", marked(tmp_path, "a.obj", corners))
    assert triangles_of_group(file, "lid", "mm").tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


def test_a_binary_stl_that_begins_with_those_bytes_keeps_them(tmp_path: Path) -> None:
    data = BOX.export(file_type="stl")[3:]
    assert read_data_file("a.stl", marked(tmp_path, "a.stl", data)).data == codecs.BOM_UTF8 + data


def test_absolute_paths_are_allowed_because_they_are_seen(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"abc")
    assert read_data_file(str(tmp_path / "a.stl"), Path("/nowhere")).data == b"abc"


def test_a_part_file_cannot_walk_out_of_its_folder(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (tmp_path / "secret.stl").write_bytes(b"abc")
    (home / "link.stl").symlink_to(tmp_path / "secret.stl")
    (home / "round.stl").symlink_to(home / "round.stl")
    for name in ("../secret.stl", "sub/../../secret.stl", "link.stl"):
        with pytest.raises(InputError, match="out of the part file's folder") as caught:
            read_data_file(name, home)
        assert "absolute path" in caught.value.hint
    with pytest.raises(InputError):
        read_data_file("round.stl", home)
    with pytest.raises(InputError, match="not a file name"):
        read_data_file("a\0b", home)


def test_what_is_not_a_file_with_content_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").touch()
    (tmp_path / "folder.stl").mkdir()
    os.mkfifo(tmp_path / "pipe.stl")  # reading it would wait for ever
    with (tmp_path / "huge.stl").open("wb") as huge:
        huge.truncate(MAX_DATA_BYTES + 1)
    with pytest.raises(MissingFileError, match="no file"):
        read_data_file("missing.stl", tmp_path)
    for name, words in {"empty.stl": "is empty",
                        "folder.stl": "is a folder", "pipe.stl": "not a plain file",
                        "huge.stl": "too large"}.items():
        with pytest.raises(InputError, match=words) as caught:
            read_data_file(name, tmp_path)
        assert name in caught.value.what
