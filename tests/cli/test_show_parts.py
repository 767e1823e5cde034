"""`lmctl show` for parts: pictures, fields for ParaView, coloured surfaces; and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from lmctl.part.load import load_part

BALL = (
    'name = "ball"\npitch_mm = 1.0\n[[material]]\nname = "316L"\n[[material]]\nname = "WC-12Co"\n'
    '[[body]]\nkind = "sphere"\ncentre_mm = [1, 2, 3]\nradius_mm = 8\n[composition]\n'
    'profile = { kind = "normalised", near = {"WC-12Co" = 1}, far = {"316L" = 1} }\n'
)


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    path = tmp_path / "ball.toml"
    path.write_text(BALL)
    return path


def test_a_picture_of_sections(lmctl: Callable[..., Any], ball: Path) -> None:
    outcome = lmctl("show", ball, "-z", 5)
    assert outcome.code == 0
    assert outcome.data.strip() == "ball-fields.png"
    assert Path("ball-fields.png").read_bytes().startswith(b"\x89PNG")
    assert lmctl("show", ball, "-o", "again.svg").code == 0


def test_the_field_for_paraview_is_the_part(lmctl: Callable[..., Any], ball: Path) -> None:
    assert lmctl("show", ball, "-o", "ball.vti").code == 0
    data = Path("ball.vti").read_bytes()
    head, _, rest = data.partition(b"<AppendedData encoding=\"raw\">\n_")
    names = re.findall(rb'Name="([^"]+)" format="appended" offset="(\d+)"', head)
    assert [name for name, _ in names] == [b"distance", b"316L", b"WC-12Co"]
    part = load_part(ball)
    assert f'0 {part.grid.shape[2] - 1} 0 {part.grid.shape[1] - 1}'.encode() in head
    arrays = []
    for _, offset in names:
        size = int(np.frombuffer(rest, "<u8", 1, int(offset))[0])
        assert size == 4 * part.grid.n_nodes
        arrays.append(np.frombuffer(rest, "<f4", size // 4, int(offset) + 8))
    np.testing.assert_array_equal(arrays[0], part.distance(part.grid.window()).ravel())
    assert np.abs(arrays[1] + arrays[2] - 1).max() < 1e-6
    assert arrays[1][arrays[0].argmax()] == pytest.approx(part.composition(
        part.grid.window().node_points()[arrays[0].argmax()][None])[0, 0])
    assert rest.rstrip().endswith(b"</VTKFile>")
    assert [path.name for path in Path().glob(".*partial")] == []


def test_a_coloured_surface(lmctl: Callable[..., Any], ball: Path) -> None:
    for name in ("ball.ply", "ball.stl", "ball.3mf"):
        assert lmctl("show", ball, "-o", name).code == 0
    mesh = trimesh.load("ball.ply", process=False)
    away = np.linalg.norm(mesh.vertices - [1, 2, 3], axis=1)
    assert np.abs(away - 8).max() < 1e-3
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 512, rel=0.02)
    assert np.ptp(mesh.visual.vertex_colors[:, :3], axis=0).max() <= 1  # one depth, one colour


def test_what_is_refused(refused: Callable[..., str], ball: Path) -> None:
    assert "as .gif" in refused("show", ball, "-o", "x.gif", code=2)
    assert "no folder" in refused("show", ball, "-o", "gone/x.png", code=2)
    assert "--layer is for jobs" in refused("show", ball, "-l", 3, code=2)
    assert "are for pictures" in refused("show", ball, "-z", 1, "-o", "x.vti", code=2)
