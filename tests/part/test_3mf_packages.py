"""3MF files whose content is not where or what it seems: the right part, or refused in words."""

from __future__ import annotations

import pytest

from lmctl.errors import InputError
from lmctl.part.sources.threemf_model import VOLUMETRIC_NAMESPACE
from tests.part.angle_solid import VOLUME_MM3, model_xml, object_xml, package, read, volume_mm3

PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
WITH_PATHS = f'unit="millimeter" xmlns:p="{PRODUCTION}" requiredextensions="p"'
LATTICE = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
START = "3D/3dmodel.model"


def refused(data: bytes) -> str:
    with pytest.raises(InputError) as caught:
        read(data, "3mf")
    assert caught.value.hint
    return " ".join([caught.value.what, *caught.value.where])


def test_the_relationships_name_the_model() -> None:
    own = model_xml(object_xml("1"))
    other = model_xml(object_xml("1", scale=10.0), attributes='unit="centimeter"')
    for start, parts in {
        "/Models/part.model": {"3D/3dmodel.model": other, "Models/part.model": own},
        "Models/a%20b.model": {"3D/Other.model": other, "Models/a b.model": own},
        "/3D/3DMODEL.model": {"3D/3dmodel.model": own, "3D/z.model": other},
        "/3D/x.xml": {"3D/Other.model": other, "3D/x.xml": own},
    }.items():
        assert volume_mm3(read(package(parts, start), "3mf")) == pytest.approx(VOLUME_MM3)


def test_without_relationships_only_what_is_plain_is_read() -> None:
    own, other = model_xml(object_xml("1")), model_xml(object_xml("1", scale=2.0))
    assert volume_mm3(read(package({START: own, "3D/b.model": other}, None), "3mf")) == (
        pytest.approx(VOLUME_MM3))
    assert "several models" in refused(package({"a.model": own, "b.model": other}, None))
    assert "no part nowhere.model" in refused(package({START: own}, "/nowhere.model"))
    assert "no 3D model" in refused(package({"a.txt": own}, None))


def test_components_in_other_model_parts_are_read() -> None:
    there = model_xml(object_xml("1"), "")
    component = '<component p:path="/3D/Objects/a.model" objectid="1"/>'
    main = model_xml(f'<object id="2"><components>{component}</components></object>',
                     '<item objectid="2"/>', WITH_PATHS)
    data = package({"3D/Objects/a.model": there, START: main})
    assert volume_mm3(read(data, "3mf")) == pytest.approx(VOLUME_MM3)
    item = model_xml("", '<item objectid="1" p:path="/3D/Objects/a.model"/>', WITH_PATHS)
    data = package({"3D/Objects/a.model": there, START: item})
    assert volume_mm3(read(data, "3mf")) == pytest.approx(VOLUME_MM3)
    assert "3d/objects/a.model" in refused(package({START: main}))


def test_ids_belong_to_their_model_part() -> None:
    there = model_xml(object_xml("1"), "")
    component = '<component p:path="/3D/Objects/a.model" objectid="1"/>'
    main = model_xml(
        object_xml("1", scale=0.5)
        + f'<object id="2"><components>{component}</components></object>',
        '<item objectid="2"/>', WITH_PATHS)
    data = package({"3D/Objects/a.model": there, START: main})
    assert volume_mm3(read(data, "3mf")) == pytest.approx(VOLUME_MM3)


def test_model_parts_in_different_units_are_refused() -> None:
    there = model_xml(object_xml("1"), "", 'unit="inch"')
    item = model_xml("", '<item objectid="1" p:path="/a.model"/>', WITH_PATHS)
    assert "is in inch" in refused(package({"a.model": there, START: item}))


