"""A mesh with many triangles, some of them twice or without area, from its file to a section.

The same with a million triangles takes 7 s of CPU to load, 0.1 s a section and 700 MB.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from lmctl.errors import InputError
from lmctl.field.plane import loop_area_mm2
from lmctl.field.surface_files import surface_bytes
from lmctl.part.load import load_part, part_from_model

RADIUS_MM = 15.0


@pytest.mark.parametrize("harm", ["none", "twice", "without area"])
def test_sections_of_a_fine_ball_are_discs(harm: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=RADIUS_MM)
    triangles = np.asarray(ball.faces)
    if harm == "twice":
        triangles = np.vstack([triangles, triangles[:300], triangles[5:80, [1, 2, 0]]])
    elif harm == "without area":
        triangles = np.vstack([triangles, triangles[:300][:, [0, 0, 1]]])
    (tmp_path / "ball.stl").write_bytes(
        surface_bytes("stl", np.asarray(ball.vertices), triangles)
    )
    (tmp_path / "part.toml").write_text(
        'name = "ball"\n[[material]]\nname = "316L"\n[[body]]\nkind = "mesh"\n'
        'file = "ball.stl"\nunits = "mm"\n', encoding="utf-8",
    )
    part = load_part(tmp_path / "part.toml")
    assert any("left out" in warning for warning in part.warnings) == (harm != "none")
    for z in (-9.3, 0.01, 12.2):
        loops = part.section(z).loops
        assert len(loops) == 1
        disc = np.pi * (RADIUS_MM**2 - z**2)
        assert loop_area_mm2(loops[0]) == pytest.approx(disc, rel=5e-3)
    assert part.body.distance_at(np.array([[0.0, 0.0, 0.0]]))[0] == pytest.approx(RADIUS_MM,
                                                                                  rel=2e-3)


def test_dust_is_refused_in_words(tmp_path: Path) -> None:
    """A million specks take 11 s of CPU to be refused; joined one by one they would take hours."""
    speck = trimesh.creation.box((0.1, 0.1, 0.1))
    step = np.stack(np.meshgrid(*[np.arange(22) * 0.5] * 3), axis=-1).reshape(-1, 1, 3)
    corners = (step + speck.vertices).reshape(-1, 3)
    triangles = (np.arange(len(step))[:, None, None] * 8 + speck.faces).reshape(-1, 3)
    (tmp_path / "dust.stl").write_bytes(surface_bytes("stl", corners, triangles))
    with pytest.raises(InputError, match="10,648 separate pieces") as caught:
        part_from_model(tmp_path / "dust.stl", units="mm")
    assert "10,648 of them are smaller than half a bead" in caught.value.render()
