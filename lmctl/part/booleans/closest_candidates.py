"""Find, for each place, the surface points stored at the nodes around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel

#: Surfaces among which a place looks for its nearest point.
MAX_NEAR_SURFACES = 6


@kernel
def seed_nodes(
    relative: FloatArray, sources: NDArray[np.int32], squared: NDArray[np.float32]
) -> None:
    """Offer each closest point to the nodes around it; a node keeps the nearest it was offered.

    relative : closest points in node units
    sources, squared : −1 and inf where none was offered
    """
    nz, ny, nx = sources.shape
    for n in range(len(relative)):
        x, y, z = relative[n, 0], relative[n, 1], relative[n, 2]
        i0, j0, k0 = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
        for k in range(max(k0 - 1, 0), min(k0 + 3, nz)):
            for j in range(max(j0 - 1, 0), min(j0 + 3, ny)):
                for i in range(max(i0 - 1, 0), min(i0 + 3, nx)):
                    d2 = np.float32((x - i) ** 2 + (y - j) ** 2 + (z - k) ** 2)
                    if d2 < squared[k, j, i]:
                        squared[k, j, i] = d2
                        sources[k, j, i] = n


def corner_candidates(sources: NDArray[np.int32], nodes: FloatArray) -> NDArray[np.int32]:
    """The closest points stored at the corners of cells, (n, 8).

    nodes : (n, 3), a place in each cell, in node units; taken to the grid's rim if it lies outside
    """
    last = np.array(sources.shape[::-1]) - 2
    i, j, k = np.clip(nodes, 0, np.maximum(last, 0)).astype(np.int64).T
    _, ny, nx = sources.shape
    first = (k * ny + j) * nx + i
    steps = [(z * ny + y) * nx + x for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    known: NDArray[np.int32] = sources.ravel()[first[:, None] + np.array(steps)]
    return known


@kernel
def select_closest_candidates(
    offered: NDArray[np.int32], closest_mm: FloatArray, active: NDArray[np.int32],
    points: FloatArray, rows: IntArray, near: IntArray,
) -> None:
    """For each point the nearest of the surface points offered, and the surfaces that all lie on.

    offered : (n, m), numbers of closest points
    rows : (n,), numbers of the nearest ones so far, −1 for none; replaced by nearer ones
    near : (n, MOST_NEAR), numbers of surfaces so far, −1 for none; more are added
    """
    for n in range(len(points)):
        count = 0
        while count < near.shape[1] and near[n, count] >= 0:
            count += 1
        least, best = np.inf, rows[n]
        for c in range(-1, offered.shape[1]):
            row = np.int64(rows[n]) if c < 0 else np.int64(offered[n, c])
            if row < 0:
                continue
            d2 = (
                (closest_mm[row, 0] - points[n, 0]) ** 2 + (closest_mm[row, 1] - points[n, 1]) ** 2
                + (closest_mm[row, 2] - points[n, 2]) ** 2
            )
            if d2 < least:
                least, best = d2, row
            for slot in range(active.shape[1]):
                number = active[row, slot]
                known = number < 0
                for m in range(count):
                    known = known or near[n, m] == number
                if not known and count < near.shape[1]:
                    near[n, count] = number
                    count += 1
        rows[n] = best


def closest_surfaces(
    rows: IntArray, which: IntArray, away: FloatArray, count: int
) -> IntArray:
    """For each of `count` rows the nearest surfaces it met, (count, MOST_NEAR), −1 for none.

    rows, which, away : (m,), each meeting: the row, the surface's number, how far away it is; what
        several bodies share is met several times, and counts once
    """
    order = np.lexsort((which, away, rows))
    rows, which = rows[order], which[order]
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[1:] != rows[:-1]) | (which[1:] != which[:-1])
    rows, which = rows[new], which[new]
    slot = np.arange(len(rows)) - np.searchsorted(rows, rows)
    kept = slot < MAX_NEAR_SURFACES
    near = np.full((count, MAX_NEAR_SURFACES), -1, dtype=np.int64)
    near[rows[kept], slot[kept]] = which[kept]
    return near
