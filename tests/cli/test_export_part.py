"""`lmctl export PART --to 3mf`: what another program reads of it, by lib3mf itself."""

from __future__ import annotations

import io
import sys

import lib3mf
import numpy as np
import pytest
from PIL import Image

from lmctl.part import load_part

PART = """
name = "wedge"
pitch_mm = 0.5
[[material]]
name = "316L"
[[material]]
name = "WC-12Co"
[[body]]
kind = "box"
low_mm = [-2, 1, 0]
high_mm = [4, 4, 2]
[composition]
feature = { kind = "plane", point_mm = [-2, 0, 0], normal = [1, 0.5, 0.25] }
profile = { kind = "linear", near = { "316L" = 1.0 }, far = { "WC-12Co" = 1.0 }, over_mm = [0, 8] }
"""


@pytest.fixture(autouse=True)
def part_file(tmp_path):
    (tmp_path / "wedge.toml").write_text(PART)
    return tmp_path / "wedge.toml"


def sampled(stack, uvw):
    """Trilinear samples of an image stack at (n, 3) places of its unit cube, as the text has it:
    columns go with u, the last row is at v = 0, edges are clamped."""
    sheets = np.stack([
        np.asarray(Image.open(io.BytesIO(bytes(stack.GetSheet(k).WriteToBuffer())))) / 65535.0
        for k in range(stack.GetSheetCount())])
    assert sheets.shape == (stack.GetSheetCount(), stack.GetRowCount(), stack.GetColumnCount())
    grid = sheets[:, ::-1].transpose(2, 1, 0)  # by u, v, w
    at = uvw * grid.shape - 0.5
    low = np.floor(at).astype(int)
    total = np.zeros(len(uvw))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, at - low, 1 - (at - low)), axis=1)
        index = np.clip(low + corner, 0, np.array(grid.shape) - 1)
        total += weight * grid[tuple(index.T)]
    return total


def test_the_mixture_is_that_of_the_part_wherever_it_is_asked(tmp_path, lmctl, part_file):
    assert lmctl("export", "wedge.toml", "--to", "3mf").data.strip() == "wedge.3mf"
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.ReadFromFile(str(tmp_path / "wedge.3mf"))
    meshes = model.GetMeshObjects()
    assert meshes.MoveNext()
    mesh = meshes.GetCurrentMeshObject()
    assert (mesh.GetName(), mesh.IsManifoldAndOriented()) == ("wedge", True)
    vertices = np.array([tuple(one.Coordinates) for one in mesh.GetVertices()])
    assert vertices.min(axis=0) == pytest.approx([-2, 1, 0], abs=1e-3)
    assert vertices.max(axis=0) == pytest.approx([4, 4, 2], abs=1e-3)
    volume = mesh.GetVolumeData()
    assert volume.GetPropertyCount() == 2
    points = np.random.default_rng(1).uniform([-1.7, 1.3, 0.3], [3.7, 3.7, 1.7], (200, 3))
    wanted = load_part(part_file).composition(points)
    for at, name in enumerate(("316L", "WC-12Co")):
        found = volume.GetProperty(at)
        assert (found.GetName(), found.GetChannelName()) == (f"volume fraction of {name}", "red")
        rows = np.array([list(row) for row in found.GetTransform().Fields])
        function = model.GetResourceByID(found.GetFunctionResourceID())
        stack = model.GetImageStackByID(function.GetImage3D().GetResourceID())
        values = sampled(stack, points @ rows[:3] + rows[3])
        assert np.abs(values - wanted[:, at]).max() < 1e-3


@pytest.mark.parametrize(("arguments", "told"), [
    (["wedge.toml", "--to", "plain"], "is no job file"),
    (["wedge.toml", "--to", "3mf", "-o", "no/a.3mf"], "there is no folder no"),
    (["other.toml", "--to", "3mf"], "other.toml"),
])
def test_what_cannot_be_exported_is_refused(refused, arguments, told):
    assert told in refused("export", *arguments, code=2, hint=False)


def test_without_lib3mf_it_says_what_to_install(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "lib3mf", None)
    assert "lmctl[3mf]" in refused("export", "wedge.toml", "--to", "3mf", code=2)