@pytest.mark.parametrize(
    ("declared", "required", "named"),
    [(f'xmlns:b="{LATTICE}"', "b", "beam lattice"),
     (f'xmlns:p="{PRODUCTION}" xmlns:b="{LATTICE}"', "p b", "beam lattice"),
     ('xmlns:q="http://example.org/other"', "q", "http://example.org/other"),
     ("", "zz", "'zz'")],
)
def test_required_extensions_are_refused_by_name(declared: str, required: str, named: str) -> None:
    stated = f'{declared} requiredextensions="{required}"'
    main = model_xml(object_xml("1"), attributes=stated)
    assert named in refused(package({START: main}))
    item = model_xml("", '<item objectid="1" p:path="/a.model"/>', WITH_PATHS)
    assert named in refused(package({"a.model": main, START: item}))
    harmless = model_xml(object_xml("1"), attributes=declared)
    assert volume_mm3(read(package({START: harmless}), "3mf")) == pytest.approx(VOLUME_MM3)


@pytest.mark.parametrize("kind", ["support", "solidsupport", "surface", "other"])
def test_objects_that_are_no_solids_are_left_out_and_said(kind: str) -> None:
    objects = object_xml("1", "model") + object_xml("2", kind, shift=40.0)
    both = '<item objectid="1"/><item objectid="2"/>'
    mesh = read(package({START: model_xml(objects, both)}), "3mf")
    assert volume_mm3(mesh) == pytest.approx(VOLUME_MM3)
    assert f"object 2 ({kind})" in mesh.notes[0]
    composed = objects + ('<object id="3"><components><component objectid="1"/>'
                          '<component objectid="2"/></components></object>')
    mesh = read(package({START: model_xml(composed, '<item objectid="3"/>')}), "3mf")
    assert volume_mm3(mesh) == pytest.approx(VOLUME_MM3)
    assert "holds no triangles" in refused(
        package({START: model_xml(objects, '<item objectid="2"/>')}))


def test_items_that_are_not_printed_are_left_out_and_said() -> None:
    items = ('<item objectid="1"/>'
             '<item objectid="1" printable="0" transform="1 0 0 0 1 0 0 0 1 9 9 9"/>')
    mesh = read(package({START: model_xml(object_xml("1"), items)}), "3mf")
    assert volume_mm3(mesh) == pytest.approx(VOLUME_MM3)
    assert "1 of its build items" in mesh.notes[0]


def test_elements_of_other_extensions_are_not_taken_for_the_mesh() -> None:
    sliced = object_xml("1").replace(
        "</vertices>", '</vertices><s:x xmlns:s="urn:s"><s:vertex x="1" y="2"/>'
        '<s:triangle v1="0"/></s:x>')
    assert volume_mm3(read(package({START: model_xml(sliced)}), "3mf")) == pytest.approx(VOLUME_MM3)


def test_mirrored_objects_still_face_out() -> None:
    mirror = '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    mesh = read(package({START: model_xml(object_xml("1"), mirror)}), "3mf")
    assert volume_mm3(mesh) == pytest.approx(VOLUME_MM3)


@pytest.mark.parametrize(
    ("objects", "items", "words"),
    [(object_xml("1") + object_xml("1"), '<item objectid="1"/>', "two objects"),
     (object_xml("1"), '<item objectid="1" transform="1 0 0"/>', "twelve numbers"),
     (object_xml("1"), "<item/>", "an element lacks its attribute objectid"),
     (object_xml("1"), '<item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 0 z"/>',
      "'z' is not a number"),
     (object_xml("1"), '<item objectid="9"/>', "object 9")],
)
def test_what_cannot_be_meant_is_refused(objects: str, items: str, words: str) -> None:
    assert words in refused(package({START: model_xml(objects, items)}))


def test_volumetric_data_beside_a_mesh_is_no_reason_to_refuse_it() -> None:
    stated = f'xmlns:v="{VOLUMETRIC_NAMESPACE}" requiredextensions="v"'
    main = model_xml(object_xml("1"), attributes=stated)
    assert volume_mm3(read(package({START: main}), "3mf")) == pytest.approx(VOLUME_MM3)
    shape = object_xml("1") + '<object id="2"><v:levelset functionid="1" meshid="1"/></object>'
    assert "level set" in refused(package({START: model_xml(shape, attributes=stated)}))
