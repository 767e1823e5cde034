"""What a part takes is known before it is made: memory, disk and time."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lmctl.config.part_rules import parse_part_file
from lmctl.errors import InputError
from lmctl.field import array_storage
from lmctl.part.cost import CostItem, PartCost
from lmctl.part.load import load_part
from lmctl.part.part_data import PartData
from lmctl.part.resolution import checked_grid, max_stored_nodes
from lmctl.part.tree import BodyTree

Folder = Callable[..., Path]

STEEL = 'name = "p"\npitch_mm = 0.5\n[[material]]\nname = "316L"\n'
BALLS = "".join(
    f'[[body]]\nname = "{name}"\nkind = "sphere"\ncentre_mm = [{x}, 0, 0]\nradius_mm = 8\n'
    for name, x in (("a", 0), ("b", 9), ("c", 18))
)
NESTED = (
    BALLS + '[[body]]\nname = "ab"\nkind = "union"\nof = ["a", "b"]\n'
    '[[body]]\nname = "all"\nkind = "difference"\nof = ["ab", "c"]\n'
)
MILLION = 1_000_000


def mesh_of(million_nodes: float) -> CostItem:
    return CostItem("a mesh", int(million_nodes * MILLION), 150e-9, True)


def disk_with(free: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=free))


def counted(text: str) -> list[CostItem]:
    return list(BodyTree(parse_part_file(text, name="p"), PartData(Path(), 1.0)).cost().items)


def test_a_large_field_stays_on_the_disk_and_that_is_said() -> None:
    small, large = PartCost((mesh_of(60),)), PartCost((mesh_of(70),))
    assert small.disk_bytes == 0
    assert small.memory_bytes == 60e6 * 20
    assert " of disk" not in small.summary()
    assert large.disk_bytes == 70e6 * 8
    assert large.memory_bytes == 70e6 * 12
    folder = array_storage.mapped_storage_space()[0]
    assert f"840 MB of memory, 560 MB of disk in {folder}" in large.summary()


def test_several_large_fields_need_memory_for_one_at_a_time() -> None:
    cost = PartCost((mesh_of(150), mesh_of(100), mesh_of(10)))
    assert cost.memory_bytes == 150e6 * 12 + 10e6 * 8
    assert cost.disk_bytes == 250e6 * 8
    cost.refuse_if_too_large()


def test_more_memory_than_is_allowed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LMCTL_MEMORY_MB", "500")
    with pytest.raises(InputError, match=r"would take about 1\.2 GB of memory") as caught:
        PartCost((mesh_of(60),)).refuse_if_too_large()
    assert caught.value.where == ("allowed are 500 MB", "a mesh: 6e+07 grid nodes")
    assert "make pitch_mm 1.3 times as large" in caught.value.hint


def test_more_disk_than_is_free_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    disk_with(1e9, monkeypatch)
    PartCost((mesh_of(120),)).refuse_if_too_large()
    with pytest.raises(InputError, match=r"no room for 1\.04 GB") as caught:
        PartCost((mesh_of(130),)).refuse_if_too_large()
    assert caught.value.where == ("free there: 1 GB",)
    assert "TMPDIR" in caught.value.hint


def test_a_part_is_refused_before_anything_of_it_is_made(
    folder: Folder, making: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = STEEL + '[[body]]\nkind = "cloud"\nfile = "m.xyz"\nunits = "mm"\npitch_mm = 1.0\n'
    points = "\n".join("{} {} {}".format(*p) for p in making.ball(10.0, 24, 48)[0].tolist())
    path = folder(part__toml=text, m__xyz=points)
    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", 1000)
    load_part(path / "part.toml")
    disk_with(1e5, monkeypatch)
    with pytest.raises(InputError, match="no room for"):
        load_part(path / "part.toml")


@pytest.mark.parametrize("megabytes", [100, 700, 1200, 1300, 2000, 20000])
def test_the_largest_field_allowed_is_within_the_limit(
    megabytes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LMCTL_MEMORY_MB", str(megabytes))
    disk_with(1e15, monkeypatch)
    PartCost((mesh_of(max_stored_nodes() / MILLION),)).refuse_if_too_large()


def test_the_disk_lets_a_field_be_larger_than_memory_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    box = np.zeros(3), np.full(3, 500.0)
    assert checked_grid(*box, 1.0, stored=True).n_nodes > 2000e6 / 20
    monkeypatch.setattr(array_storage, "MAX_BYTES_IN_MEMORY", float("inf"))
    with pytest.raises(InputError, match=r"needs 1\.3e\+08 grid nodes, 2\.6. GB"):
        checked_grid(*box, 1.0, stored=True)


def test_a_boolean_of_booleans_has_one_boundary() -> None:
    whole, = counted(STEEL + NESTED)
    assert "all" in whole.description
    assert whole.seconds_per_node == pytest.approx(3 * 80e-9)


def test_a_boolean_that_is_moved_is_counted_where_it_is_asked() -> None:
    moved = '[[body]]\nkind = "moved"\nof = "all"\nby_mm = [1, 0, 0]\n'
    assert counted(STEEL + NESTED + moved) == counted(STEEL + NESTED)


def test_a_boolean_under_a_shell_is_counted() -> None:
    pair = '[[body]]\nname = "ab"\nkind = "union"\nof = ["a", "b"]\n'
    skin = '[[body]]\nname = "skin"\nkind = "shell"\nof = "ab"\nfrom_mm = 1\n'
    both = '[[body]]\nkind = "union"\nof = ["skin", "c"]\n'
    assert len(counted(STEEL + BALLS + pair + skin + both)) == 2


def test_bodies_of_several_materials_are_all_asked() -> None:
    made = (
        '[body.composition]\nprofile = { kind = "linear", near = {"316L" = 1}, '
        'far = {"WC-12Co" = 1}, over_mm = [0, 5] }\n'
    )
    text = STEEL + '[[material]]\nname = "WC-12Co"\n' + NESTED.replace(
        "radius_mm = 8\n", "radius_mm = 8\n" + made)
    assert len(counted(text)) == 2
