"""Large fields are kept in unnamed files, and are the same there."""

from __future__ import annotations

import errno
import gc
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lmctl.errors import InputError
from lmctl.field import array_storage
from lmctl.field.array_storage import allocate_array
from lmctl.field.cloud.cloud_field import cloud_field
from lmctl.field.field import DistanceField, sample_distance
from lmctl.field.grid import Grid
from lmctl.field.mesh.mesh_field import mesh_field

BALL = Grid.enclosing(np.full(3, -6.0), np.full(3, 6.0), 0.5)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def around_a_ball(count: int) -> np.ndarray:
    """Points on a sphere of radius 5, a golden angle apart."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z * z)
    return 5 * np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def of_a_mesh() -> DistanceField:
    corners = 5 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    sides = [(x, y, z) for x in (0, 1) for y in (2, 3) for z in (4, 5)]
    return mesh_field(corners.astype(float), np.array(sides), BALL)


def of_a_cloud() -> DistanceField:
    return cloud_field(around_a_ball(3000), BALL)


def is_in_a_file(array: np.ndarray) -> bool:
    while isinstance(array, np.ndarray) and array.base is not None:
        array = array.base
    return not isinstance(array, np.ndarray)


@pytest.mark.parametrize("make", [of_a_mesh, of_a_cloud])
def test_a_field_is_bit_for_bit_the_same_in_a_file(
    make: Callable[[], DistanceField], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = make()
    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", 1000)
    there = make()
    assert here.sources is not None
    assert there.sources is not None
    assert is_in_a_file(there.values)
    assert is_in_a_file(there.sources)
    assert not is_in_a_file(here.values)
    assert not is_in_a_file(here.sources)
    assert there.values.tobytes() == here.values.tobytes()
    assert there.sources.tobytes() == here.sources.tobytes()
    points = np.random.default_rng(5).uniform(-8.0, 8.0, (500, 3))
    assert sample_distance(there, points).tobytes() == sample_distance(here, points).tobytes()


def test_a_file_has_no_name_and_goes_with_its_array(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", 1000)
    open_before = len(os.listdir("/proc/self/fd"))
    array = allocate_array((30, 20, 10), np.float32)
    assert array.shape == (30, 20, 10)
    assert array.dtype == np.float32
    assert array.flags.writeable
    assert array.flags.c_contiguous
    assert array.flags.aligned
    array.fill(2.5)
    assert os.listdir(folder) == []
    assert _mapped_in(folder)
    del array
    gc.collect()
    assert not _mapped_in(folder)
    assert len(os.listdir("/proc/self/fd")) == open_before


def _mapped_in(folder: Path) -> bool:
    return str(folder) in Path("/proc/self/maps").read_text(encoding="utf-8")


def test_a_full_disk_is_said_before_it_is_written_to(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", 1000)
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(InputError, match=r"no room for 0.004 GB") as caught:
        allocate_array((100, 100, 100), np.int32)
    assert "No space left on device" in caught.value.where
    assert str(folder) in caught.value.hint
    assert "TMPDIR" in caught.value.hint


def test_more_than_the_disk_holds_is_refused(folder: Path) -> None:
    with pytest.raises(InputError, match="no room for"):
        allocate_array((1 << 20, 1 << 20, 64), np.float32)
    assert os.listdir(folder) == []


def test_without_any_folder_the_advice_is_to_name_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found")

    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", 1000)
    monkeypatch.setattr(tempfile, "gettempdir", none)
    with pytest.raises(InputError, match="no folder for") as caught:
        allocate_array((100, 100), np.int32)
    assert "TMPDIR" in caught.value.hint
