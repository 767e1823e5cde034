"""What a part looks like while it is edited: a section and the surface, coloured by mixture.

Places are kept from one edit to the next, and so is their distance while no body changes: moving a
number of a composition evaluates the composition alone.
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from lmctl.array_types import FloatArray
from lmctl.part.bodies.body import Body
from lmctl.part.edited_part import EditedPart
from lmctl.report.composition_colours import composition_colours

#: Pixels along the longer side of a section; nodes of the lattice that the surface is found on.
SECTION_PIXELS = 220
SURFACE_NODES = 120_000

_MARGIN = 0.04
_OUTSIDE = (255, 255, 255)


@dataclass(frozen=True)
class SectionView:
    """A plane across an axis (0, 1 or 2) at a place [mm]."""

    axis: int
    at_mm: float


@dataclass(frozen=True, eq=False)
class SectionPicture:
    """png : top row at the greatest v; low_mm, high_mm : of (u, v); axes : their names"""

    png: bytes
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    axes: str


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """vertices_mm : (n, 3) float32; triangles : (m, 3) uint32"""

    vertices_mm: NDArray[np.float32]
    triangles: NDArray[np.uint32]


class PartPreview:
    """Pictures of one part that is being edited."""

    def __init__(self, part: EditedPart) -> None:
        self._part = part
        self._plane: tuple[Body, SectionView, _Plane] | None = None
        self._surface: tuple[Body, SurfaceMesh] | None = None

    def section(self, view: SectionView) -> SectionPicture:
        """The mixture in a plane; white outside the part, its outline dark."""
        plane = self._plane_of(view)
        pixels = np.empty((*plane.shape, 3), dtype=np.uint8)
        pixels[:] = _OUTSIDE
        inside = np.flatnonzero(plane.depth_mm > 0.0)
        if len(inside):
            colours = composition_colours(self._part.composition(plane.points[inside]))
            pixels.reshape(-1, 3)[inside] = _bytes(colours)
        pixels[_border((plane.depth_mm > 0.0).reshape(plane.shape))] = (32, 32, 32)
        file = io.BytesIO()
        Image.fromarray(pixels[::-1]).save(file, "png", compress_level=1)
        return SectionPicture(file.getvalue(), plane.low_mm, plane.high_mm, plane.axes)

    def surface(self) -> SurfaceMesh:
        """The surface, found anew after a body has changed; empty where there is no solid."""
        body = self._part.body
        if self._surface is None or self._surface[0] is not body:
            self._surface = body, _surface_of(body, self._part.box_mm)
        return self._surface[1]

    def surface_colours(self) -> NDArray[np.uint8]:
        """(n, 3) of the surface's vertices."""
        vertices = self.surface().vertices_mm
        if len(vertices) == 0:
            return np.zeros((0, 3), dtype=np.uint8)
        return _bytes(composition_colours(self._part.composition(vertices.astype(np.float64))))

    def _plane_of(self, view: SectionView) -> _Plane:
        body = self._part.body
        if self._plane is None or self._plane[0] is not body or self._plane[1] != view:
            self._plane = body, view, _Plane.of(body, view, self._part.box_mm)
        return self._plane[2]


@dataclass(frozen=True, eq=False)
class _Plane:
    """points (n, 3) [mm] of an image of `shape` (rows, columns), the first row at the least v."""

    points: FloatArray
    depth_mm: FloatArray
    shape: tuple[int, int]
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    axes: str

    @staticmethod
    def of(body: Body, view: SectionView, box_mm: tuple[FloatArray, FloatArray]) -> _Plane:
        u, v = [axis for axis in range(3) if axis != view.axis]
        low, high = box_mm
        size = float(max(high[u] - low[u], high[v] - low[v]))
        pitch = size * (1 + 2 * _MARGIN) / SECTION_PIXELS
        us = np.arange(low[u] - _MARGIN * size, high[u] + _MARGIN * size + pitch, pitch)
        vs = np.arange(low[v] - _MARGIN * size, high[v] + _MARGIN * size + pitch, pitch)
        points = np.empty((len(vs), len(us), 3))
        points[..., u], points[..., v], points[..., view.axis] = us, vs[:, None], view.at_mm
        flat = points.reshape(-1, 3)
        return _Plane(flat, body.distance_at(flat), (len(vs), len(us)),
                      (float(us[0]), float(vs[0])), (float(us[-1]), float(vs[-1])),
                      f"{'xyz'[u]}{'xyz'[v]}")


def _surface_of(body: Body, box_mm: tuple[FloatArray, FloatArray]) -> SurfaceMesh:
    from skimage.measure import marching_cubes  # takes a second, which only a first look spends

    low, high = box_mm
    pitch = float((high - low).prod() / SURFACE_NODES) ** (1 / 3)
    axes = [np.arange(a - 1.5 * pitch, b + 1.6 * pitch, pitch)
            for a, b in zip(low, high, strict=True)]
    shape = tuple(len(axis) for axis in axes)
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    depth = body.distance_at(points).reshape(shape)
    if not depth.min() < 0.0 < depth.max():
        return SurfaceMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32))
    corners, triangles, _, _ = marching_cubes(depth, 0.0)
    vertices = corners * pitch + np.array([axis[0] for axis in axes])
    return SurfaceMesh(vertices.astype(np.float32), triangles.astype(np.uint32))


def _border(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels outside that touch one inside."""
    near = np.zeros_like(inside)
    near[1:] |= inside[:-1]
    near[:-1] |= inside[1:]
    near[:, 1:] |= inside[:, :-1]
    near[:, :-1] |= inside[:, 1:]
    return near & ~inside


def _bytes(colours: FloatArray) -> NDArray[np.uint8]:
    return np.asarray(np.rint(colours * 255.0), dtype=np.uint8)
