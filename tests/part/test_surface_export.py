"""Surfaces of the examples as files: closed for any reader, whatever bodies meet in an edge."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lmctl.examples.templates import write_template
from lmctl.part.load import load_part
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
    found = part_export._surface(part)  # once for three files
    monkeypatch.setattr(part_export, "_surface", lambda part: found)
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
