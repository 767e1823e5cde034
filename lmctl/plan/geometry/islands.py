"""The connected pieces of a slice: exact outlines, which no raster is too coarse for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.field.plane import loop_area_mm2
from lmctl.plan.geometry.raster_pieces import connected_pieces
from lmctl.plan.geometry.section_raster import SectionRaster


@dataclass(frozen=True)
class Islands:
    """area_mm2 : (k,) float64, of each piece, its holes taken off
    outer : the outline of each, (n, 2) float64 [mm]
    label : (ny, nx) int32, number of the piece at each node of the raster, −1 outside
    """

    area_mm2: FloatArray
    outer: list[FloatArray]
    label: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.outer)

    def island_at(self, points_mm: FloatArray, raster: SectionRaster) -> NDArray[np.intp]:
        """The piece at points (n, 2) inside, by the nearest node; −1 where that lies outside."""
        index = np.round((points_mm - raster.grid.origin_mm) / raster.grid.pitch_mm)
        i = np.clip(index[:, 0].astype(np.intp), 0, raster.grid.shape[1] - 1)
        j = np.clip(index[:, 1].astype(np.intp), 0, raster.grid.shape[0] - 1)
        return self.label[j, i].astype(np.intp)


def islands_of(loops: Sequence[FloatArray], raster: SectionRaster) -> Islands:
    """The pieces of a section, from its closed loops (outer ones counter-clockwise)."""
    areas = np.array([loop_area_mm2(loop) for loop in loops])
    outer = [loop for loop, area in zip(loops, areas, strict=True) if area > 0]
    area_mm2 = areas[areas > 0]
    pieces_of = _Outlines(outer, areas[areas > 0])
    for loop, area in zip(loops, areas, strict=True):
        if area < 0:
            around = pieces_of.innermost_around(loop[0])
            if around >= 0:
                area_mm2[around] += area
    pieces, deepest = connected_pieces(raster.depth_mm)
    owner = np.full(len(deepest) + 1, -1, np.int32)  # the last is that of the nodes outside
    for number, (j, i) in enumerate(zip(*np.divmod(deepest, raster.grid.shape[1]), strict=True)):
        place = np.array([raster.grid.x_mm[i], raster.grid.y_mm[j]])
        owner[number] = pieces_of.innermost_around(place)
    return Islands(area_mm2, outer, owner[pieces])


@kernel
def deepest_nodes(
    depth_mm: NDArray[np.float32], label: NDArray[np.int32], count: int
) -> IntArray:
    """The deepest node of each piece, by its place in the flat raster; −1 where it holds none.

    label : (ny, nx) numbers of pieces below `count`, negative where there is none
    """
    ny, nx = depth_mm.shape
    found = np.full(count, -1, np.int64)
    deepest = np.full(count, -np.inf)
    for j in range(ny):
        for i in range(nx):
            piece = label[j, i]
            if piece >= 0 and depth_mm[j, i] > deepest[piece]:
                found[piece], deepest[piece] = j * nx + i, depth_mm[j, i]
    return found


class _Outlines:
    """Outer outlines with their boxes, for many questions."""

    def __init__(self, outer: list[FloatArray], area_mm2: FloatArray) -> None:
        self._outer = outer
        self._area_mm2 = area_mm2
        self._low = np.array([loop.min(axis=0) for loop in outer]).reshape(-1, 2)
        self._high = np.array([loop.max(axis=0) for loop in outer]).reshape(-1, 2)

    def innermost_around(self, point: FloatArray) -> int:
        """The outline of least area that winds around a point, −1 if there is none."""
        boxed = ((point >= self._low) & (point <= self._high)).all(axis=1)
        found = np.flatnonzero(boxed)
        for number in found[np.argsort(self._area_mm2[found], kind="stable")].tolist():
            if _is_around(self._outer[number], point):
                return int(number)
        return -1


def _is_around(loop: FloatArray, point: FloatArray) -> bool:
    """Whether a closed loop winds around a point, by parity; half-open in y."""
    a, b = loop[:-1], loop[1:]
    spans = (a[:, 1] > point[1]) != (b[:, 1] > point[1])
    a, b = a[spans], b[spans]
    x = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return bool(np.count_nonzero(x > point[0]) % 2)
