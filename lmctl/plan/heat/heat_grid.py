"""The cells in which a part's temperature is computed: in the plane, and coarser ones below.

Near the top of the part and of the plate around it, cells are a bead wide. What lies deeper
than `FINE_SLABS` slabs below the top is kept in cells twice as wide and two slabs thick: heat that
reaches the top from there has spread farther than that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray

#: Most slabs, of the part or of the plate, that are kept in fine cells.
FINE_SLABS = 7
#: Fine slabs that make one coarse one.
SLABS_PER_COARSE = 2
#: A slab is about this part of a cell's width thick.
_SLAB_SHARE = 0.8
#: Fine columns that make one coarse one.
_COLUMNS_PER_COARSE = 2
#: Widths of columns of the plate beyond the part, in cells: fine ones, then coarse ones.
_FINE_MARGIN = (1.6, 2.6, 4.1, 6.6)
_COARSE_MARGIN = (12.0, 22.0)


@dataclass(frozen=True)
class HeatGrid:
    """Columns of fine and of coarse cells; widths have one column of width 1 beyond each end.

    cell_mm : width of a cell where the part is; layers_per_slab : layers in a fine slab
    origin_mm : (2,) x, y of the first edge of the part's own columns
    dx_mm, dy_mm : (nx + 2,), (ny + 2,) float64 widths of fine columns
    coarse_dx_mm, coarse_dy_mm : widths of coarse columns
    part_x, part_y : (first, one beyond the last) of the columns that may hold the part
    coarse_x, coarse_y : (nx + 2,), (ny + 2,) intp, coarse column of each fine one
    """

    cell_mm: float
    layers_per_slab: int
    origin_mm: FloatArray
    dx_mm: FloatArray
    dy_mm: FloatArray
    coarse_dx_mm: FloatArray
    coarse_dy_mm: FloatArray
    part_x: tuple[int, int]
    part_y: tuple[int, int]
    coarse_x: IndexArray
    coarse_y: IndexArray


def heat_grid(
    low_mm: FloatArray, high_mm: FloatArray, bead_mm: float, layer_height_mm: float,
) -> HeatGrid:
    """Cells for a part between two corners (2,), x and y, of its beads' centre lines.

    They are a bead wide in good conductors too: wider ones miss what the beam leaves on the track
    beside.
    """
    cell, middle = bead_mm, (low_mm + high_mm) / 2
    # a bead's heat is divided over the two nearest columns, so one more at each end
    counts = np.ceil((high_mm - low_mm + bead_mm) / cell).astype(int) + 2
    columns = [_columns(int(count), cell) for count in counts]
    margin = 1 + len(_FINE_MARGIN)
    return HeatGrid(
        cell_mm=cell,
        layers_per_slab=max(1, round(_SLAB_SHARE * cell / layer_height_mm)),
        origin_mm=middle - counts * cell / 2,
        dx_mm=columns[0][0], dy_mm=columns[1][0],
        coarse_dx_mm=columns[0][1], coarse_dy_mm=columns[1][1],
        part_x=(margin, margin + int(counts[0])), part_y=(margin, margin + int(counts[1])),
        coarse_x=columns[0][2], coarse_y=columns[1][2])


def _columns(count: int, cell_mm: float) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Widths of fine columns, of coarse ones, and the coarse one of each fine one."""
    beyond = np.array(_FINE_MARGIN) * cell_mm
    fine = np.concatenate([[1.0], beyond[::-1], np.full(count, cell_mm), beyond, [1.0]])
    group = np.concatenate([
        np.arange(len(beyond)) // 2, len(beyond) // 2 + np.arange(count) // _COLUMNS_PER_COARSE])
    after = group[-1] + 1 + np.arange(len(beyond)) // 2
    far = np.array(_COARSE_MARGIN) * cell_mm
    number = 1 + len(far) + np.concatenate([group, after])  # behind the halo and the far columns
    inner = np.bincount(number - 1 - len(far), weights=fine[1:-1])
    coarse = np.concatenate([[1.0], far[::-1], inner, far, [1.0]])
    return fine, coarse, np.concatenate([[0], number, [0]]).astype(np.intp)
