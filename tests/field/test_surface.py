"""Iso-surfaces: closed, wound outwards, on their level; and the files they are written to."""

from __future__ import annotations

import io
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from lmctl.errors import InputError
from lmctl.field.grid import Grid
from lmctl.field.primitives import box_distance, sphere_distance
from lmctl.field.surface import iso_surface
from lmctl.field.surface_files import surface_bytes
from tests.field.stored_field import stored_field

CENTRE = [0.13, 0.37, 0.71]


@pytest.fixture(scope="module")
def ball():
    grid = Grid.enclosing(np.full(3, -6.0), np.full(3, 7.0), 0.5, padding_nodes=4)
    return stored_field(lambda p: sphere_distance(p, CENTRE, 6.0), grid)


def as_mesh(surface) -> trimesh.Trimesh:
    return trimesh.Trimesh(*surface, process=False)


@pytest.mark.parametrize("level", [0.0, 0.7, 3.0, -1.0])
def test_a_ball_at_any_level_is_a_ball(ball, level):
    mesh = as_mesh(iso_surface(ball, level))
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    radius = np.linalg.norm(mesh.vertices - CENTRE, axis=1)
    assert np.abs(radius - (6.0 - level)).max() < (1e-4 if level == 0 else 0.02)
    # Positive: wound outwards. Chords make it a little less than the ball's.
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * (6.0 - level) ** 3, rel=0.02)


def test_faces_of_a_box_are_flat_and_its_hollow_is_wound_into_itself():
    def shell(p: np.ndarray) -> np.ndarray:
        outer = box_distance(p, [-5.2, -4.1, -3.3], [5.2, 4.1, 3.3])
        return np.minimum(outer, 1.5 - outer)

    grid = Grid.enclosing(np.full(3, -5.5), np.full(3, 5.5), 0.4)
    mesh = as_mesh(iso_surface(stored_field(shell, grid)))
    assert mesh.is_watertight
    solid = 10.4 * 8.2 * 6.6 - 7.4 * 5.2 * 3.6
    assert mesh.volume == pytest.approx(solid, rel=0.01)


@pytest.mark.parametrize("level", [6.5, -90.0, np.nan, np.inf])
def test_levels_that_are_nowhere_are_refused_with_those_that_are(ball, level):
    with pytest.raises(InputError, match="no surface at this level") as error:
        iso_surface(ball, level)
    assert "from" in error.value.hint


def test_a_level_that_leaves_the_grid_is_refused(ball):
    with pytest.raises(InputError, match="leaves the field's grid"):
        iso_surface(ball, -4.0)


@pytest.mark.parametrize("kind", ["stl", "ply"])
def test_files_are_read_back_by_another_program(ball, kind):
    vertices, triangles = iso_surface(ball)
    mesh = trimesh.load(io.BytesIO(surface_bytes(kind, vertices, triangles)), file_type=kind)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(as_mesh((vertices, triangles)).volume, rel=1e-5)


def test_ply_carries_the_colour_of_every_vertex(ball):
    vertices, triangles = iso_surface(ball)
    colours = np.random.default_rng(0).integers(0, 256, vertices.shape, dtype=np.uint8)
    written = surface_bytes("ply", vertices, triangles, colours)
    mesh = trimesh.load(io.BytesIO(written), file_type="ply", process=False)
    assert np.array_equal(mesh.visual.vertex_colors[:, :3], colours)
    with pytest.raises(ValueError, match="no colours"):
        surface_bytes("stl", vertices, triangles, colours)


def test_3mf_holds_every_triangle_in_millimetres(ball):
    vertices, triangles = iso_surface(ball)
    written = surface_bytes("3mf", vertices, triangles)
    assert written == surface_bytes("3mf", vertices, triangles)
    with zipfile.ZipFile(io.BytesIO(written)) as archive:
        assert {"[Content_Types].xml", "_rels/.rels"} < set(archive.namelist())
        model = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    assert model.get("unit") == "millimeter"
    points = np.array([[float(v.get(a)) for a in "xyz"] for v in model.iterfind(".//{*}vertex")])
    rows = np.array([[int(t.get(v)) for v in ("v1", "v2", "v3")]
                     for t in model.iterfind(".//{*}triangle")])
    assert np.array_equal(rows, triangles)
    assert points == pytest.approx(vertices, abs=1e-4)
