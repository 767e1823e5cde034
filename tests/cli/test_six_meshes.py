"""Meshes of very different kinds, from STL to a finished dry run or to a clear refusal."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

Lmctl = Callable[..., object]


def thin() -> trimesh.Trimesh:
    """A wall barely one bead thick."""
    return trimesh.creation.box(extents=(30, 2.2, 1.6))


def tall() -> trimesh.Trimesh:
    """A pillar of a hundred layers."""
    return trimesh.creation.cylinder(radius=2.1, height=80, sections=24)


def islands() -> trimesh.Trimesh:
    """Sixteen separate studs."""
    stud = trimesh.creation.cylinder(radius=2.5, height=0.8, sections=16)
    return trimesh.util.concatenate([
        stud.copy().apply_translation((9 * (i % 4), 9 * (i // 4), 0)) for i in range(16)
    ])


def holes() -> trimesh.Trimesh:
    """A ring: a hole through the middle."""
    return trimesh.creation.annulus(r_min=6, r_max=12, height=1.6, sections=48)


def fine() -> trimesh.Trimesh:
    """A dome of 200,000 triangles, its lower half cut off flat by the platform."""
    ball = trimesh.creation.uv_sphere(radius=5, count=(320, 320))
    flat = np.maximum(ball.vertices, [-np.inf, -np.inf, -1.0])
    return trimesh.Trimesh(flat, ball.faces, process=False)


def three_too_many() -> trimesh.Trimesh:
    """A block with three of its triangles doubled."""
    block = trimesh.creation.box(extents=(12, 10, 1.6))
    return trimesh.Trimesh(
        block.vertices, np.vstack([block.faces, block.faces[:3]]), process=False
    )


@pytest.mark.parametrize("make", [thin, tall, islands, holes, fine, three_too_many],
                         ids=lambda make: make.__name__)
def test_from_stl_to_a_finished_dry_run(
    lmctl: Lmctl, tmp_path: Path, make: Callable[[], trimesh.Trimesh]
) -> None:
    make().export(tmp_path / "part.stl")
    plan = lmctl("plan", "part.stl", "--units", "mm", "--json")
    assert plan.code == 0, plan.talk
    assert plan.json["path_length_mm"] > 0
    assert plan.json["filling"] > 0.9
    run = lmctl("run", "part.lmj", "--sim", "--json")
    assert run.code == 0, run.talk
    assert run.json["state"] == "done"
    assert run.json["lines"] == plan.json["lines"]


def test_defaults_of_a_bare_mesh_are_named(lmctl: Lmctl, tmp_path: Path) -> None:
    holes().export(tmp_path / "ring.stl")
    plan = lmctl("plan", "ring.stl")
    assert plan.code == 0
    said = plan.talk + plan.data
    for word in ("taken as mm", "316L", "overlap 0.333", "bench cell"):
        assert word in said, word


def test_a_mesh_without_anything_in_it_is_refused(
    refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "none.stl").write_text("solid none\nendsolid none\n")
    assert "none.stl" in refused("plan", "none.stl", code=1)


def test_a_mesh_in_metres_is_noticed(refused: Callable[..., str], tmp_path: Path) -> None:
    block = trimesh.creation.box(extents=(0.012, 0.01, 0.0016))
    block.export(tmp_path / "small.stl")
    said = refused("plan", "small.stl", code=1)
    assert "units" in said
