"""Triangles as the bytes of a file that other programs read: STL, PLY, 3MF. Units are mm."""

from __future__ import annotations

import io
import zipfile
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

Kind = Literal["stl", "ply", "3mf"]

ZIP_TIMESTAMP = (1980, 1, 1, 0, 0, 0)  # equal surfaces are equal bytes
CORE_NAMESPACE_3MF = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PACKAGE_NAMESPACE_3MF = "http://schemas.openxmlformats.org/package/2006"


def surface_bytes(
    kind: Kind, vertices: FloatArray, triangles: NDArray[np.int64],
    colours: NDArray[np.uint8] | None = None,
) -> bytes:
    """A surface as a file.

    kind : binary STL, binary PLY, or 3MF (core specification 1.3)
    vertices : (n, 3) float64 [mm]; triangles : (m, 3) int64, wound outwards
    colours : (n, 3) uint8 red, green, blue of each vertex; only PLY can carry them
    raises : ValueError for colours in another kind than PLY
    """
    if colours is not None and kind != "ply":
        raise ValueError(f"{kind} carries no colours of vertices: use ply")
    if kind == "stl":
        return _stl(vertices, triangles)
    if kind == "ply":
        return _ply(vertices, triangles, colours)
    return _3mf(vertices, triangles)


def _stl(vertices: FloatArray, triangles: NDArray[np.int64]) -> bytes:
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    facets = np.zeros(
        len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")]
    )
    facets["normal"], facets["corners"] = normal, corners
    count = np.array(len(triangles), dtype="<u4").tobytes()
    return b"lmctl surface, mm".ljust(80) + count + facets.tobytes()


def _ply(
    vertices: FloatArray, triangles: NDArray[np.int64], colours: NDArray[np.uint8] | None
) -> bytes:
    names = ["x", "y", "z"]
    kinds = ["<f4"] * 3
    header = ["ply", "format binary_little_endian 1.0", "comment lmctl surface, mm"]
    header += [f"element vertex {len(vertices)}", *(f"property float {name}" for name in names)]
    if colours is not None:
        shades = ["red", "green", "blue"]
        header += [f"property uchar {name}" for name in shades]
        names, kinds = names + shades, kinds + ["u1"] * 3
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    points = np.empty(len(vertices), dtype=list(zip(names, kinds, strict=True)))
    for axis, name in enumerate("xyz"):
        points[name] = vertices[:, axis]
    if colours is not None:
        for shade, name in enumerate(("red", "green", "blue")):
            points[name] = colours[:, shade]
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("rows", "<i4", 3)])
    faces["count"], faces["rows"] = 3, triangles
    head = "\n".join([*header, "end_header", ""]).encode("ascii")
    return head + points.tobytes() + faces.tobytes()


def _3mf(vertices: FloatArray, triangles: NDArray[np.int64]) -> bytes:
    points = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in vertices)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in triangles)
    head = '<?xml version="1.0" encoding="UTF-8"?>\n'
    model = (
        f'{head}<model unit="millimeter" xml:lang="en-US" xmlns="{CORE_NAMESPACE_3MF}"><resources>'
        f'<object id="1" type="model"><mesh><vertices>{points}</vertices>'
        f"<triangles>{faces}</triangles></mesh></object></resources>"
        '<build><item objectid="1"/></build></model>\n'
    )
    types = (
        f'{head}<Types xmlns="{PACKAGE_NAMESPACE_3MF}/content-types"><Default Extension="rels" '
        'ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Default '
        'Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>'
        "</Types>\n"
    )
    relations = (
        f'{head}<Relationships xmlns="{PACKAGE_NAMESPACE_3MF}/relationships">'
        '<Relationship Id="rel0" '
        'Target="/3D/3dmodel.model" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>\n'
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (
            ("[Content_Types].xml", types), ("_rels/.rels", relations), ("3D/3dmodel.model", model)
        ):
            archive.writestr(zipfile.ZipInfo(name, ZIP_TIMESTAMP), text, zipfile.ZIP_DEFLATED)
    return content.getvalue()
