"""Where data files may lie, and which are refused before a byte of them is parsed."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from lmctl.errors import InputError
from lmctl.part.sources.files import LARGEST_DATA_BYTES, read_data


def test_a_file_is_read_and_hashed(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.STL").write_bytes(b"abc")
    file = read_data("sub/a.STL", tmp_path)
    assert (file.data, file.suffix) == (b"abc", "stl")
    assert file.sha256 == hashlib.sha256(b"abc").hexdigest()


def test_absolute_paths_are_allowed_because_they_are_seen(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(b"abc")
    assert read_data(str(tmp_path / "a.stl"), Path("/nowhere")).data == b"abc"


def test_a_part_file_cannot_walk_out_of_its_folder(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (tmp_path / "secret.stl").write_bytes(b"abc")
    (home / "link.stl").symlink_to(tmp_path / "secret.stl")
    (home / "round.stl").symlink_to(home / "round.stl")
    for name in ("../secret.stl", "sub/../../secret.stl", "link.stl"):
        with pytest.raises(InputError, match="out of the part file's folder") as caught:
            read_data(name, home)
        assert "absolute path" in caught.value.hint
    with pytest.raises(InputError):
        read_data("round.stl", home)
    with pytest.raises(InputError, match="not a file name"):
        read_data("a\0b", home)


def test_what_is_not_a_file_with_content_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").touch()
    (tmp_path / "folder.stl").mkdir()
    os.mkfifo(tmp_path / "pipe.stl")  # reading it would wait for ever
    with (tmp_path / "huge.stl").open("wb") as huge:
        huge.truncate(LARGEST_DATA_BYTES + 1)
    for name, words in {"missing.stl": "no file", "empty.stl": "is empty",
                        "folder.stl": "is a folder", "pipe.stl": "not a plain file",
                        "huge.stl": "too large"}.items():
        with pytest.raises(InputError, match=words) as caught:
            read_data(name, tmp_path)
        assert name in caught.value.what
