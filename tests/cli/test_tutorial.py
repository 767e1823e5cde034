"""The tutorial's five commands, as they are printed, on meshes that are not ours."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh

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
