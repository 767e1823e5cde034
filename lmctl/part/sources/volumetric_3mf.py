"""Properties of a solid that a 3MF file holds as stacks of images.

Source: 3MF Volumetric Extension, chapters 3 and 4. Properties computed by a graph of
functions are refused by name: what they yield is not stored.
Needs the extra `3mf` (lib3mf).
"""

from __future__ import annotations

import io
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from lmctl.array_types import FloatArray
from lmctl.errors import InputError, UsageError
from lmctl.part.sources.files import DataFile


class Beyond(Enum):
    """How the voxels of an axis go on outside the stack."""

    WRAP = "wrap"
    MIRROR = "mirror"
    CLAMP = "clamp"
    NOTHING = "nothing"


#: Voxels of one property at most: 256 MB.
MAX_VOXELS = 64_000_000

#: Millimetres of one unit of length, by the number that lib3mf gives each.
_UNIT_MM = {0: 0.001, 1: 1.0, 2: 10.0, 3: 25.4, 4: 304.8, 5: 1000.0}

#: How voxels go on outside the stack, by the number that lib3mf gives each.
_BEYOND = {0: Beyond.WRAP, 1: Beyond.MIRROR, 2: Beyond.CLAMP, 3: Beyond.NOTHING}
_NEAREST = 2

_CHANNELS = ("red", "green", "blue", "alpha")


@dataclass(frozen=True, eq=False)
class VoxelProperty:
    """One property of a solid, on voxels.

    values : (nx, ny, nz) float32, at voxel centres
    to_unit : (4, 3) from millimetres (row vector and 1) to the unit cube that the voxels fill
    beyond : how each axis goes on outside the cube
    is_linear : interpolated between voxel centres, else the nearest voxel's value
    """

    values: NDArray[np.float32]
    to_unit: FloatArray
    beyond: tuple[Beyond, Beyond, Beyond]
    is_linear: bool


def read_voxel_properties(file: DataFile, names: Iterable[str]) -> dict[str, VoxelProperty]:
    """The properties of these names, of the one solid that has volumetric data.

    Raises InputError, with all names that are missing at once; UsageError without lib3mf.
    """
    lib3mf = _lib3mf()
    model = lib3mf.get_wrapper().CreateModel()
    try:
        reader = model.QueryReader("3mf")
        reader.ReadFromBuffer(file.data)
        solid = _solid_with_volume(model, file)
        volume = solid.GetVolumeData()
        by_name = {one.GetName(): one for one in (
            volume.GetProperty(index) for index in range(volume.GetPropertyCount()))}
        wanted = list(names)
        _refuse_missing(wanted, by_name, file)
        functions = {one.GetUniqueResourceID(): one for one in _items(model.GetFunctions(),
                                                                     "GetCurrentFunction")}
        images = {one.GetUniqueResourceID(): one for one in _items(model.GetImage3Ds(),
                                                                  "GetCurrentImage3D")}
        unit_mm, placed = _UNIT_MM[int(model.GetUnit())], _placement(model, solid, file)
        return {name: _property(by_name[name], functions, images, unit_mm, placed, file)
                for name in wanted}
    except lib3mf.ELib3MFException as error:
        raise InputError(f"{file.path} cannot be read as 3MF with volumetric data",
                         where=str(error), hint="export it again") from None


def _lib3mf() -> Any:
    try:
        import lib3mf
    except ImportError as error:
        raise UsageError("a composition in a 3MF file needs the package lib3mf", where=str(error),
                         hint="`pip install 'lmctl[3mf]'`") from None
    return lib3mf


def _items(iterator: Any, current: str) -> Iterable[Any]:
    while iterator.MoveNext():
        yield getattr(iterator, current)()


def _solid_with_volume(model: Any, file: DataFile) -> Any:
    found = [one for one in _items(model.GetMeshObjects(), "GetCurrentMeshObject")
             if one.GetVolumeData() is not None]
    if len(found) != 1:
        listed = ", ".join(one.GetName() or f"object {one.GetResourceID()}" for one in found)
        raise InputError(
            f"{file.path} has {len(found) or 'no'} solids with volumetric data, and one is needed",
            where=listed, hint="export one solid alone, with its volumetric data")
    return found[0]


def _refuse_missing(wanted: list[str], by_name: dict[str, Any], file: DataFile) -> None:
    missing = [name for name in wanted if name not in by_name]
    if missing:
        raise InputError(
            f"{file.path} has no property {', '.join(repr(name) for name in missing)}",
            where=f"its properties: {', '.join(by_name) or 'none'}",
            hint='say which is meant: properties = { "MATERIAL" = "NAME IN THE FILE" }')


