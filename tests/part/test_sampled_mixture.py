"""Mixtures that another program has sampled into a 3MF file."""

from __future__ import annotations

import io
import sys

import lib3mf
import numpy as np
import pytest
from PIL import Image

from lmctl.errors import ConfigError, InputError, UsageError
from lmctl.part.load import load_part
from lmctl.report.volumetric_3mf import write_volumetric_3mf
from tests.part_files import block_file

GRADED = """
feature = { kind = "plane", point_mm = [0, 0, 0], normal = [1, 1, 2] }
profile = { kind = "linear", near = { "316L" = 1.0 }, far = { "WC-12Co" = 1.0 }, over_mm = [0, 12] }
"""
SAMPLED = block_file((12, 9, 4), 'sampled = { file = "mixture.3mf" }')


def written(folder, text):
    (folder / "part.toml").write_text(text)
    return folder / "part.toml"


def points_inside(n=500, margin=0.5):
    low, high = np.full(3, margin), np.array([12.0, 9.0, 4.0]) - margin
    return np.random.default_rng(1).uniform(low, high, (n, 3))


def write_boxes(path, fractions, *, unit=None, transform=None, to_unit=None, tile="Clamp",
                filtered="Linear", channel="red", names=("316L", "WC-12Co"), sheets=None,
                offsets=(0.0, 0.0), copies=1, cut=0):
    """A file of a 12 × 9 × 4 box with stacks of 8-bit images. fractions : (m, nx, ny, nz)"""
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    if unit is not None:
        model.SetUnit(unit)
    mesh = model.AddMeshObject()
    corners = [(x, y, z) for x in (0, 12) for y in (0, 9) for z in (0, 4)]
    for corner in corners:
        position = lib3mf.Position()
        position.Coordinates[:] = [float(one) for one in corner]
        mesh.AddVertex(position)
    for face in ((0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7),
                 (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)):
        triangle = lib3mf.Triangle()
        triangle.Indices[:] = list(face)
        mesh.AddTriangle(triangle)
    volume = model.AddVolumeData()
    for at, (name, values) in enumerate(zip(names, fractions, strict=True)):
        nx, ny, nz = values.shape
        stack = model.AddImageStack(nx, ny, nz)
        stack.SetColumnCount(nx)
        stack.SetRowCount(ny)
        for k in range(nz):
            file = io.BytesIO()
            pixels = np.rint(values[:, ::-1, k].T * 255).astype(np.uint8)
            Image.fromarray(pixels if sheets is None else sheets).save(file, "png")
            data = file.getvalue()[cut:]
            stack.CreateSheetFromBuffer(k, f"/3D/volumetric/m{at}/s{k}.png", data)
        function = model.AddFunctionFromImage3D(stack)
        style = getattr(lib3mf.TextureTileStyle, tile)
        function.SetTileStyles(style, style, style)
        function.SetOffset(offsets[at])
        function.SetFilter(getattr(lib3mf.TextureFilter, filtered))
        found = volume.AddPropertyFromFunction(f"volume fraction of {name}", function)
        found.SetChannelName(channel)
        placed = wrapper.GetIdentityTransform()
        for axis, size in enumerate((12.0, 9.0, 4.0)):
            placed.Fields[axis][axis] = 1.0 / size if to_unit is None else to_unit[axis]
        found.SetTransform(placed)
    mesh.SetVolumeData(volume)
    item = wrapper.GetIdentityTransform()
    if transform is not None:
        for axis in range(3):
            item.Fields[3][axis] = transform[axis]
    for _ in range(copies):
        model.AddBuildItem(mesh, item)
    path.write_bytes(bytes(bytearray(model.QueryWriter("3mf").WriteToBuffer())))


