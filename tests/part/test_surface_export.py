"""Surfaces of the examples as files: closed for any reader, whatever bodies meet in an edge."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from lmctl.examples.templates import write_template
from lmctl.part.load import load_part, part_from_model
from lmctl.part.sources.files import DataFile
from lmctl.part.sources.mesh_files import read_mesh
from lmctl.report import part_export
from lmctl.report.part_export import write_surface

CASES = ("fig8-union", "fig7-hole", "fig3-surface", "cutter")


@pytest.mark.parametrize("name", CASES)
def test_surfaces_are_closed_once_a_reader_has_joined_equal_corners(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = load_part(write_template(name, tmp_path)[0])
    found = part_export.part_surface(part)  # once for three files
    monkeypatch.setattr(part_export, "part_surface", lambda part: found)
    volumes = []
    for kind in ("ply", "stl", "3mf"):
        target = tmp_path / f"surface.{kind}"
        write_surface(part, target)
        read = read_mesh(DataFile(target, target.read_bytes(), ""), None if kind == "3mf" else "mm")
        joined = trimesh.Trimesh(read.vertices, read.triangles, process=True)
        assert joined.is_watertight
        assert joined.is_winding_consistent
        assert (trimesh.triangles.area(joined.triangles) > 0.0).all()
        volumes.append(joined.volume)
    assert volumes[0] > 0.0
    assert np.ptp(volumes) < 1e-4 * volumes[0]


@pytest.mark.parametrize("turned", ["half", "all", "a shell"])
def test_meshes_whose_facets_face_the_wrong_way_are_exported_facing_out(
    turned: str, making: Any, tmp_path: Path
) -> None:
    vertices, triangles = making.join(
        [making.box((0, 0, 0), (20, 15, 10)), making.box((30, 0, 0), (40, 15, 10))])
    wrong = {"half": slice(0, None, 2), "all": slice(None), "a shell": slice(12, None)}[turned]
    triangles[wrong] = triangles[wrong, ::-1]
    (tmp_path / "a.stl").write_bytes(making.stl((vertices, triangles)))
    write_surface(part_from_model(tmp_path / "a.stl", "mm"), tmp_path / "b.stl")
    assert trimesh.load(tmp_path / "b.stl").volume == pytest.approx(3000 + 1500)
