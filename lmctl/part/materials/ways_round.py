"""The shortest way between two mixtures that stays out of forbidden regions.

A grid over the mixtures (the simplex) with links to near and farther neighbours is searched for
the shortest way (E. W. Dijkstra, 1959, DOI 10.1007/BF01386390); then the way is shortened between
any two of its points that see each other, and drawn tight. Lengths are Euclidean in volume
fractions. Gaps between regions that are narrower than the grid may be missed.
"""

from __future__ import annotations

from itertools import product
from math import gcd

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.part.materials.allowed_mixtures import AllowedMixtures

#: Steps of the grid from one pure powder to another, and how far links reach, by powders.
_GRID = {2: (100, 1), 3: (50, 3), 4: (24, 2)}
#: Points that a way is shortened with, sweeps that draw it tight, and how often both are done.
_POINTS, _SWEEPS, _ROUNDS = 61, 60, 5


def shortest_way(
    start: FloatArray, end: FloatArray, allowed: AllowedMixtures, powders: BoolArray
) -> FloatArray | None:
    """Mixtures (k, m) from start to end between which straight changes are allowed; None where
    there is no way.

    start, end : (m,) allowed mixtures
    powders : (m,) bool, those the way may use
    """
    ends = np.array([start, end], dtype=np.float64)
    if not allowed.crosses(ends[:1], ends[1:])[0]:
        return ends
    way = _grid_way(ends, allowed, powders)
    if way is None:
        return None
    for _ in range(_ROUNDS):
        way = allowed.tightened(_resampled(way, _POINTS), _SWEEPS)
        way = _shortcut(way, allowed)
    return way


def way_length(way: FloatArray) -> float:
    """Length of a way (k, m), Euclidean in volume fractions."""
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def simplex_grid(steps: int, m: int) -> IntArray:
    """All mixtures of m powders in steps of 1/steps, times steps: (n, m) int64, rows rising."""
    if m == 1:
        return np.array([[steps]], dtype=np.int64)
    rows = [np.column_stack([np.full(len(rest), first), rest])
            for first in range(steps + 1) for rest in [simplex_grid(steps - first, m - 1)]]
    return np.concatenate(rows)


def _grid_way(ends: FloatArray, allowed: AllowedMixtures, powders: BoolArray) -> FloatArray | None:
    from scipy.sparse import coo_array  # late: most parts have no rules
    from scipy.sparse.csgraph import dijkstra

    used = np.flatnonzero(powders | (ends > 0).any(axis=0))
    steps, reach = _GRID[max(len(used), 2)]
    grid = simplex_grid(steps, len(used))
    nodes = np.zeros((len(grid), ends.shape[1]))
    nodes[:, used] = grid / steps
    number = np.full((steps + 1,) * (len(used) - 1), -1)
    free = allowed.rule_at(nodes) < 0
    grid, nodes = grid[free], nodes[free]
    number[tuple(grid[:, :-1].T)] = np.arange(len(grid))
    points = np.concatenate([nodes, ends])
    one, other = [], []
    for offset in _offsets(len(used), reach):
        beside = grid + offset
        inside = np.flatnonzero((beside >= 0).all(axis=1))
        found = number[tuple(beside[inside, :-1].T)]
        one.append(inside[found >= 0])
        other.append(found[found >= 0])
    for k in range(2):
        one.append(np.full(len(nodes), len(nodes) + k))
        other.append(np.arange(len(nodes)))
    a, b = np.concatenate(one), np.concatenate(other)
    clear = ~allowed.crosses(points[a], points[b])
    a, b = a[clear], b[clear]
    length = np.linalg.norm(points[a] - points[b], axis=1) + 1e-12
    graph = coo_array((length, (a, b)), shape=(len(points), len(points))).tocsr()
    distance, before = dijkstra(graph, directed=False, indices=len(nodes), return_predecessors=True)
    if not np.isfinite(distance[-1]):
        return None
    route = [len(points) - 1]
    while route[-1] != len(nodes):
        route.append(int(before[route[-1]]))
    return np.asarray(points[route[::-1]])


def _offsets(m: int, reach: int) -> list[IntArray]:
    """Steps between grid mixtures, one of each pair of opposites, none a multiple of another."""
    found = []
    for step in product(range(-reach, reach + 1), repeat=m):
        if sum(step) == 0 and gcd(*step) == 1 and next(s for s in step if s) > 0:
            found.append(np.array(step))
    return found


def _resampled(way: FloatArray, count: int) -> FloatArray:
    """A way's own points and others evenly between them, at least `count`."""
    length = np.linalg.norm(np.diff(way, axis=0), axis=1)
    spacing = max(float(length.sum()) / count, 1e-9)
    parts = []
    for a, b, own in zip(way[:-1], way[1:], length, strict=True):
        pieces = max(1, int(np.ceil(own / spacing)))
        parts.append(a + np.arange(pieces)[:, None] / pieces * (b - a))
    return np.concatenate([*parts, way[-1:]])


def _shortcut(way: FloatArray, allowed: AllowedMixtures) -> FloatArray:
    """The shortest of the ways over some of a way's points (k, m), in their order."""
    k = len(way)
    i, j = np.triu_indices(k, 1)
    clear = np.zeros((k, k), np.bool_)
    clear[i, j] = ~allowed.crosses(way[i], way[j])
    clear[np.arange(k - 1), np.arange(1, k)] = True  # the way itself is allowed
    length = np.linalg.norm(way[:, None] - way[None], axis=2)
    best, before = np.full(k, np.inf), np.zeros(k, np.intp)
    best[0] = 0.0
    for at in range(1, k):
        through = np.where(clear[:at, at], best[:at] + length[:at, at], np.inf)
        before[at] = int(np.argmin(through))
        best[at] = through[before[at]]
    route = [k - 1]
    while route[-1]:
        route.append(int(before[route[-1]]))
    return way[route[::-1]]