def halves(nx=4, ny=3, nz=2):
    """Material one in the lower half of x, material two in the upper."""
    first = np.zeros((nx, ny, nz))
    first[: nx // 2] = 1.0
    return np.stack([first, 1.0 - first])


def test_a_part_written_and_read_again_has_the_same_mixture(tmp_path):
    part = load_part(written(tmp_path, block_file((12, 9, 4), GRADED)))
    write_volumetric_3mf(part, tmp_path / "mixture.3mf")
    again = load_part(written(tmp_path, SAMPLED))
    points = points_inside()
    assert np.abs(again.composition(points) - part.composition(points)).max() < 1e-4
    assert "mixture.3mf" in again.sources


def test_a_mesh_body_and_its_mixture_come_from_one_file(tmp_path):
    part = load_part(written(tmp_path, block_file((12, 9, 4), GRADED)))
    write_volumetric_3mf(part, tmp_path / "mixture.3mf")
    mesh = SAMPLED.replace('kind = "box"\nlow_mm = [0, 0, 0]\nhigh_mm = [12, 9, 4]',
                           'kind = "mesh"\nfile = "mixture.3mf"\nunits = "mm"')
    again = load_part(written(tmp_path, mesh))
    points = points_inside()
    assert np.abs(again.composition(points) - part.composition(points)).max() < 1e-4


def test_a_solid_that_its_build_places_takes_its_mixture_along(tmp_path):
    write_boxes(tmp_path / "mixture.3mf", halves(), transform=(-6.0, 0.0, 0.0))
    moved = SAMPLED.replace("low_mm = [0, 0, 0]", "low_mm = [-6, 0, 0]").replace(
        "high_mm = [12, 9, 4]", "high_mm = [6, 9, 4]")
    part = load_part(written(tmp_path, moved))
    found = part.composition(np.array([[-5.0, 4.5, 2.0], [5.0, 4.5, 2.0]]))
    assert found == pytest.approx(np.array([[1.0, 0.0], [0.0, 1.0]]))


def test_inches_are_understood(tmp_path):
    write_boxes(tmp_path / "mixture.3mf", halves(), unit=lib3mf.ModelUnit.Inch,
                to_unit=[25.4 / 12, 25.4 / 9, 25.4 / 4])
    part = load_part(written(tmp_path, SAMPLED))
    assert part.composition(np.array([[1.0, 4.5, 2.0]])) == pytest.approx(np.array([[1.0, 0.0]]))


def test_between_voxels_it_is_linear_or_the_nearest(tmp_path):
    quarter = np.array([[5.25, 4.5, 2.0]])  # a quarter of the way between two centres, 4.5 and 7.5
    for filtered, expected in (("Linear", 0.75), ("Nearest", 1.0)):
        write_boxes(tmp_path / "mixture.3mf", halves(), filtered=filtered)
        part = load_part(written(tmp_path, SAMPLED))
        assert part.composition(quarter)[0, 0] == pytest.approx(expected)


@pytest.mark.parametrize(("tile", "expected"), [("Wrap", 1.0), ("Mirror", 0.0), ("Clamp", 0.0)])
def test_outside_the_stack_it_goes_on_as_the_file_says(tmp_path, tile, expected):
    """The stack fills half of the part's length: at x 6.75 it begins again, goes back, or stays."""
    write_boxes(tmp_path / "mixture.3mf", halves(), to_unit=[1 / 6, 1 / 9, 1 / 4], tile=tile)
    part = load_part(written(tmp_path, SAMPLED))
    assert part.composition(np.array([[6.75, 4.5, 2.0]]))[0, 0] == pytest.approx(expected)


def test_voxels_without_mixture_outside_the_part_take_the_nearest(tmp_path):
    values = np.zeros((2, 16, 3, 2))  # the part ends at x 9, its voxels at x 12
    values[0, :6], values[1, 6:12] = 1.0, 1.0
    write_boxes(tmp_path / "mixture.3mf", values)
    part = load_part(written(tmp_path, SAMPLED.replace("high_mm = [12,", "high_mm = [9,")))
    assert part.composition(np.array([[8.95, 4.5, 2.0], [11.5, 4.5, 2.0]]))[:, 1] == (
        pytest.approx(1.0))


def test_fractions_that_sum_to_less_are_refused_with_the_place(tmp_path):
    values = halves()
    values[:, 3, 1, 1] = 0.4, 0.3
    write_boxes(tmp_path / "mixture.3mf", values)
    with pytest.raises(InputError, match=r"sum to 0\.\d+ at X10\.5 Y4\.5 Z3\.0"):
        load_part(written(tmp_path, SAMPLED))


def test_a_property_that_is_not_there_is_named_with_those_that_are(tmp_path):
    write_boxes(tmp_path / "mixture.3mf", halves(), names=("steel", "WC-12Co"))
    with pytest.raises(InputError) as refused:
        load_part(written(tmp_path, SAMPLED))
    assert "'volume fraction of 316L'" in refused.value.what
    assert "volume fraction of steel" in refused.value.render()
    stated = SAMPLED.replace('"mixture.3mf" }', '"mixture.3mf", properties = '
                             '{ "316L" = "volume fraction of steel" } }')
    part = load_part(written(tmp_path, stated))
    assert part.composition(np.array([[1.0, 4.5, 2.0]]))[0, 0] == pytest.approx(1.0)


def test_a_mixture_elsewhere_than_its_body_is_refused(tmp_path):
    write_boxes(tmp_path / "mixture.3mf", halves(), transform=(100.0, 0.0, 0.0))
    with pytest.raises(InputError, match="no voxel in the body"):
        load_part(written(tmp_path, SAMPLED))


@pytest.mark.parametrize(("change", "words"), [
    (lambda path: write_boxes(path, halves(), sheets=np.zeros((7, 7), np.uint8)), "7 × 7 pixels"),
    (lambda path: write_boxes(path, halves(), channel="heat"), "its channel is 'heat'"),
    (lambda path: path.write_bytes(path.read_bytes()[:400]), "cannot be read as 3MF"),
    (lambda path: path.write_bytes(b"solid nothing"), "cannot be read as 3MF"),
    (lambda path: write_boxes(path, halves(), cut=9), "sheet 1 is no image"),
    (lambda path: write_boxes(path, [halves()[0], halves(8)[1]]), "sampled on different voxels"),
    (lambda path: write_boxes(path, halves(), offsets=(0.2, -0.2)),
     "a volume fraction in mixture.3mf is -0.200 at"),
    (lambda path: write_boxes(path, halves(), copies=2), "builds its solid 2 times"),
])
def test_damaged_files_are_refused_in_words(tmp_path, change, words):
    write_boxes(tmp_path / "mixture.3mf", halves())
    change(tmp_path / "mixture.3mf")
    with pytest.raises(InputError) as refused:
        load_part(written(tmp_path, SAMPLED))
    assert words in refused.value.render()


def test_a_mixture_that_a_function_computes_is_refused(tmp_path):
    write_boxes(tmp_path / "mixture.3mf", halves())
    model = lib3mf.get_wrapper().CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(tmp_path / "mixture.3mf"))
    meshes = model.GetMeshObjects()
    meshes.MoveNext()
    volume = meshes.GetCurrentMeshObject().GetVolumeData()
    function = model.AddImplicitFunction()
    half = function.AddConstantNode("half", "half", "")
    half.SetConstant(0.5)
    function.AddOutput("shape", "one half", lib3mf.ImplicitPortType.Scalar)
    function.AddLinkByNames("half.value", "outputs.shape")
    volume.RemoveProperty(0)
    volume.AddPropertyFromFunction("volume fraction of 316L", function)
    (tmp_path / "mixture.3mf").write_bytes(
        bytes(bytearray(model.QueryWriter("3mf").WriteToBuffer())))
    with pytest.raises(InputError, match="is computed by a function, not stored") as refused:
        load_part(written(tmp_path, SAMPLED))
    assert "stack of images" in refused.value.hint


