"""OFF and 3MF files: solids come back as they were, in mm; what is broken or hostile is refused."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from lmctl.errors import InputError
from lmctl.field.surface_files import surface_bytes
from lmctl.part.sources.files import MAX_DATA_BYTES, DataFile
from lmctl.part.sources.mesh_files import Mesh, read_mesh

BOX = trimesh.creation.box(extents=(30.0, 22.0, 16.0))
BALL = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"


def read(data: bytes, suffix: str, units: str | None = None) -> Mesh:
    return read_mesh(DataFile(Path(f"solid.{suffix}"), data, ""), units)


def refused(data: bytes, suffix: str, units: str | None = None) -> InputError:
    with pytest.raises(InputError) as caught:
        read(data, suffix, units)
    assert f"solid.{suffix}" in caught.value.what
    return caught.value


def volume(mesh: Mesh) -> float:
    return float(trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).volume)


def off(solid: trimesh.Trimesh) -> bytes:
    rows = [f"{x!r} {y!r} {z!r}" for x, y, z in solid.vertices.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in solid.faces.tolist()]
    return "\n".join(["OFF", f"{len(solid.vertices)} {len(solid.faces)} 0", *rows, ""]).encode()


def model(solid: trimesh.Trimesh = BOX, unit: str | None = "millimeter", head: str = "") -> str:
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in solid.vertices.tolist())
    faces = "".join(
        f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in solid.faces.tolist()
    )
    said = f' unit="{unit}"' if unit else ""
    return (
        f'<?xml version="1.0"?>{head}<model{said} xmlns="{CORE}"><resources><object id="1">'
        f"<mesh><vertices>{points}</vertices><triangles>{faces}</triangles></mesh></object>"
        '</resources><build><item objectid="1"/></build></model>'
    )


def zipped(text: str, name: str = "3D/3dmodel.model") -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, text)
    return content.getvalue()


@pytest.mark.parametrize("solid", [BOX, BALL])
def test_solids_come_back_as_they_were(solid: trimesh.Trimesh) -> None:
    as_off = read(off(solid), "off", "mm")
    as_3mf = read(surface_bytes("3mf", np.asarray(solid.vertices), np.asarray(solid.faces)), "3mf")
    np.testing.assert_allclose(as_off.vertices[as_off.triangles], solid.triangles, atol=1e-12)
    np.testing.assert_allclose(as_3mf.vertices[as_3mf.triangles], solid.triangles, atol=1e-7)
    assert volume(as_off) == pytest.approx(solid.volume)
    assert volume(as_3mf) == pytest.approx(solid.volume)


@pytest.mark.parametrize(
    ("unit", "mm"),
    [("micron", 0.001), ("millimeter", 1.0), ("centimeter", 10.0), ("inch", 25.4),
     ("foot", 304.8), ("meter", 1000.0), (None, 1.0)],
)
def test_a_3mf_states_its_units(unit: str | None, mm: float) -> None:
    small = BOX.copy()
    small.apply_scale(1.0 / mm)
    assert volume(read(zipped(model(small, unit)), "3mf")) == pytest.approx(30 * 22 * 16)


def test_units_that_contradict_a_3mf_are_refused() -> None:
    assert "inch" in str(refused(zipped(model(unit="inch")), "3mf", "mm"))
    assert "parsec" in str(refused(zipped(model(unit="parsec")), "3mf").where)


@pytest.mark.parametrize(("scale", "asked"), [(0.001, "m"), (1 / 25.4 / 20, "inch")])
def test_coordinates_in_other_units_are_asked_about(scale: float, asked: str) -> None:
    """A box of 30 mm written in metres, and one of 1.5 mm in inches."""
    small = BOX.copy()
    small.apply_scale(scale)
    error = refused(off(small), "off", "mm")
    assert "across when read in mm" in error.what
    assert asked in str(error.hint)
    assert refused(off(BOX), "off", None).hint is not None


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_zip_cut_short_is_refused(share: float) -> None:
    data = zipped(model(BALL))
    refused(data[: int(share * len(data))], "3mf")


def test_a_zip_with_a_flipped_bit_is_refused_or_the_same() -> None:
    data = zipped(model())
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(data), 60):
        harmed = bytearray(data)
        harmed[place] ^= 1 << int(rng.integers(8))
        try:
            mesh = read(bytes(harmed), "3mf")
        except InputError:
            continue
        assert volume(mesh) == pytest.approx(BOX.volume)


@pytest.mark.parametrize("said", [MAX_DATA_BYTES + 1, 0xFFFFFFF0, 100, 0])
def test_a_zip_is_not_unpacked_further_than_it_says_and_it_may_not_say_too_much(said: int) -> None:
    """20 MB of blanks in 20 kB, under a size that is too large or not true."""
    data = bytearray(zipped(model() + 20_000_000 * " "))
    assert len(data) < 50_000
    struct.pack_into("<I", data, data.index(b"PK\x01\x02") + 24, said)
    tracemalloc.start()
    try:
        error = refused(bytes(data), "3mf")
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()
    assert ("unpacks to" in str(error.where)) == (said > MAX_DATA_BYTES)


@pytest.mark.parametrize(
    "head",
    [
        '<!DOCTYPE m [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>',
        '<!DOCTYPE m SYSTEM "file:///etc/passwd">',
        '<!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    ],
)
def test_xml_that_defines_entities_is_refused(head: str) -> None:
    assert "entities" in str(refused(zipped(model(head=head)), "3mf").where)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:  # the same in an encoding that hides it
        archive.writestr("3D/3dmodel.model", model(head=head).encode("utf-16"))
    refused(content.getvalue(), "3mf")


@pytest.mark.parametrize(
    ("old", "new"),
    [('v1="0"', 'v1="99"'), ('v1="0"', 'v1="-1"'), ('v1="0"', 'v1="one"'), ('v1="0"', ""),
     ('v1="0"', 'v1="99999999999999999999999"'), ('x="15.0"', 'x="nan"'), ('x="15.0"', 'x="inf"'),
     ('x="15.0"', 'x="1e999"'), ('x="15.0"', ""), ('objectid="1"', 'objectid="7"'),
     ("</model>", ""), ("<vertices>", "<vertices")],
)
def test_a_broken_3mf_is_refused(old: str, new: str) -> None:
    text = model()
    assert old in text
    refused(zipped(text.replace(old, new)), "3mf")


def test_a_3mf_that_builds_itself_endlessly_is_refused() -> None:
    circle = model().replace(
        "</resources>", '<object id="2"><components><component objectid="2"/></components></object>'
        "</resources>").replace('<item objectid="1"/>', '<item objectid="2"/>')
    assert "circle" in str(refused(zipped(circle), "3mf").where)
    many = model().replace('<item objectid="1"/>', '<item objectid="1"/>' * 10_001)
    assert "places more than" in str(refused(zipped(many), "3mf").where)


@pytest.mark.parametrize(
    ("old", "new"),
    [(b"\n3 ", b"\n3 99 "), (b"OFF\n8", b"OFF\n9999999999"), (b"15.0", b"nan"), (b"15.0", b"inf"),
     (b"15.0", b"abc"), (b"3 1 3 0", b"3 1 3 88"), (b"3 1 3 0", b"3 1 3 -9"), (b"OFF", b"FFO")],
)
def test_a_broken_off_is_refused(old: bytes, new: bytes) -> None:
    data = off(BOX)
    assert old in data
    refused(data.replace(old, new, 1), "off", "mm")


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_an_off_cut_short_is_refused(share: float) -> None:
    data = off(BALL)
    refused(data[: int(share * len(data))], "off", "mm")
