"""Triangles from 3MF files: a zip with an XML model, which states its units.

Only the core of the format is read (meshes, components, build items and their transforms). Sizes
are bounded before anything is unpacked, and XML that defines entities is refused.
"""

from __future__ import annotations

import io
import itertools
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from lmctl.config.quantities import MM_PER_UNIT
from lmctl.errors import InputError
from lmctl.part.sources.files import LARGEST_DATA_BYTES, DataFile

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Transform = FloatArray

#: Millimetres in each unit the format knows.
UNITS = {
    "micron": 0.001, "millimeter": 1.0, "centimeter": 10.0, "inch": 25.4, "foot": 304.8,
    "meter": 1000.0,
}

#: Meshes that a few lines of nested components may ask for.
MOST_PLACED = 10_000
DEEPEST = 16


@dataclass(frozen=True, eq=False)
class _Object:
    """vertices (n, 3), triangles (m, 3) of its own; parts: (object id, transform) of others."""

    vertices: FloatArray
    triangles: IntArray
    parts: tuple[tuple[str, Transform], ...]


def read_3mf(file: DataFile, units: str | None) -> tuple[FloatArray, IntArray]:
    """Corners (n, 3) float64 and triangles (m, 3) int64 of what the file builds, in mm.

    units : as the part file states them, None to take the file's own
    raises : InputError where it cannot be read, or states other units than the part file
    """
    root = _model(file)
    stated = root.get("unit", "millimeter")
    if stated not in UNITS:
        raise _damaged(file, f"unknown unit {stated!r}")
    if units is not None and MM_PER_UNIT[units] != UNITS[stated]:
        raise InputError(
            f"{file.path} states its units itself: {stated}",
            where=f"the part file says {units}", hint="leave `units` out for this file",
        )
    try:
        objects = {o.get("id", ""): _object(o) for o in _all(root, "object")}
        pieces = (
            piece for item in _all(root, "item")
            for piece in _placed(objects, item.get("objectid", ""), _transform(item), 0)
        )
        placed = list(itertools.islice(pieces, MOST_PLACED + 1))
    except (KeyError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise _damaged(file, " ".join(str(error).split())[:100] or "broken references") from None
    if len(placed) > MOST_PLACED:
        raise _damaged(file, f"it places more than {MOST_PLACED:,} meshes")
    starts = np.cumsum([0] + [len(v) for v, _ in placed])
    vertices = np.concatenate([v for v, _ in placed]) if placed else np.empty((0, 3))
    triangles = np.concatenate(
        [t + start for (_, t), start in zip(placed, starts[:-1], strict=True)]
    ) if placed else np.empty((0, 3), dtype=np.int64)
    return vertices * UNITS[stated], triangles


def _model(file: DataFile) -> ElementTree.Element:
    try:
        with zipfile.ZipFile(io.BytesIO(file.data)) as archive:
            models = [i for i in archive.infolist() if i.filename.lower().endswith(".model")]
            models = [i for i in models if i.filename.lower() == "3d/3dmodel.model"] or models[:1]
            if not models:
                raise _damaged(file, "it holds no 3D model")
            if models[0].file_size > LARGEST_DATA_BYTES:
                raise _damaged(file, f"its model unpacks to {models[0].file_size:,} bytes; at most "
                               f"{LARGEST_DATA_BYTES:,}")
            with archive.open(models[0]) as member:  # no further than it said, true or not
                text = member.read(models[0].file_size + 1)
    except (
        zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError
    ) as error:
        raise _damaged(file, str(error)[:100]) from None
    # In an encoding of wider characters the words below would not be found.
    if b"\0" in text:
        raise _damaged(file, "its model is not in UTF-8")
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise _damaged(file, "its model defines entities")
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise _damaged(file, str(error)[:100]) from None


def _object(element: ElementTree.Element) -> _Object:
    vertices = [[float(v.attrib[axis]) for axis in "xyz"] for v in _all(element, "vertex")]
    triangles = [[int(t.attrib[k]) for k in ("v1", "v2", "v3")] for t in _all(element, "triangle")]
    parts = tuple((c.attrib["objectid"], _transform(c)) for c in _all(element, "component"))
    corners = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    if len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
        raise ValueError("a triangle names a corner that is not there")
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise ValueError("coordinates that are not numbers")
    return _Object(points, corners, parts)


def _placed(
    objects: dict[str, _Object], number: str, by: Transform, depth: int
) -> Iterator[tuple[FloatArray, IntArray]]:
    if depth > DEEPEST:
        raise ValueError("objects of objects too deep, or in a circle")
    found = objects[number]
    if len(found.triangles):
        yield found.vertices @ by[:3] + by[3], found.triangles
    for part, own in found.parts:
        yield from _placed(objects, part, np.vstack([own[:3] @ by[:3], own[3] @ by[:3] + by[3]]),
                           depth + 1)


def _transform(element: ElementTree.Element) -> Transform:
    """(4, 3): rows of the turn, then the shift, as the format writes them."""
    text = element.get("transform")
    if text is None:
        return np.vstack([np.eye(3), np.zeros(3)])
    by = np.array([float(word) for word in text.split()], dtype=np.float64).reshape(4, 3)
    if not np.isfinite(by).all():
        raise ValueError("a transform that is not numbers")
    return by


def _all(element: ElementTree.Element, name: str) -> Iterator[ElementTree.Element]:
    """Descendants of a name, whatever their namespace."""
    return (e for e in element.iter() if str(e.tag).rpartition("}")[2] == name)


def _damaged(file: DataFile, why: str) -> InputError:
    return InputError(f"{file.path} is not a readable 3MF file", where=why,
                      hint="it is damaged or of another kind; export it again")
