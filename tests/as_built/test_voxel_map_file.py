"""The reader of voxel maps: what the simulators write is read, all else refused in words."""

import numpy as np
import pytest

from lmctl.as_built.voxel_map_file import read_voxel_map
from lmctl.errors import InputError, MissingFileError
from simulators.process.voxel_map import VoxelMap

GOOD = {
    "format": np.str_("voxel-map-1"), "origin_mm": np.zeros(3), "voxel_mm": np.full(3, 0.5),
    "powders": np.array(["A", "plate"]), "deposited_mm3": np.ones((2, 3, 4, 5), np.float32),
    "substrate_material": np.str_(""),
    "height_mm": np.ones((3, 4)), "substrate_z_mm": np.float64(0), "density_g_mm3": np.ones(2),
    "fed_g": np.ones(2), "beam_on_g": np.ones(2), "beam_off_g": np.ones(2),
    "place_mm": np.ones((6, 3)), "beam_on_mm": np.ones(6), "delivered": np.ones((6, 2)),
    "surface_mm": np.full(6, np.nan), "line": np.arange(6), "notes": np.array([], np.str_),
}


def refusal(tmp_path, **changes) -> str:
    arrays = {name: value for name, value in {**GOOD, **changes}.items() if value is not None}
    np.savez(tmp_path / "map.npz", **arrays)
    with pytest.raises(InputError) as caught:
        read_voxel_map(tmp_path / "map.npz")
    return caught.value.render()


def test_what_the_simulators_write_is_read(tmp_path):
    rng = np.random.default_rng(1)
    written = VoxelMap(
        np.array([1.0, 2.0, -2.0]), np.array([0.25, 0.25, 0.5]), ("A", "B", "plate"), "B",
        rng.uniform(0, 0.1, (3, 4, 5, 6)).astype(np.float32), rng.uniform(0, 9, (4, 5)), -1.0,
        np.array([0.008, 0.014, np.nan]), np.array([5.0, 6, 0]), np.array([4.0, 5, 0]),
        np.array([1.0, 1, 0]), rng.uniform([1, 2, 0], [2, 3.25, 9], (7, 3)), np.arange(7.0),
        np.ones(7), rng.uniform(0, 1, (7, 3)), np.full(7, np.nan), np.arange(7, dtype=np.int32),
        ("no powder came",))
    written.write(tmp_path / "map.npz")
    read = read_voxel_map(tmp_path / "map.npz")
    assert read.built_by == "simulated"
    assert (read.materials, read.plate_material) == (("A", "B", "plate"), "B")
    assert np.array_equal(read.deposited_mm3, written.deposited_mm3)
    assert read.path.place_mm == pytest.approx(written.place_mm, rel=1e-6)
    assert read.first_plane == 2
    assert read.notes == ("no powder came",)
    assert read.powder.fed_g.tolist() == [5, 6, 0]


def test_all_that_is_wrong_comes_at_once(tmp_path):
    told = refusal(tmp_path, fed_g=None, height_mm=np.ones((4, 4)), line=np.arange(5),
                   beam_on_mm=np.full(6, np.inf))
    assert "there is no array fed_g" in told
    assert "height_mm has the shape (4, 4)" in told
    assert "line has the shape (5,)" in told
    assert "beam_on_mm holds values that are no numbers" in told


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"format": np.str_("voxel-map-9")}, "its format is not voxel-map-1"),
        ({"format": None}, "its format is not voxel-map-1"),
        ({"powders": np.array([1.0, 2.0])}, "powders is not text"),
        ({"powders": np.array(["A", "A"])}, "powders are not different names"),
        ({"line": np.array(["1"] * 6)}, "line is not of numbers"),
        ({"voxel_mm": np.array([0.5, 0.0, 0.5])}, "voxel_mm is not above 0"),
        ({"place_mm": np.array([[1.4, 1.9, 9]] * 4 + [[1.6, 0, 0], [0, -0.1, 0]])},
         "place_mm: 2 of 6 pieces of the path lie beside the voxels"),
        ({"deposited_mm3": -np.ones((2, 3, 4, 5))}, "deposited_mm3 is below 0"),
        ({"deposited_mm3": np.full((2, 3, 4, 5), np.nan)}, "holds values that are no numbers"),
        ({"notes": np.array([{}], dtype=object)}, "Object arrays cannot be loaded"),
    ],
)
def test_what_is_no_voxel_map(tmp_path, changes, told):
    assert told in refusal(tmp_path, **changes)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"no archive at all"])
def test_what_is_no_archive(tmp_path, content):
    (tmp_path / "map.npz").write_bytes(content)
    with pytest.raises(InputError, match="not a voxel map, or is damaged"):
        read_voxel_map(tmp_path / "map.npz")


def test_an_array_larger_than_any_map(tmp_path, monkeypatch):
    monkeypatch.setattr("lmctl.as_built.voxel_map_file.MAX_ARRAY_BYTES", 100)
    told = refusal(tmp_path)
    assert "is not a voxel map" in told
    assert "an array is too large" in told


def test_a_map_cut_short(tmp_path):
    np.savez(tmp_path / "map.npz", **GOOD)
    whole = (tmp_path / "map.npz").read_bytes()
    (tmp_path / "map.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError):
        read_voxel_map(tmp_path / "map.npz")


def test_no_file(tmp_path):
    with pytest.raises(MissingFileError, match="there is no file"):
        read_voxel_map(tmp_path / "map.npz")
