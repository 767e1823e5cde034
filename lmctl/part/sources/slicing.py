"""The outline of a mesh in a plane, cut straight from its triangles.

Exact to rounding, corners included, where the zero level of a stored field rounds them; and
quicker than calling a library for one plane at a time (tests/benchmarks/slicing.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.field.plane import loop_area_mm2


@dataclass(frozen=True)
class MeshSlicer:
    """A closed mesh made ready for many slices: the heights between which each triangle lies.

    vertices : (n, 3) float64 [mm]; triangles : (m, 3) int64, every edge in an even number of them
    """

    vertices: FloatArray
    triangles: IntArray

    @cached_property
    def _heights(self) -> tuple[FloatArray, FloatArray]:
        z = self.vertices[:, 2]
        a, b, c = (z[self.triangles[:, k]] for k in range(3))
        return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)

    def loops(self, z_mm: float) -> list[FloatArray]:
        """Closed outlines at height z, the inside on the left by parity.

        A corner exactly in the plane counts as below it, so that every cut edge is cut once, a
        mesh standing on z has its footprint as outline there, and one ending at z has none.

        returns : loops (k, 2) float64 [mm], first point repeated last; outer loops run
            counter-clockwise, holes clockwise
        """
        points, links = self._crossed_edges(z_mm)
        loops = [loop for chain in _chains(links) if (loop := _closed(points[chain])) is not None]
        return _turned(loops)

    def _crossed_edges(self, z_mm: float) -> tuple[FloatArray, IntArray]:
        """Points where edges pass the plane, (p, 2), and the pairs that triangles join, (s, 2).

        Each pair runs so that the solid is on its left where the triangle faces outwards.
        """
        low, high = self._heights
        corners = self.triangles[(low <= z_mm) & (high > z_mm)]
        above = self.vertices[corners, 2] > z_mm
        one_above = above.sum(axis=1) == 1
        first = np.argmax(above == one_above[:, None], axis=1)  # the corner alone on its side
        rows = np.arange(len(corners))
        a, b, c = (corners[rows, (first + k) % 3] for k in range(3))
        start, end = np.where(one_above, b, c), np.where(one_above, c, b)
        edges = np.stack([np.stack([a, start], 1), np.stack([a, end], 1)], axis=1).reshape(-1, 2)
        edges.sort(axis=1)  # both triangles of an edge compute the same point, bit for bit
        count = len(self.vertices)
        keys, number = np.unique(edges[:, 0] * count + edges[:, 1], return_inverse=True)
        p, q = self.vertices[keys // count], self.vertices[keys % count]
        t = (z_mm - p[:, 2]) / (q[:, 2] - p[:, 2])
        return p[:, :2] + t[:, None] * (q - p)[:, :2], number.reshape(-1, 2)


def _chains(links: IntArray) -> list[IntArray]:
    """Walk the links into closed chains of point numbers; each link is used once.

    Every point has an even number of links. Where it has more than two (surfaces that touch along
    an edge) any continuation closes, and parity does not care which.
    """
    if len(links) == 0:
        return []
    points, starts = _chains_kernel(np.ascontiguousarray(links, dtype=np.int64))
    return np.split(points, starts[1:-1])


@kernel
def _chains_kernel(links: IntArray) -> tuple[IntArray, IntArray]:
    """Point numbers of all chains one after the other, and where each begins.

    links : (s, 2); entry e is end e % 2 of link e // 2
    """
    n = len(links)
    first = np.zeros(links.max() + 2, np.int64)  # entries at each point, in their order
    for e in range(2 * n):
        first[links[e // 2, e % 2] + 1] += 1
    for point in range(len(first) - 1):
        first[point + 1] += first[point]
    place = first[:-1].copy()
    entry = np.empty(2 * n, np.int64)
    for e in range(2 * n):
        point = links[e // 2, e % 2]
        entry[place[point]] = e
        place[point] += 1
    used = np.zeros(n, np.bool_)
    chain, starts = np.empty(2 * n, np.int64), np.empty(n + 1, np.int64)
    count = chains = 0
    for link in range(n):
        if used[link]:
            continue
        used[link] = True
        starts[chains] = count
        begin, point = links[link, 0], links[link, 1]
        chain[count] = begin
        count += 1
        while point != begin:
            chain[count] = point
            count += 1
            onward = -1
            for k in range(first[point], first[point + 1]):
                if not used[entry[k] // 2]:
                    onward = entry[k]
                    break
            if onward < 0:
                break
            used[onward // 2] = True
            point = links[onward // 2, 1 - onward % 2]
        chain[count] = begin
        count += 1
        chains += 1
    starts[chains] = count
    return chain[:count].copy(), starts[: chains + 1].copy()


def _closed(points: FloatArray) -> FloatArray | None:
    """A chain without repeated points; None where nothing with an area is left."""
    keep = np.ones(len(points), dtype=bool)
    keep[1:] = np.any(points[1:] != points[:-1], axis=1)
    loop: FloatArray = points[keep]
    return loop if len(loop) >= 4 and loop_area_mm2(loop) != 0.0 else None


def _turned(loops: list[FloatArray]) -> list[FloatArray]:
    """Each loop turned so that what is solid by parity lies on its left.

    A loop whose box does not hold a place is crossed evenly often on the way out from there.
    """
    if not loops:
        return loops
    low = np.array([loop.min(axis=0) for loop in loops])
    high = np.array([loop.max(axis=0) for loop in loops])
    turned = []
    for index, loop in enumerate(loops):
        around = np.all((low <= loop[0]) & (loop[0] <= high), axis=1)
        around[index] = False
        depth = sum(
            count_ray_crossings(loop[0], loops[other][:-1], loops[other][1:])
            for other in np.flatnonzero(around)
        )
        outer = depth % 2 == 0
        turned.append(loop if (loop_area_mm2(loop) > 0) == outer else loop[::-1].copy())
    return turned


def count_ray_crossings(point: FloatArray, start: FloatArray, end: FloatArray) -> int:
    """How many segments a ray from `point` along +x crosses; half-open in y."""
    spans = (start[:, 1] > point[1]) != (end[:, 1] > point[1])
    a, b = start[spans], end[spans]
    x = a[:, 0] + (point[1] - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return int(np.count_nonzero(x > point[0]))
