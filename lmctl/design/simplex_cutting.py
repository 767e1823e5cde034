"""Cut a lattice along a surface: near nodes are moved onto it, cells that it crosses are divided.

After isosurface stuffing (Labelle and Shewchuk, ACM Trans. Graph. 26 (2007) 57): a node that lies
nearer to a cut of one of its edges than a share of the edge moves there, so that no cut leaves a
sliver.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.design.lattice import Lattice, oriented, signed_volumes

#: A node moves onto the surface that cuts one of its edges within this share of it.
WARP_SHARE = 0.3

#: Halvings of an edge: the cut is found to 1e-12 of its length.
_BISECTIONS = 40

#: A cell this small beside the mean has lost its volume to the moves.
_FLAT_SHARE = 1e-6


def cut_lattice(
    lattice: Lattice, distance: Callable[[FloatArray], FloatArray], in_plane: BoolArray
) -> Lattice:
    """The part of a lattice where the distance is positive.

    distance : (n, dim) -> (n,), positive inside; only its sign is used
    in_plane : (n_points, dim), where a node may not move along an axis, as it bounds the box there
    """
    points, cells = lattice.points.copy(), lattice.cells
    sign = np.where(distance(points) > 0, 1, -1)
    used = np.abs(sign[cells].sum(axis=1)) < cells.shape[1]
    edges = _edges(cells[used])
    edges = edges[sign[edges[:, 0]] != sign[edges[:, 1]]]
    share = _crossing_shares(points, edges, sign, distance)
    cuts = points[edges[:, 0]] + share[:, None] * (points[edges[:, 1]] - points[edges[:, 0]])
    _warp(points, sign, edges, share, cuts, in_plane)
    kept = (sign[edges] != 0).all(axis=1)
    edges, cuts = edges[kept], cuts[kept]
    keys = np.minimum(*edges.T) * np.int64(len(points)) + np.maximum(*edges.T)
    order = np.argsort(keys)
    keys, cuts = keys[order], cuts[order]

    def cut_of(a: IntArray, b: IntArray) -> IntArray:
        key = np.minimum(a, b) * np.int64(len(points)) + np.maximum(a, b)
        return len(points) + np.searchsorted(keys, key)

    whole = _divide(cells, sign, cut_of)
    flat = (sign[cells] == 0).all(axis=1)
    if flat.any():  # all corners on the surface: inside or outside by its middle
        middle = points[cells[flat]].mean(axis=1)
        whole.append(cells[flat][distance(middle) > 0])
    return _compact(np.concatenate([points, cuts]), np.concatenate(whole))


def _edges(cells: IntArray) -> IntArray:
    size = cells.shape[1]
    pairs = np.concatenate([np.sort(cells[:, [a, b]], axis=1)
                            for a in range(size) for b in range(a + 1, size)])
    if len(pairs) == 0:
        return pairs
    return np.unique(pairs, axis=0)


def _crossing_shares(
    points: FloatArray, edges: IntArray, sign: IntArray,
    distance: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Where the distance changes its sign along each edge, as a share from its first node."""
    start, way = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    first = sign[edges[:, 0]] > 0
    for _ in range(_BISECTIONS if len(edges) else 0):
        middle = 0.5 * (low + high)
        same = (distance(start + middle[:, None] * way) > 0) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return 0.5 * (low + high)


def _warp(
    points: FloatArray, sign: IntArray, edges: IntArray, share: FloatArray, cuts: FloatArray,
    in_plane: BoolArray,
) -> None:
    """Move nodes onto the nearest cut that is near enough; their sign becomes 0."""
    node = np.concatenate([edges[:, 0], edges[:, 1]])
    other = np.concatenate([edges[:, 1], edges[:, 0]])
    away = np.concatenate([share, 1.0 - share])
    row = np.tile(np.arange(len(edges)), 2)
    stays = (~in_plane[node] | in_plane[other]).all(axis=1)
    near = (away < WARP_SHARE) & stays
    node, away, row = node[near], away[near], row[near]
    order = np.lexsort((away, node))
    node, row = node[order], row[order]
    first = np.ones(len(node), dtype=bool)
    first[1:] = node[1:] != node[:-1]
    # Both ends of an edge are never nearer than half of it, so no two nodes take one cut.
    points[node[first]] = cuts[row[first]]
    sign[node[first]] = 0


