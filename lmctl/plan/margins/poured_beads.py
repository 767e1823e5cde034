"""Pour the beads of a layer one after the other, and keep which piece of path went where.

A slice across a bead fills it up to a crown: a parabola across the bead's width whose area is the
slice's volume, raised to a level where less lies below than the crown needs. So a bead beside one
that is already there first fills the valley between them, and its middle moves to the open side.
In a column what comes later lies higher: beads that overlap are not mixed, unless they are melted
again. The layer below is taken to be flat.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.fill_level import fill_level
from lmctl.plan.sequence.bead_pieces import BeadPieces

#: A layer is parted into so many heights; what stands higher counts to the highest.
HEIGHTS = 3
#: A bead does not see its own volume: what it lies on is what was there before it came by, until
#: the nozzle has gone on by so many bead widths.
_PASS_WIDTHS = 0.5
#: A gap between pieces longer than so many of their lengths begins another bead.
_GAP_LENGTHS = 3.0
#: Most points across a bead.
_MOST_ACROSS = 64


@dataclass(frozen=True)
class PouredBeads:
    """Where the volumes of pieces of path went: n parts of them.

    voxel, piece : (n,) int64, of each part; share : (n,) float64, of its piece's volume
    n_voxels : their number
    """

    voxel: IntArray
    piece: IntArray
    share: FloatArray
    n_voxels: int

    def volume_mm3(self, volume_mm3: FloatArray) -> FloatArray:
        """Volume in each voxel, (n_voxels, m), of pieces that lay (q, m)."""
        return np.asarray(_summed(self.voxel, self.piece, self.share, self.n_voxels,
                                  np.ascontiguousarray(volume_mm3)))

    def of_voxels(self, voxels: IndexArray) -> PouredBeads:
        """Only what went to some voxels (k,), which are numbered anew in this order."""
        number = np.full(self.n_voxels, -1)
        number[voxels] = np.arange(len(voxels))
        found = number[self.voxel]
        kept = found >= 0
        return PouredBeads(found[kept], self.piece[kept], self.share[kept], len(voxels))


def poured_beads(
    pieces: BeadPieces, volume_mm3: FloatArray, strip_ratio: float, layer_height_mm: float,
    low_mm: FloatArray, cell_mm: float, shape: tuple[int, int],
) -> tuple[PouredBeads, BoolArray]:
    """Pour the pieces of a layer, in their order, on a grid of cells in the plane.

    volume_mm3 : (q,) of each piece; strip_ratio : of strip width over bead width
    low_mm, cell_mm, shape : corner of the grid, size of a cell, how many
    returns : the voxels of cell k are k · HEIGHTS and those after it, lowest first; (cells,) which
        cells lie in a strip
    """
    step = np.linalg.norm(np.diff(pieces.place_mm, axis=0), axis=1)
    advance = np.concatenate([[np.inf], np.where(
        step > _GAP_LENGTHS * np.maximum(pieces.length_mm[1:], pieces.length_mm[:-1]), np.inf,
        step)])
    voxel, piece, share, count, in_strip = _pour(
        pieces.place_mm - low_mm, pieces.direction, pieces.length_mm, pieces.width_mm, volume_mm3,
        advance, strip_ratio, layer_height_mm, cell_mm, shape[0], shape[1])
    return PouredBeads(voxel[:count], piece[:count], share[:count],
                       shape[0] * shape[1] * HEIGHTS), np.asarray(in_strip)


@kernel
def _summed(
    voxel: IntArray, piece: IntArray, share: FloatArray, n_voxels: int, volume: FloatArray
) -> FloatArray:
    total = np.zeros((n_voxels, volume.shape[1]))
    for i in range(len(voxel)):
        for m in range(volume.shape[1]):
            total[voxel[i], m] += share[i] * volume[piece[i], m]
    return total


@kernel
def _pour(
    place: FloatArray, direction: FloatArray, length: FloatArray, width: FloatArray,
    volume: FloatArray, advance: FloatArray, strip_ratio: float, height: float, cell: float,
    rows: int, columns: int,
) -> tuple[IntArray, IntArray, FloatArray, int, BoolArray]:
    points = 0
    for i in range(len(place)):
        points += _steps(length[i], cell) * _across(width[i], cell) * (HEIGHTS + 1)
    row = np.empty(points, np.int64)
    column = np.empty(points, np.int64)
    share = np.empty(points)
    in_strip = np.zeros(rows * columns, np.bool_)
    top = np.zeros(rows * columns)
    base = np.zeros(rows * columns)
    seen = np.full(rows * columns, -1e300)
    need, at = np.empty(_MOST_ACROSS), np.empty(_MOST_ACROSS, np.int64)
    area = cell * cell
    way, n = 0.0, 0
    for i in range(len(place)):
        way += min(advance[i], 1e6)
        steps, across = _steps(length[i], cell), _across(width[i], cell)
        patch = width[i] / across * length[i] / steps
        slice_mm3 = volume[i] / steps
        rise = slice_mm3 / (patch * across)
        for s in range(steps):
            along = ((s + 0.5) / steps - 0.5) * length[i]
            for j in range(across):
                u = 2.0 * (j + 0.5) / across - 1.0
                beside = 0.5 * u * width[i]
                a = int((place[i, 0] + along * direction[i, 0] - beside * direction[i, 1]) / cell)
                b = int((place[i, 1] + along * direction[i, 1] + beside * direction[i, 0]) / cell)
                k = a * columns + b
                at[j] = k
                if way - seen[k] > _PASS_WIDTHS * width[i]:
                    base[k] = top[k]
                seen[k] = way
                need[j] = base[k] - 1.5 * rise * (1.0 - u * u)
                if abs(u) <= strip_ratio:
                    in_strip[k] = True
            level = fill_level(need, across, slice_mm3 / patch)
            for j in range(across):
                gained = (level - need[j]) * patch
                if gained <= 0.0:
                    continue
                k = at[j]
                low, high = top[k], top[k] + gained / area
                top[k] = high
                for h in range(HEIGHTS):
                    begin = max(low, h * height / HEIGHTS)
                    end = high if h == HEIGHTS - 1 else min(high, (h + 1) * height / HEIGHTS)
                    if end > begin:
                        row[n], column[n] = k * HEIGHTS + h, i
                        share[n] = (end - begin) * area / volume[i]
                        n += 1
    return row, column, share, n, in_strip


@inner_kernel
def _steps(length: float, cell: float) -> int:
    return max(1, int(np.ceil(2.0 * length / cell)))


@inner_kernel
def _across(width: float, cell: float) -> int:
    return min(_MOST_ACROSS, max(4, int(np.ceil(2.0 * width / cell))))
