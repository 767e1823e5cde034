"""A solid with concave faces in many forms: an angle section of 192 mm², 10 mm high, 1920 mm³."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from lmctl.part.sources.files import DataFile
from lmctl.part.sources.mesh_files import Mesh, read_mesh

VOLUME_MM3 = 1920.0
OUTLINE = ((20, 6), (8, 6), (8, 15), (0, 15), (0, 0), (20, 0))
CORNERS = np.array([(*xy, z) for z in (0, 10) for xy in OUTLINE], dtype=float)
#: Two concave lids and six walls, each facing out.
POLYGONS = (
    (5, 4, 3, 2, 1, 0), (6, 7, 8, 9, 10, 11),
    *((n, (n + 1) % 6, (n + 1) % 6 + 6, n + 6) for n in range(6)),
)
TRIANGLES = np.array([
    *((5, 4, 1), (5, 1, 0), (4, 3, 2), (4, 2, 1)),
    *((7, 10, 11), (6, 7, 11), (8, 9, 10), (7, 8, 10)),
    *(t for a, b, c, d in POLYGONS[2:] for t in ((a, b, c), (a, c, d))),
])

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
RELATIONSHIP = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


def data_file(data: bytes | str, suffix: str) -> DataFile:
    return DataFile(Path(f"part.{suffix}"), data.encode() if isinstance(data, str) else data, "")


def read(data: bytes | str, suffix: str, group: str | None = None) -> Mesh:
    return read_mesh(data_file(data, suffix), None if suffix == "3mf" else "mm", group)


def volume_mm3(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def binary_stl(
    triangles: np.ndarray = TRIANGLES, corners: np.ndarray = CORNERS, head: bytes = b"made"
) -> bytes:
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    facets = np.zeros(len(triangles), dtype=record)
    facets["corners"] = corners[triangles]
    return head.ljust(80, b"\0") + struct.pack("<I", len(triangles)) + facets.tobytes()


def text_stl(name: str = "part") -> str:
    facets = [
        "facet normal 0 0 0\n outer loop\n"
        + "".join(f"  vertex {x:e} {y:e} {z:e}\n" for x, y, z in CORNERS[row].tolist())
        + " endloop\nendfacet\n"
        for row in TRIANGLES
    ]
    return f"solid {name}\n{''.join(facets)}endsolid {name}\n"


def obj(separator: str = " ", end: str = "\n") -> str:
    lines = [separator.join(["v", *map(str, corner)]) for corner in CORNERS.tolist()]
    lines += [separator.join(["f", *(str(c + 1) for c in polygon)]) for polygon in POLYGONS]
    return end.join([*lines, ""])


def ply(order: str, polygons: Iterable[tuple[int, ...]] = POLYGONS, flags: bool = False) -> bytes:
    """order : "ascii", "binary_little_endian" or "binary_big_endian"; flags : a number behind
    each list."""
    faces = list(polygons)
    head = (
        f"ply\nformat {order} 1.0\ncomment x\nelement vertex {len(CORNERS)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list uchar int vertex_indices\n" + ("property short flag\n" if flags else "")
        + "end_header\n"
    ).encode()
    if order == "ascii":
        rows = [" ".join(map(str, corner)) for corner in CORNERS.tolist()]
        rows += [" ".join(map(str, (len(f), *f, *([7] if flags else [])))) for f in faces]
        return head + "\n".join([*rows, ""]).encode()
    mark = "<" if order == "binary_little_endian" else ">"
    body = CORNERS.astype(f"{mark}f4").tobytes()
    for face in faces:
        body += struct.pack(f"{mark}B{len(face)}i", len(face), *face)
        body += struct.pack(f"{mark}h", 7) if flags else b""
    return head + body


def off(polygons: Iterable[tuple[int, ...]] = POLYGONS) -> str:
    faces = list(polygons)
    rows = [" ".join(map(str, corner)) for corner in CORNERS.tolist()]
    rows += [" ".join(map(str, (len(f), *f))) for f in faces]
    return "\n".join(["OFF", f"{len(CORNERS)} {len(faces)} 0", *rows, ""])


def object_xml(number: str, type_: str = "", scale: float = 1.0, shift: float = 0.0) -> str:
    points = "".join(
        f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in (CORNERS * scale + shift).tolist())
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in TRIANGLES.tolist())
    stated = f' type="{type_}"' if type_ else ""
    return (f'<object id="{number}"{stated}><mesh><vertices>{points}</vertices><triangles>{faces}'
            "</triangles></mesh></object>")


def model_xml(
    objects: str, items: str = '<item objectid="1"/>', attributes: str = 'unit="millimeter"'
) -> str:
    return (f'<?xml version="1.0"?><model {attributes} xmlns="{CORE}"><resources>{objects}'
            f"</resources><build>{items}</build></model>")


def package(parts: Mapping[str, str], start: str | None = "/3D/3dmodel.model") -> bytes:
    """A 3MF file. start : what its relationships name, None for none at all"""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
        if start is not None:
            archive.writestr(
                "_rels/.rels",
                '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/'
                f'package/2006/relationships"><Relationship Target="{start}" Id="r0" '
                f'Type="{RELATIONSHIP}"/><Relationship Target="/t.png" Id="r1" Type="thumb"/>'
                "</Relationships>",
            )
    return content.getvalue()
