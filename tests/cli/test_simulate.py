"""`lmctl simulate` as a user meets it: results in files, refusals in words."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

BLOCK = """name = "block"
[[material]]
name = "316L"
[[body]]
name = "block"
kind = "box"
low_mm = [0, 0, 0]
high_mm = [20, 10, 10]
[[face]]
name = "left"
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [1, 0, 0] }
[[face]]
name = "right"
feature = { kind = "plane", point_mm = [20, 0, 0], normal = [1, 0, 0] }
[simulation]
mesh_mm = 4
"""
PULLED = BLOCK + """
[[support]]
on = "left"
fix = ["x", "y", "z"]
[[load]]
on = "right"
force_N = [1000, 0, 0]
"""


def test_a_pulled_bar(lmctl: Callable[..., Any]) -> None:
    Path("bar.toml").write_text(PULLED)
    outcome = lmctl("simulate", "bar.toml", "--json")
    assert outcome.code == 0
    data = json.loads(outcome.data)
    assert data["volume_mm3"] == pytest.approx(2000)
    assert data["mass_g"] == pytest.approx(2000 * 7.99e-3)
    moved = data["extremes"]["displacement"]["largest"]
    assert moved["at_mm"][0] == pytest.approx(20)
    assert moved["value"] == pytest.approx(1000 / 100 / 193e3 * 20, rel=0.05)
    folder = Path("bar-simulation")
    assert {p.name for p in folder.iterdir()} == {
        "fields.vtu", "fields.vti", "fields.png", "extremes.json"}
    assert json.loads((folder / "extremes.json").read_text()) == data
    head = (folder / "fields.vtu").read_bytes()[:4000].decode("ascii", "replace")
    assert 'Name="stress von-mises [MPa]"' in head


def test_a_dry_run_says_what_it_will_take(lmctl: Callable[..., Any]) -> None:
    Path("bar.toml").write_text(PULLED)
    outcome = lmctl("simulate", "bar.toml", "--dry")
    assert "unknowns" in outcome.data
    assert "MB" in outcome.data
    assert not Path("bar-simulation").exists()


@pytest.mark.parametrize(("tables", "told"), [
    ('[[load]]\non = "right"\npressure_MPa = 1\n', "nothing holds the part"),
    ('[[support]]\non = "left"\nfix = ["x"]\n', "a turn about"),
    ('[[support]]\nrigid_motion = true\n[[load]]\non = "right"\npressure_MPa = 1\n',
     "the loads do not balance"),
    ('[[face]]\nname = "far"\nfeature = { kind = "point", at_mm = [90, 0, 0] }\n'
     '[[load]]\non = "far"\npressure_MPa = 1\n', "no place of the surface is on the face 'far'"),
    ('[[support]]\non = "left"\nfix = ["x", "y", "z"]\n[[heat]]\non = "right"\nflux_W_mm2 = 1\n',
     "heat enters and has nowhere to go"),
])
def test_what_cannot_be_simulated_is_said(
    refused: Callable[..., str], tables: str, told: str
) -> None:
    Path("bar.toml").write_text(BLOCK + tables)
    assert told in refused("simulate", "bar.toml", code=1)


BALL = 'kind = "sphere"\ncentre_mm = [0, 0, 0]\nradius_mm = 2'
BOX = 'kind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [20, 10, 10]'


@pytest.mark.parametrize(("old", "new", "told"), [
    ("mesh_mm = 4", 'model = "plane-stress"\nsection_mm = 40',
     "the plane z = 40 mm does not meet the part"),
    (BOX, BALL + "\n[[support]]\nrigid_motion = true", "the mesh misses the part"),
])
def test_a_model_that_misses_the_part_is_refused(
    refused: Callable[..., str], old: str, new: str, told: str
) -> None:
    text = PULLED.replace(old, new).replace("mesh_mm = 4", "mesh_mm = 40")
    Path("bar.toml").write_text(text.replace(', "z"', ""))
    assert told in refused("simulate", "bar.toml", code=1)


def test_a_body_in_two_pieces_is_refused(refused: Callable[..., str]) -> None:
    two = BLOCK.replace('[[face]]\nname = "left"', """[[body]]
name = "other"
kind = "box"
low_mm = [30, 0, 0]
high_mm = [40, 10, 10]
[[face]]
name = "left\"""").replace('name = "block"\n[[mat', 'name = "block"\ncombine = "union"\n[[mat')
    Path("two.toml").write_text(two)
    told = refused("simulate", "two.toml", code=1)
    assert "the body is in 2 pieces" in told
    assert "66.7% of it" in told


def test_constants_that_the_library_lacks_are_asked_for(refused: Callable[..., str]) -> None:
    Path("bar.toml").write_text(PULLED.replace('name = "316L"', 'name = "NiCrBSi"'))
    assert "material[1].poisson_ratio" in refused("simulate", "bar.toml", code=3)


def test_a_mesh_too_coarse_for_the_gradient_is_said_with_the_error(
    lmctl: Callable[..., Any]
) -> None:
    steep = PULLED.replace('[[material]]', '[[material]]\nname = "WC-12Co"\n[[material]]', 1)
    Path("bar.toml").write_text(steep + """
[composition]
feature = { kind = "coordinate", along = "x" }
profile = { kind = "linear", near = { "316L" = 1 }, far = { "WC-12Co" = 1 }, over_mm = [9, 11] }
""")
    outcome = lmctl("simulate", "bar.toml")
    assert outcome.code == 0
    assert "the mesh is coarse for the gradient" in outcome.talk
    assert "estimated error" in outcome.talk


def test_a_file_that_is_no_voxel_map_is_refused(refused: Callable[..., str]) -> None:
    Path("bar.toml").write_text(PULLED)
    assert "no file" in refused("simulate", "bar.toml", "--as-built", "run-9", code=2)
    Path("map.npz").write_bytes(b"PK nothing")
    assert "is no voxel map" in refused("simulate", "bar.toml", "--as-built", "map.npz", code=1)