def _divide(
    cells: IntArray, sign: IntArray, cut_of: Callable[[IntArray, IntArray], IntArray]
) -> list[IntArray]:
    """The cells that are inside, and the inner pieces of those that are cut."""
    labels = sign[cells]
    order = np.argsort(-labels, axis=1, kind="stable")  # positive first, then 0, then negative
    cells = np.take_along_axis(cells, order, axis=1)
    positive, negative = (labels > 0).sum(axis=1), (labels < 0).sum(axis=1)
    found = [cells[(negative == 0) & (positive > 0)]]
    size = cells.shape[1]
    for p in range(1, size):
        for n in range(1, size - p + 1):
            rows = cells[(positive == p) & (negative == n)]
            if not len(rows):
                continue
            inner, on = rows[:, :p], rows[:, p : size - n]
            outer = rows[:, size - n :]
            cut = np.stack([cut_of(inner[:, a], outer[:, b])
                            for a in range(p) for b in range(n)], axis=1)
            found += _pieces(p, n, inner, on, cut)
    return found


def _pieces(p: int, n: int, inner: IntArray, on: IntArray, cut: IntArray) -> list[IntArray]:
    """Simplices of what is left of a cell: p inner nodes, some on the surface, p·n cuts."""
    if p == 1:
        return [np.concatenate([inner, on, cut], axis=1)]
    if p == 2 and n == 1:  # a quadrilateral, with the node on the surface (3D) a pyramid on it
        first, second = _split_quads(np.stack(
            [inner[:, 0], inner[:, 1], cut[:, 1], cut[:, 0]], axis=1))
        return [np.concatenate([half, on], axis=1) for half in (first, second)]
    if p == 2:  # n = 2: a wedge
        prism = np.stack([inner[:, 0], cut[:, 0], cut[:, 1], inner[:, 1], cut[:, 2], cut[:, 3]],
                         axis=1)
    else:  # p = 3, n = 1: a tetrahedron without its tip
        prism = np.concatenate([inner, cut], axis=1)
    return split_prisms(prism)


def _split_quads(quads: IntArray) -> tuple[IntArray, IntArray]:
    """Two triangles each, along the diagonal from the corner with the least number."""
    least = np.argmin(quads, axis=1)
    q = np.take_along_axis(quads, (least[:, None] + np.arange(4)) % 4, axis=1)
    return q[:, [0, 1, 2]], q[:, [0, 2, 3]]


#: Corners of a prism turned so that each of the six comes first.
_PRISM_TURNS = np.array([[0, 1, 2, 3, 4, 5], [1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4],
                         [3, 5, 4, 0, 2, 1], [4, 3, 5, 1, 0, 2], [5, 4, 3, 2, 1, 0]])


def split_prisms(prisms: IntArray) -> list[IntArray]:
    """Three tetrahedra each; a face that two prisms share is divided alike in both.

    prisms : (n, 6), two triangles whose corners face one another
    Source: Dompierre, Labbé, Vallet and Camarero, Proc. 8th Int. Meshing Roundtable (1999) 195-204:
    each face is divided from its corner with the least number.
    """
    v = np.take_along_axis(prisms, _PRISM_TURNS[np.argmin(prisms, axis=1)], axis=1)
    first = np.minimum(v[:, 1], v[:, 5]) < np.minimum(v[:, 2], v[:, 4])
    a, b = v[first], v[~first]
    return [a[:, [0, 1, 2, 5]], a[:, [0, 1, 5, 4]], a[:, [0, 4, 5, 3]],
            b[:, [0, 1, 2, 4]], b[:, [0, 4, 2, 5]], b[:, [0, 4, 5, 3]]]


def _compact(points: FloatArray, cells: IntArray) -> Lattice:
    """Without cells that have lost their volume, and without unused points."""
    cells = oriented(points, cells)
    volume = signed_volumes(points, cells)
    if len(cells):
        cells = cells[volume > _FLAT_SHARE * volume.mean()]
    used, numbers = np.unique(cells, return_inverse=True)
    return Lattice(points[used], numbers.reshape(cells.shape))
