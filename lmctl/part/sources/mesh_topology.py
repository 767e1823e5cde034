"""Which corners, edges and triangles of a mesh belong together, and which triangles are none.

Array code without checks. triangles : (m, 3) int64, numbers of corners
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.field.union_find import unite


def merge_equal_vertices(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Corners of exactly equal coordinates made one."""
    points = np.ascontiguousarray(vertices + 0.0)  # −0 and 0 are the same place
    order = np.lexsort(points.T)
    new = np.ones(len(order), dtype=bool)
    new[1:] = np.any(points[order[1:]] != points[order[:-1]], axis=1)
    number = np.empty(len(order), dtype=np.int64)
    number[order] = np.cumsum(new) - 1
    return points[order[new]], number[triangles]


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
