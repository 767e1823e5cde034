"""Which corners, edges and triangles of a mesh belong together, and which triangles are none.

Array code without checks. triangles : (m, 3) int64, numbers of corners
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.field.union_find import unite

#: Odd numbers without a pattern, one for each coordinate.
_MIXING = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)


def merge_equal_vertices(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Corners of exactly equal coordinates made one, in the order of z, then y, then x."""
    points = np.ascontiguousarray(vertices + 0.0)  # −0 and 0 are the same place
    first, group = _equal_rows(points)
    order = np.lexsort(points[first].T)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.arange(len(order))
    return points[first[order]], number[group[triangles]]


def _equal_rows(points: FloatArray) -> tuple[IntArray, IntArray]:
    """One row of each set of equal rows, (k,), and the number of each row's set, (n,).

    Rows are brought together by one number mixed from their bits, which is sorted in a third of the
    time that three columns take; where two different rows have the same, all columns are sorted.
    """
    bits = points.view(np.uint64)
    mixed = (bits * _MIXING).sum(axis=1, dtype=np.uint64)
    order = np.argsort(mixed)
    new = np.append(True, mixed[order[1:]] != mixed[order[:-1]]) if len(order) else np.ones(0, bool)
    if (np.any(points[order[1:]] != points[order[:-1]], axis=1) != new[1:]).any():
        order = np.lexsort(points.T)
        new[1:] = np.any(points[order[1:]] != points[order[:-1]], axis=1)
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    return order[new], group


def remove_slivers(corners: FloatArray) -> FloatArray:
    """Triangles (m, 3, 3) less those narrower than a millionth of their length.

    Their neighbours cover them to rounding, and the closest point on one cannot be computed.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    wide: FloatArray = corners[twice_area > 1e-6 * longest]
    return wide


def directed_edges(triangles: IntArray) -> IntArray:
    """(3m, 2): the three edges of each triangle in turn, as it runs through them."""
    return triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)


def edge_numbers(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """For each directed edge the number of its undirected edge; how often each of those occurs."""
    edges = np.sort(directed_edges(triangles), axis=1)
    span = int(edges.max()) + 1 if len(edges) else 1
    _, number, counts = np.unique(
        edges[:, 0] * span + edges[:, 1], return_inverse=True, return_counts=True
    )
    return number, counts


def edge_counts(triangles: IntArray) -> IntArray:
    """How often each undirected edge occurs, in no order that means anything."""
    edges = directed_edges(triangles)
    span = int(edges.max()) + 1 if len(edges) else 1
    key = np.sort(edges.min(axis=1) * span + edges.max(axis=1))
    ends = np.flatnonzero(np.append(key[1:] != key[:-1], True)) if len(key) else key
    return np.diff(ends, prepend=-1)


def odd_count_edges(triangles: IntArray) -> IntArray:
    """(k, 2) directed edges that occur an odd number of times, one of each."""
    number, counts = edge_numbers(triangles)
    _, first = np.unique(number, return_index=True)
    odd: IntArray = directed_edges(triangles)[first[counts % 2 == 1]]
    return odd


def connected_patches(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """The number of each triangle's patch; the size of each patch."""
    number, counts = edge_numbers(triangles)
    order = np.argsort(number, kind="stable")
    paired = order[(counts == 2)[number[order]]].reshape(-1, 2) // 3
    patch = connected_components(paired, len(triangles))
    return patch, np.bincount(patch)


def connected_components(links: IntArray, count: int) -> IntArray:
    """The number of the connected component of each of `count` things; links (k, 2) join them."""
    return _components(np.ascontiguousarray(links, dtype=np.int64), count)


@kernel
def _components(links: IntArray, count: int) -> IntArray:
    """Union by the lower number; scipy takes longer to load its own than this takes to run."""
    parent = np.arange(count)
    for k in range(len(links)):
        unite(parent, links[k, 0], links[k, 1])
    labels = np.empty(count, np.int64)
    found = 0
    for i in range(count):
        if parent[i] == i:
            labels[i] = found
            found += 1
        else:
            labels[i] = labels[parent[i]]
    return labels
