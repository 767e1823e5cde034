"""Find the nearest neighbours of every point of a cloud, and of every node, cell by cell.

Scans are surfaces: with cells that each hold a dozen points, the neighbours of a point
are in the few occupied cells around its own, and all points of a cell search the same cells. That
is a third of the work of a search tree. Where a cloud is too uneven for this, a tree finds the
neighbours of the remaining points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.array_storage import allocate_array
from lmctl.field.grid import Grid
from lmctl.field.kernel import inner_kernel, kernel

# of the neighbours wanted, in a cell: a disc as wide as the cells around it
CELL_NEIGHBOUR_FRACTION = 0.54
# then holds half as many again as are wanted
# times as many in a cell and around it: where there are more, a tree is as quick
CROWDED_CELL_FACTOR = 28
MAX_CELLS_PER_POINT = 16  # for each point, in a table of all cells there are


@dataclass(frozen=True)
class PointCells:
    """Points sorted into cubes.

    points : (n, 3) float64, as they were given
    order : (n,) int64, their rows, cell by cell; cell : (n,) int64, the cells' numbers, rising
    start : where in `order` each cell begins, and the end; all 0 where cells would be too many
    size : (3,) int64, cells along x, y, z, an empty one on each side; side : of a cell
    each : how many points a cell was to hold
    """

    points: FloatArray
    order: IntArray
    cell: IntArray
    start: IntArray
    size: IntArray
    side_length: float
    each: float


def sort_into_cells(points: FloatArray, wanted: int) -> PointCells:
    """Sort points (n, 3) float64 into cells just large enough to find so many neighbours in."""
    each = CELL_NEIGHBOUR_FRACTION * wanted
    low = points.min(axis=0)
    x, y, z = np.ptp(points, axis=0)
    side_length = float(np.sqrt(2.0 * (x * y + y * z + z * x) * each / len(points)))
    place, size = _places(points, low, side_length)
    occupied = len(np.unique(_numbers(place, size)))
    side_length *= float(np.sqrt(each * occupied / len(points)))
    place, size = _places(points, low, side_length)
    many = float(np.prod(size.astype(np.float64)))
    if many > MAX_CELLS_PER_POINT * len(points) + 1e6:
        nothing = np.zeros(0, dtype=np.int64)
        return PointCells(points, nothing, nothing, nothing, size, side_length, each)
    cell = _numbers(place, size)
    order = np.argsort(cell, kind="stable")
    start = np.zeros(int(many) + 1, dtype=np.int64)
    np.cumsum(np.bincount(cell, minlength=int(many)), out=start[1:])
    return PointCells(points, order, cell[order], start, size, side_length, each)


def nearest_neighbours(
    cells: PointCells, count: int, of: IntArray | None = None
) -> tuple[FloatArray, NDArray[np.int32]]:
    """The nearest other points of each point, nearest first; deterministic.

    cells : of distinct points, more than `count` of them; of : rows of the queried points, all
    returns : distances (m, count) float64; rows (m, count) int32
    """
    points = cells.points
    of = np.arange(len(points)) if of is None else of
    distance, rows = np.empty((len(of), count)), np.empty((len(of), count), dtype=np.int32)
    answer = np.full(len(points), -1, dtype=np.int64)
    answer[of] = np.arange(len(of))
    unknown = np.ones(len(of), dtype=np.bool_)
    _search_kernel(
        points[cells.order], cells.order, cells.cell, cells.start, cells.size, cells.side_length,
        int(CROWDED_CELL_FACTOR * cells.each), answer, distance, rows, unknown,
    )
    if unknown.any():
        left = np.flatnonzero(unknown)
        found, other = cKDTree(points).query(points[of[left]], k=count + 1)
        distance[left], rows[left] = found[:, 1:], other[:, 1:]
    return distance, rows


def _places(points: FloatArray, low: FloatArray, side_length: float) -> tuple[IntArray, IntArray]:
    place = ((points - low) / side_length).astype(np.int64) + 1
    return place, place.max(axis=0) + 2


def _numbers(place: IntArray, size: IntArray) -> IntArray:
    numbers: IntArray = (place[:, 2] * size[1] + place[:, 1]) * size[0] + place[:, 0]
    return numbers


@kernel
def _search_kernel(
    points: FloatArray, order: IntArray, cells: IntArray, start: IntArray, size: IntArray,
    side_length: float, most_neighbours: int, answer: IntArray, distance: FloatArray,
    rows: NDArray[np.int32],
    unknown: NDArray[np.bool_],
) -> None:
    """points, order, cells, start, size, side_length : as in `Cells`, the points in order, too

    answer : (n,), where to write what is found of each point, −1 for nowhere
    unknown : on return, which points' neighbours may lie farther away than the cells around
    """
    count = distance.shape[1]
    around, spot = np.empty((3, most_neighbours)), np.empty(most_neighbours, dtype=np.int64)
    away, near = np.empty(most_neighbours), np.empty(most_neighbours + 1)
    row = np.empty(most_neighbours + 1, dtype=np.int64)
    width, layer = size[0], size[0] * size[1]
    first, guess = 0, side_length * side_length
    while first < len(points):
        last = start[cells[first] + 1]
        many = _gather(points, cells[first], start, width, layer, around, spot)
        for n in range(first, last if count < many <= most_neighbours else first):
            own = answer[order[n]]
            if own < 0:
                continue
            x, y, z = points[n, 0], points[n, 1], points[n, 2]
            for m in range(many):
                dx, dy, dz = around[0, m] - x, around[1, m] - y, around[2, m] - z
                away[m] = dx * dx + dy * dy + dz * dz
            # As far away as the neighbours of the point before, and a little more; else all.
            within = min(1.3 * guess, side_length * side_length)
            held = _select(away[:many], spot, within, near, row)
            if held <= count and within < side_length * side_length:
                within = side_length * side_length
                held = _select(away[:many], spot, within, near, row)
            guess = within
            if held <= count:
                continue
            _sort(near, row, held)
            unknown[own] = False
            for m in range(count):  # the nearest of all is the point itself
                distance[own, m] = np.sqrt(near[m + 1])
                rows[own, m] = order[row[m + 1]]
            guess = float(near[count])
        first = last


@inner_kernel
def _gather(
    points: FloatArray, cell: int, start: IntArray, width: int, layer: int, around: FloatArray,
    spot: IntArray,
) -> int:
    """The points in and around a cell, and where they are from; how many there are, even if that
    is more than there is room for."""
    many = 0
    for k in range(-1, 2):
        for j in range(-1, 2):
            middle = cell + k * layer + j * width
            for m in range(start[middle - 1], start[middle + 2]):
                if many < len(spot):
                    for c in range(3):
                        around[c, many] = points[m, c]
                    spot[many] = m
                many += 1
    return many


@inner_kernel
def _select(
    away: FloatArray, spot: IntArray, within: float, near: FloatArray, row: IntArray
) -> int:
    """Those no farther away come first in `near` and `row`; how many they are."""
    held = 0
    for m in range(len(away)):
        near[held], row[held] = away[m], spot[m]
        held += away[m] <= within
    return held


@inner_kernel
def _sort(near: FloatArray, row: IntArray, held: int) -> None:
    """By insertion, as few are held; equal ones stay in their order."""
    for m in range(1, held):
        d2, spot, at = near[m], row[m], m
        while at > 0 and near[at - 1] > d2:
            near[at], row[at] = near[at - 1], row[at - 1]
            at -= 1
        near[at], row[at] = d2, spot


def nearest_samples(points_mm: FloatArray, reach_mm: FloatArray, grid: Grid) -> NDArray[np.int32]:
    """Row of the nearest sample at every node within reach of one, −1 elsewhere.

    points_mm : (n, 3) float64; reach_mm : (n,) float64; returns : (nz, ny, nx) int32
    """
    sources = allocate_array(grid.shape, np.int32)
    sources.fill(-1)
    relative = np.ascontiguousarray((points_mm - np.asarray(grid.origin_mm)) / grid.pitch_mm)
    squared = np.full(grid.shape, np.inf, dtype=np.float32)
    _nearest_kernel(relative, reach_mm / grid.pitch_mm, sources, squared)
    return sources


@kernel
def _nearest_kernel(
    points: FloatArray, reach: FloatArray, sources: NDArray[np.int32], squared: NDArray[np.float32]
) -> None:
    nz, ny, nx = sources.shape
    for n in range(points.shape[0]):
        x, y, z, r = points[n, 0], points[n, 1], points[n, 2], reach[n]
        k0, k1 = max(0, int(np.ceil(z - r))), min(nz - 1, int(np.floor(z + r)))
        for k in range(k0, k1 + 1):
            left = r * r - (k - z) ** 2
            half = np.sqrt(max(left, 0.0))
            j0, j1 = max(0, int(np.ceil(y - half))), min(ny - 1, int(np.floor(y + half)))
            for j in range(j0, j1 + 1):
                across = (k - z) ** 2 + (j - y) ** 2
                run = np.sqrt(max(r * r - across, 0.0))
                first, last = max(0, int(np.ceil(x - run))), min(nx - 1, int(np.floor(x + run)))
                for i in range(first, last + 1):
                    d2 = np.float32(across + (i - x) ** 2)
                    if d2 < squared[k, j, i]:
                        squared[k, j, i] = d2
                        sources[k, j, i] = n
