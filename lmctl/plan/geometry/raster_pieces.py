"""Connected pieces of a raster: which nodes hang together, side by side.

Own kernels: scipy's module for this takes as long to load as a small part takes to plan.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import IntArray
from lmctl.field.kernel import kernel
from lmctl.field.union_find import unite


def connected_pieces(values: NDArray[np.float32]) -> tuple[NDArray[np.int32], IntArray]:
    """Pieces of the nodes with a positive value that hang together along rows and columns.

    values : (ny, nx) float32
    Returns (label, peaks): the number of the piece at each node, (ny, nx) int32, −1 in none; the
    flat index of the greatest value of each, the first of equal ones. Pieces are numbered in the
    order of their first nodes.
    """
    label = np.empty(values.shape, np.int32)
    return label, _pieces_kernel(np.ascontiguousarray(values, np.float32), label)


def nodes_of_pieces(
    label: NDArray[np.int32], count: int
) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Rows and columns of the nodes of each of `count` pieces, in the order of the raster."""
    j, i = np.nonzero(label >= 0)
    number = label[j, i]
    order = np.argsort(number, kind="stable")
    ends = np.cumsum(np.bincount(number, minlength=count))[:-1]
    return list(zip(np.split(j[order], ends), np.split(i[order], ends), strict=True))


@kernel
def _pieces_kernel(values: NDArray[np.float32], label: NDArray[np.int32]) -> IntArray:
    """Runs of a row join those of the row above that they touch: union by the lower number."""
    ny, nx = values.shape
    parent = np.empty(ny * ((nx + 1) // 2), np.int32)
    runs = 0
    for j in range(ny):
        for i in range(nx):
            if not values[j, i] > 0:
                label[j, i] = -1
                continue
            if i > 0 and label[j, i - 1] >= 0:
                label[j, i] = label[j, i - 1]
            else:
                label[j, i] = runs
                parent[runs] = runs
                runs += 1
            if j > 0 and label[j - 1, i] >= 0:
                unite(parent, label[j, i], label[j - 1, i])
    pieces = 0
    for run in range(runs):
        if parent[run] == run:
            parent[run] = -1 - pieces  # a piece; negative: no run is
            pieces += 1
        else:
            parent[run] = parent[parent[run]]  # lower, so it stands for a piece already
    peaks = np.full(pieces, -1, np.int64)
    flat = values.ravel()
    for j in range(ny):
        for i in range(nx):
            if label[j, i] >= 0:
                piece = -1 - parent[label[j, i]]
                label[j, i] = piece
                if peaks[piece] < 0 or values[j, i] > flat[peaks[piece]]:
                    peaks[piece] = j * nx + i
    return peaks