def _placement(model: Any, solid: Any, file: DataFile) -> FloatArray:
    """(4, 3) from the solid's own coordinates to those of the build, as row vectors."""
    placed = [one for one in _items(model.GetBuildItems(), "GetCurrent")
              if one.GetObjectResource().GetUniqueResourceID() == solid.GetUniqueResourceID()]
    if len(placed) > 1:
        raise InputError(f"{file.path} builds its solid {len(placed)} times",
                         hint="export it once")
    if not placed:
        return np.eye(4, 3)
    return np.array([list(row) for row in placed[0].GetObjectTransform().Fields])


def _property(
    one: Any, functions: dict[int, Any], images: dict[int, Any], unit_mm: float,
    placed: FloatArray, file: DataFile,
) -> VoxelProperty:
    name, function = one.GetName(), functions.get(one.GetFunctionResourceID())
    if function is None or not hasattr(function, "GetImage3D"):
        raise InputError(f"{file.path}: property {name!r} is computed by a function, not stored",
                         hint="export it sampled, as a stack of images")
    stack = images[function.GetImage3D().GetUniqueResourceID()]
    values = _voxels(stack, one.GetChannelName(), f"{file.path}: property {name!r}")
    values = (values * function.GetScale() + function.GetOffset()).astype(np.float32)
    styles = function.GetTileStyles()
    beyond = tuple(_BEYOND[int(style)] for style in styles)
    to_unit = np.array([list(row) for row in one.GetTransform().Fields], dtype=np.float64)
    return VoxelProperty(
        values, _from_build_mm(to_unit, placed, unit_mm), (beyond[0], beyond[1], beyond[2]),
        is_linear=int(function.GetFilter()) != _NEAREST)


def _from_build_mm(to_unit: FloatArray, placed: FloatArray, unit_mm: float) -> FloatArray:
    """From millimetres of the build: back to the solid's own coordinates, then to the unit cube."""
    square = np.column_stack([placed, [0.0, 0.0, 0.0, 1.0]])
    own = np.linalg.inv(square) @ np.column_stack([to_unit, [0.0, 0.0, 0.0, 1.0]])
    own[:3] /= unit_mm
    return np.asarray(own[:, :3])


def _voxels(stack: Any, channel: str, what: str) -> FloatArray:
    """(nx, ny, nz) from 0 to 1. Rows of an image go against y: its last row has the least y."""
    columns, rows, sheets = stack.GetColumnCount(), stack.GetRowCount(), stack.GetSheetCount()
    if columns * rows * sheets > MAX_VOXELS:
        raise InputError(f"{what} has {columns * rows * sheets:,} voxels",
                         where=f"at most {MAX_VOXELS:,}", hint="export it coarser")
    values = np.empty((columns, rows, sheets), dtype=np.float32)
    for index in range(sheets):
        data = bytes(bytearray(stack.GetSheet(index).WriteToBuffer()))
        sheet = _sheet(data, channel, f"{what}, sheet {index + 1}")
        if sheet.shape != (rows, columns):
            raise InputError(
                f"{what}, sheet {index + 1} has {sheet.shape[1]} × {sheet.shape[0]} pixels",
                where=f"the stack states {columns} × {rows}", hint="export it again")
        values[:, :, index] = sheet[::-1].T
    return values


def _sheet(data: bytes, channel: str, what: str) -> FloatArray:
    """(rows, columns) of one channel, 0 to 1; grey values stand for all colours."""
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.load()
            pixels = np.asarray(image.convert("RGBA") if image.mode in ("P", "LA") else image)
    except (UnidentifiedImageError, OSError, ValueError, Image.DecompressionBombError):
        raise InputError(f"{what} is no image", hint="export it again") from None
    full = 1.0 if pixels.dtype == bool else 255.0 if pixels.dtype == np.uint8 else 65_535.0
    if channel not in _CHANNELS:
        raise InputError(f"{what}: its channel is {channel!r}",
                         where=f"channels are {', '.join(_CHANNELS)}", hint="export it again")
    if pixels.ndim == 2:
        return np.ones(pixels.shape) if channel == "alpha" else pixels / full
    at = _CHANNELS.index(channel)
    return np.ones(pixels.shape[:2]) if at >= pixels.shape[2] else pixels[..., at] / full