def test_more_voxels_than_are_read_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("lmctl.part.sources.volumetric_3mf.MAX_VOXELS", 20)
    write_boxes(tmp_path / "mixture.3mf", halves())
    with pytest.raises(InputError, match="has 24 voxels") as refused:
        load_part(written(tmp_path, SAMPLED))
    assert "at most 20" in refused.value.where[0]


def test_without_lib3mf_it_is_said_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "lib3mf", None)
    (tmp_path / "mixture.3mf").write_bytes(b"PK")
    with pytest.raises(UsageError, match="needs the package lib3mf") as refused:
        load_part(written(tmp_path, SAMPLED))
    assert "lmctl[3mf]" in refused.value.hint


def test_a_file_without_volumetric_data_is_refused(tmp_path):
    model = lib3mf.get_wrapper().CreateModel()
    model.AddMeshObject().SetName("only a mesh")
    (tmp_path / "mixture.3mf").write_bytes(
        bytes(bytearray(model.QueryWriter("3mf").WriteToBuffer())))
    with pytest.raises(InputError, match="no solids with volumetric data"):
        load_part(written(tmp_path, SAMPLED))


def test_all_mistakes_of_the_keys_come_at_once(tmp_path):
    text = SAMPLED.replace('"mixture.3mf" }', '"mixture.3mf", properties = { "317L" = "a" } }\n'
                           'power = 2.0\nprofile = { kind = "constant", of = { "316L" = 1.0 } }')
    with pytest.raises(ConfigError) as refused:
        load_part(written(tmp_path, text))
    said = refused.value.render()
    assert "composition.power" in said
    assert "composition.profile" in said
    assert "no material '317L'" in said
