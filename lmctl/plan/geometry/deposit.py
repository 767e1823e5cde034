"""How much of a slice its tracks fill: their strips put down on the section's raster.

A track deposits, per length, its strip's width times the layer height. Compared with the slice
over squares of two beads, as beads are round and flow into each other but not into the next gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.section_raster import SectionRaster

#: Side of the squares over which deposit and slice are compared, in beads.
_TILE_BEADS = 2.0


@dataclass(frozen=True)
class Deposit:
    """(ny, nx) float32 each, of the cells around the nodes, in layer heights.

    inside_cell_fraction : of the cell that lies inside the outline, 0 to 1
    filled_fraction_by_cell : deposited inside the outline over the slice present in the tile around
    outside_cells : deposited outside the outline, in cells
    """

    inside_cell_fraction: NDArray[np.float32]
    filled_fraction_by_cell: NDArray[np.float32]
    outside_cells: float

    def filled_slice_fraction(self) -> float:
        """Part of the slice that is filled, none counted twice, 0 to 1."""
        return self._over_slice[0]

    def double_slice_fraction(self) -> float:
        """What is deposited inside beyond what fits, over the slice."""
        return self._over_slice[1]

    def outside_slice_fraction(self) -> float:
        """What is deposited outside, over the slice."""
        return self._over_slice[2]

    def filled_fraction_of_pieces(self, label: NDArray[np.int32], count: int) -> FloatArray:
        """`inside` of each of `count` pieces; label : (ny, nx), their numbers, −1 for none."""
        return np.asarray(_pieces_kernel(
            self.inside_cell_fraction, self.filled_fraction_by_cell, label, count))

    @cached_property
    def _over_slice(self) -> tuple[float, float, float]:
        """Deposited inside, beyond what fits, and outside, over the slice."""
        cells, filled, double = _slice_kernel(
            self.inside_cell_fraction, self.filled_fraction_by_cell)
        if cells == 0.0:
            return 0.0, 0.0, 0.0
        return filled / cells, double / cells, self.outside_cells / cells


def deposit_on(
    raster: SectionRaster, points_mm: FloatArray, starts: NDArray[np.intp],
    strip_width_mm: FloatArray, bead_mm: float,
) -> Deposit:
    """The deposit of tracks given as flat arrays, as `LayerGeometry` has them."""
    node = raster.grid.pitch_mm
    part = np.clip(raster.depth_mm / np.float32(node) + np.float32(0.5), 0, 1)
    filled = np.empty(raster.grid.shape, np.float32)
    outside = _deposit_kernel(
        (points_mm - np.array(raster.grid.origin_mm)) / node, np.asarray(starts, np.int64),
        strip_width_mm / node, raster.depth_mm, part, round(_TILE_BEADS * bead_mm / node) // 2,
        filled)
    return Deposit(part, filled, float(outside))


@kernel
def _slice_kernel(
    part: NDArray[np.float32], filled: NDArray[np.float32]
) -> tuple[float, float, float]:
    """Cells of the slice, those filled, and what is deposited in them beyond that, in cells."""
    cells, once, more = 0.0, 0.0, 0.0
    for j in range(part.shape[0]):
        for i in range(part.shape[1]):
            cells += part[j, i]
            once += min(filled[j, i], 1.0) * part[j, i]
            more += max(filled[j, i] - 1.0, 0.0) * part[j, i]
    return cells, once, more


@kernel
def _pieces_kernel(
    part: NDArray[np.float32], filled: NDArray[np.float32], label: NDArray[np.int32], count: int
) -> FloatArray:
    inside, room = np.zeros(count), np.zeros(count)
    for j in range(part.shape[0]):
        for i in range(part.shape[1]):
            piece = label[j, i]
            if piece >= 0:
                inside[piece] += min(filled[j, i], 1.0) * part[j, i]
                room[piece] += part[j, i]
    for piece in range(count):
        inside[piece] /= max(room[piece], 1e-9)
    return inside


@kernel
def _deposit_kernel(
    points: FloatArray, starts: NDArray[np.int64], strip: FloatArray, depth: NDArray[np.float32],
    part: NDArray[np.float32], half_tile: int, filled: NDArray[np.float32],
) -> float:
    """Strips in samples of a node along and two thirds of one across, each shared by the cells
    around it as far as these are inside; in node units. Then `filled`, in tiles of
    2 half_tile + 1 cells. Returns what lies outside the outline."""
    ny, nx = part.shape
    height = np.zeros((ny, nx), np.float32)
    outside = 0.0
    for track in range(len(starts) - 1):
        for k in range(starts[track], starts[track + 1] - 1):
            dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
            length = np.sqrt(dx * dx + dy * dy)
            if length <= 0.0:
                continue
            along = int(length) + 1
            for a in range(along):
                t = (a + 0.5) / along
                width = strip[k] + t * (strip[k + 1] - strip[k])
                across = int(1.5 * width) + 1
                amount = width * length / (along * across)
                x, y = points[k, 0] + t * dx, points[k, 1] + t * dy
                for c in range(across):
                    beside = ((c + 0.5) / across - 0.5) * width / length
                    u, v = x - beside * dy, y + beside * dx
                    i, j = int(np.floor(u)), int(np.floor(v))
                    if i < 0 or j < 0 or i + 1 >= nx or j + 1 >= ny:
                        outside += amount
                        continue
                    u, v = u - i, v - j
                    w00, w01 = (1 - u) * (1 - v), u * (1 - v)
                    w10, w11 = (1 - u) * v, u * v
                    if (part[j, i] == 1.0 and part[j, i + 1] == 1.0 and part[j + 1, i] == 1.0
                            and part[j + 1, i + 1] == 1.0):
                        height[j, i] += amount * w00
                        height[j, i + 1] += amount * w01
                        height[j + 1, i] += amount * w10
                        height[j + 1, i + 1] += amount * w11
                        continue
                    deep = (w00 * depth[j, i] + w01 * depth[j, i + 1]
                            + w10 * depth[j + 1, i] + w11 * depth[j + 1, i + 1])
                    w00, w01 = w00 * part[j, i], w01 * part[j, i + 1]
                    w10, w11 = w10 * part[j + 1, i], w11 * part[j + 1, i + 1]
                    total = w00 + w01 + w10 + w11
                    if deep < -0.05 or total <= 0.0:
                        outside += amount
                        continue
                    height[j, i] += amount * w00 / total
                    height[j, i + 1] += amount * w01 / total
                    height[j + 1, i] += amount * w10 / total
                    height[j + 1, i + 1] += amount * w11 / total
    room, volume = _tile_sums(part, half_tile), _tile_sums(height, half_tile)
    for j in range(ny):
        for i in range(nx):
            filled[j, i] = volume[j, i] / max(room[j, i], 1e-4) if part[j, i] > 0 else 0.0
    return outside


@inner_kernel
def _tile_sums(values: NDArray[np.float32], half: int) -> NDArray[np.float32]:
    """Sums over the square of 2 half + 1 nodes around each node, as far as there are nodes."""
    ny, nx = values.shape
    sums = np.empty((ny, nx), np.float32)
    columns = np.zeros(nx)
    for j in range(-half, ny):
        if j + half < ny:
            for i in range(nx):
                columns[i] += values[j + half, i]
        if j < 0:
            continue
        if j > half:
            for i in range(nx):
                columns[i] -= values[j - half - 1, i]
        total = 0.0
        for i in range(-half, nx):
            if i + half < nx:
                total += columns[i + half]
            if i < 0:
                continue
            if i > half:
                total -= columns[i - half - 1]
            sums[j, i] = total
    return sums
