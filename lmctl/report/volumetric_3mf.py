"""A part as 3MF with its mixture in it: the Volumetric Extension, one property a material.

Each property samples a stack of images. The extension's own element for mixtures, `composite`, can
be neither written nor read by lib3mf 2.5. Source: 3MF Volumetric Extension, chapters 3 and 4.
Needs the extra `3mf` (lib3mf).
"""

from __future__ import annotations

import io
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lmctl.array_types import FloatArray
from lmctl.errors import UsageError
from lmctl.part.part import Part
from lmctl.report.part_export import part_surface

#: Voxels of one material at most; the pitch is raised where the part's own gives more.
MAX_VOXELS = 8_000_000

#: What the name of each property begins with; the material's name follows.
PROPERTY = "volume fraction of "

#: Greatest value of a pixel.
_FULL = 65_535


def write_volumetric_3mf(part: Part, target: Path) -> None:
    """Write the surface of a part and its volume fractions, on voxels of the part's pitch.

    Voxel centres hold the part file's own composition, also outside the part; in between it is
    interpolated linearly, and outside the box it stays as it is at the edge.
    Raises UsageError where lib3mf is not installed, OSError where the file cannot be written.
    """
    wrapper = _wrapper()
    model = wrapper.CreateModel()
    mesh = model.AddMeshObject()
    mesh.SetName(part.name)
    _set_geometry(mesh, part)
    low, shape, pitch = _voxels(part)
    volume = model.AddVolumeData()
    stacks = [model.AddImageStack(shape[0], shape[1], shape[2]) for _ in part.materials]
    for stack in stacks:  # AddImageStack of lib3mf 2.5 takes columns for rows
        stack.SetColumnCount(shape[0])
        stack.SetRowCount(shape[1])
    for k in range(shape[2]):
        for at, sheet in enumerate(_sheets(part, low, shape, pitch, k)):
            path = f"/3D/volumetric/material{at + 1}/sheet{k:05d}.png"
            stacks[at].CreateSheetFromBuffer(k, path, sheet)
    styles = _lib3mf()
    for material, stack in zip(part.materials, stacks, strict=True):
        function = model.AddFunctionFromImage3D(stack)
        function.SetDisplayName(f"{PROPERTY}{material.name}")
        clamp = styles.TextureTileStyle.Clamp
        function.SetTileStyles(clamp, clamp, clamp)
        function.SetFilter(styles.TextureFilter.Linear)
        found = volume.AddPropertyFromFunction(f"{PROPERTY}{material.name}", function)
        found.SetTransform(_transform(low, shape, pitch))
        found.SetChannelName("red")
    mesh.SetVolumeData(volume)
    model.AddBuildItem(mesh, wrapper.GetIdentityTransform())
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(_bytes(model.QueryWriter("3mf")))
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def _lib3mf() -> Any:
    try:
        import lib3mf
    except ImportError as error:
        raise UsageError("3MF with mixtures needs the package lib3mf", where=str(error),
                         hint="`pip install 'lmctl[3mf]'`; `lmctl show PART -o part.3mf` writes "
                              "the surface alone") from None
    return lib3mf


def _wrapper() -> Any:
    return _lib3mf().get_wrapper()


def _set_geometry(mesh: Any, part: Part) -> None:
    lib3mf = _lib3mf()
    vertices, triangles = part_surface(part)
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]  # welding leaves some without an area
    positions = (lib3mf.Position * len(vertices)).from_buffer_copy(
        np.ascontiguousarray(vertices, dtype="<f4"))
    corners = (lib3mf.Triangle * len(triangles)).from_buffer_copy(
        np.ascontiguousarray(triangles, dtype="<u4"))
    mesh.SetGeometry(positions, corners)


def _voxels(part: Part) -> tuple[FloatArray, tuple[int, int, int], float]:
    """Corner of the voxels' box [mm], their number in x, y and z, and their pitch [mm]."""
    low, high = part.bounds_mm
    size = high - low
    pitch = max(part.grid.pitch_mm, float(size.prod() / MAX_VOXELS) ** (1 / 3))
    counts = [max(1, math.ceil(float(one) / pitch)) for one in size]
    return low, (counts[0], counts[1], counts[2]), pitch


def _sheets(
    part: Part, low: FloatArray, shape: tuple[int, int, int], pitch: float, k: int
) -> list[bytes]:
    """One sheet of every material as a PNG of 16 bits.

    Columns go with x. The last row is the front, where v is 0, so rows go against y.
    """
    columns, rows, _ = shape
    x = low[0] + (np.arange(columns) + 0.5) * pitch
    y = low[1] + (np.arange(rows) + 0.5) * pitch
    points = np.empty((rows, columns, 3))
    points[..., 0], points[..., 1] = x[None, :], y[::-1, None]
    points[..., 2] = low[2] + (k + 0.5) * pitch
    fractions = part.composition(points.reshape(-1, 3))
    sheets = []
    for column in fractions.T:
        pixels = np.rint(np.clip(column, 0.0, 1.0) * _FULL).astype("<u2").reshape(rows, columns)
        file = io.BytesIO()
        Image.fromarray(pixels).save(file, "png")
        sheets.append(file.getvalue())
    return sheets


def _transform(low: FloatArray, shape: tuple[int, int, int], pitch: float) -> Any:
    """From millimetres of the part to the unit cube of the image stack."""
    transform = _wrapper().GetIdentityTransform()
    for axis in range(3):
        scale = 1.0 / (shape[axis] * pitch)
        transform.Fields[axis][axis] = scale
        transform.Fields[3][axis] = -float(low[axis]) * scale
    return transform


def _bytes(writer: Any) -> bytes:
    return bytes(bytearray(writer.WriteToBuffer()))
