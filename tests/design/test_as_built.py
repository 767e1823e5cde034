"""What a run has built is simulated from its voxel map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lmctl.design.as_built import read_as_built
from lmctl.design.part_model import build_model
from lmctl.errors import InputError
from lmctl.part.load import load_measured_part
from tests.error_facts import assert_states

PART = """name = "bar"
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
name = "bar"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 10, 10]
[composition.profile]
kind = "constant"
of = { "316L" = 1 }
[[face]]
name = "left"
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [1, 0, 0] }
[[face]]
name = "right"
feature = { kind = "plane", point_mm = [20, 0, 0], normal = [1, 0, 0] }
[simulation]
mesh_mm = 5
[[support]]
on = "left"
fix = ["x", "y", "z"]
[[load]]
on = "right"
force_N = [1000, 0, 0]
"""


def write_map(path: Path, built: np.ndarray) -> None:
    np.savez(path, format=np.str_("voxel-map-1"), origin_mm=np.array([100.0, 100, -2]),
             voxel_mm=np.full(3, 2.0), powders=np.array(["WC-12Co", "316L", "substrate"]),
             deposited_mm3=built)


def test_a_bar_that_was_built_of_carbide_stretches_as_carbide(tmp_path: Path) -> None:
    (tmp_path / "bar.toml").write_text(PART)
    built = np.zeros((3, 20, 15, 8), dtype=np.float32)
    built[0, :, :, 1:] = 8.0
    built[2, :, :, 0] = 8.0
    write_map(tmp_path / "voxel-map.npz", built)
    measured = load_measured_part(tmp_path / "bar.toml")
    model = build_model(measured)
    as_built = read_as_built(tmp_path / "voxel-map.npz", ("316L", "WC-12Co")).moved((110, 110, 0))
    reach = [np.abs(model.solve(model.fractions_of(of)).displacement_mm[:, 0]).max()
             for of in (measured.part.composition, as_built)]
    assert reach[0] / reach[1] == pytest.approx(560 / 193, rel=0.03)
    assert as_built.void_share(model.discretisation.part_places_mm) == 0.0


def test_voxels_have_their_own_place_and_empty_ones_the_nearest_mixture(tmp_path: Path) -> None:
    built = np.zeros((3, 4, 3, 2), dtype=np.float32)
    built[0, 0], built[1, 0] = 2.0, 6.0
    built[1, 1] = 1.0
    write_map(tmp_path / "m.npz", built)
    of = read_as_built(tmp_path / "m.npz", ("316L", "WC-12Co")).moved((100.0, 100.0, -2.0))
    np.testing.assert_allclose(
        of(np.array([[1.0, 3, 1], [3.0, 3, 1], [7.9, 3, 1], [-5.0, 0, 0]])),
        [[0.75, 0.25], [1, 0], [1, 0], [0.75, 0.25]])
    assert of.void_share(np.array([[1.0, 3, 1], [3.0, 3, 1], [7.9, 3, 1]])) == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("materials", "filled", "changes", "facts"),
    [
        (("316L", "IN625"), 1.0, {}, ("nothing of IN625 was built", "WC-12Co", "of this part?")),
        (("316L",), 0.0, {}, ("has no deposit in it", "deposited something")),
        (("316L",), 1.0, {"format": np.str_("voxel-map-9")},
         ("of another kind", "voxel-map-9", "simulate the part again")),
        (("316L",), 1.0, {"powders": None}, ("is no voxel map", "powders", "[process]")),
    ],
)
def test_maps_that_nothing_can_be_simulated_of(
    materials: tuple[str, ...], filled: float, changes: dict, facts: tuple[str, ...],
    tmp_path: Path,
) -> None:
    write_map(tmp_path / "m.npz", np.full((3, 4, 3, 2), filled, dtype=np.float32))
    with np.load(tmp_path / "m.npz") as file:
        arrays = {name: value for name, value in ({**file} | changes).items() if value is not None}
    np.savez(tmp_path / "m.npz", **arrays)
    with pytest.raises(InputError) as refused:
        read_as_built(tmp_path / "m.npz", materials)
    assert_states(refused.value, *facts)
