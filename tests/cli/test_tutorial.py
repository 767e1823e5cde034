"""The tutorial's five commands, as they are printed, on meshes that are not ours."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh

from lmctl.part.up_axis import UP_AXES

TUTORIAL = Path(__file__).resolve().parents[2] / "docs/tutorial.md"


def star() -> trimesh.Trimesh:
    angles = np.linspace(0, 2 * np.pi, 11)[:-1]
    radii = np.where(np.arange(10) % 2, 6.0, 10.0)
    outline = shapely.Polygon(np.column_stack([radii * np.cos(angles), radii * np.sin(angles)]))
    return trimesh.creation.extrude_polygon(outline, 0.8, engine="manifold")


MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "ring": lambda: trimesh.creation.annulus(4.0, 8.0, 0.8),
    "knob": lambda: trimesh.creation.revolve(
        np.array([[0, 0], [7, 0], [7, 0.8], [5, 1.6], [0, 1.6]]), sections=48),
    "star": star,
}


def commands() -> list[list[str]]:
    (block,) = re.findall(r"```sh\n(.*?)```", TUTORIAL.read_text("utf-8"), re.S)
    return [shlex.split(line, comments=True)[1:] for line in block.splitlines()]


def test_they_are_five() -> None:
    assert len(commands()) == 5


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_comes_to_its_report(name: str, lmctl: Callable[..., Any], tmp_path: Path) -> None:
    MESHES[name]().export(tmp_path / "part.stl")
    for command in commands():
        outcome = lmctl(*command)
        assert outcome.code == 0, outcome.talk
    assert "<svg" in (tmp_path / "plan.html").read_text() or "<canvas" in (
        tmp_path / "plan.html").read_text()
    report = (tmp_path / "report.html").read_text()
    for word in ("your name", "316L", "ignature"):
        assert word in report


def test_a_mesh_that_leans_out_is_turned_or_planned_all_the_same_as_the_refusal_says(
    lmctl: Callable[..., Any], refused: Callable[..., str], tmp_path: Path
) -> None:
    cone = trimesh.creation.revolve(np.array([[0, 0], [3, 0], [9, 2.4], [0, 2.4]]), sections=48)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    cone.export(tmp_path / "part.stl")  # its axis is x: it stands on its rim, tip down or tip up
    told = refused("plan", "part.stl", "--units", "mm", "--up", "x", code=1)
    assert "lean out by more than 45°" in told
    assert "--up of a bare mesh" in told
    assert "--allow-overhang" in told
    sizes = set()
    for more in (["--up", "-x"], ["--up", "x", "--allow-overhang"]):
        planned = lmctl("plan", "part.stl", "--units", "mm", "--json", *more)
        assert planned.code == 0, planned.talk
        sizes.add(round(json.loads(planned.data)["slice_volume_mm3"]))
    assert len(sizes) == 1
    for up in UP_AXES:
        checked = lmctl("check", "part.stl", "--units", "mm", "--up", up)
        assert checked.code == 0, checked.talk
        upright = "18.0 × 18.0 × 2.4 mm" in checked.data
        assert upright == (up in ("x", "-x"))
    (tmp_path / "part.toml").write_text("name = 3\n")
    assert 'a body of kind "moved"' in refused("check", "part.toml", "--up", "y", code=2)
