"""Exact signed distance to a closed mesh at any places, from a tree of boxes around its triangles.

The tree is complete and balanced: each box is halved at the median of its triangles' middles along
its longest side, so a node's number gives the triangles in it. The result for one place bounds the
search at the next, which is usually near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.field.triangles import closest_on_triangle

LEAF_TRIANGLES = 4  # a leaf holds at most so many
MAX_TREE_DEPTH = 40  # levels a walk can remember


@dataclass(frozen=True, eq=False)
class TriangleTree:
    """The triangles of a closed mesh that faces out, sorted into boxes.

    triangles : (m, 3, 3) float64 [mm], in the tree's own order
    boxes : (2^(levels + 1) − 1, 2, 3) float64 [mm], lowest and highest corner of each node's; node
        0 holds all, nodes 2n + 1 and 2n + 2 are the halves of node n
    levels : of halving; leaf k holds triangles k m / 2^levels to (k + 1) m / 2^levels
    """

    triangles: FloatArray
    boxes: FloatArray
    levels: int

    @staticmethod
    def of(corners_mm: FloatArray) -> TriangleTree:
        """corners_mm : (m, 3, 3) float64, m ≥ 1, none without area."""
        count = len(corners_mm)
        levels = max(0, int(np.ceil(np.log2(count / LEAF_TRIANGLES))))
        order = np.arange(count)
        _order_kernel(np.ascontiguousarray(corners_mm.mean(axis=1)), order, levels)
        triangles = np.ascontiguousarray(corners_mm[order])
        boxes = np.empty((2 ** (levels + 1) - 1, 2, 3))
        _boxes_kernel(triangles, levels, boxes)
        return TriangleTree(triangles, boxes, levels)

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Distance to the surface, positive inside: (n, 3) float64 -> (n,) float64 [mm]."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        distance = np.empty(len(points))
        closest = np.empty((0, 3))
        _distance_kernel(self.triangles, self.boxes, self.levels, points, distance, closest)
        return distance

    def is_inside(self, points: FloatArray) -> NDArray[np.bool_]:
        """Whether the mesh winds around each of points (n, 3), (n,); quicker than distances."""
        inside = np.empty(len(points), dtype=np.bool_)
        _inside_kernel(self.triangles, self.boxes, self.levels,
                       np.ascontiguousarray(points, dtype=np.float64), inside)
        return inside

    def closest_points(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The surface point nearest to each of points (n, 3), (n, 3); and their distances (n,)."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        distance, closest = np.empty(len(points)), np.empty((len(points), 3))
        _distance_kernel(self.triangles, self.boxes, self.levels, points, distance, closest)
        return closest, distance


@kernel
def _order_kernel(middles: FloatArray, order: NDArray[np.int64], levels: int) -> None:
    """Order triangles so that each node of the tree holds a run of them (quickselect)."""
    count = len(order)
    for level in range(levels):
        for node in range(1 << level):
            first, last = (node * count) >> level, ((node + 1) * count) >> level
            middle = ((2 * node + 1) * count) >> (level + 1)
            axis, widest = 0, -1.0
            for a in range(3):
                low, high = np.inf, -np.inf
                for n in range(first, last):
                    low = min(low, middles[order[n], a])
                    high = max(high, middles[order[n], a])
                if high - low > widest:
                    axis, widest = a, high - low
            left, right = first, last - 1
            while left < right:
                pivot = middles[order[(left + right) // 2], axis]
                i, j = left, right
                while i <= j:
                    while middles[order[i], axis] < pivot:
                        i += 1
                    while middles[order[j], axis] > pivot:
                        j -= 1
                    if i <= j:
                        order[i], order[j] = order[j], order[i]
                        i, j = i + 1, j - 1
                if middle <= j:
                    right = j
                elif middle >= i:
                    left = i
                else:
                    break


@kernel
def _boxes_kernel(triangles: FloatArray, levels: int, boxes: FloatArray) -> None:
    count, leaves = len(triangles), 1 << levels
    for leaf in range(leaves):
        box = boxes[leaves - 1 + leaf]
        box[0, :], box[1, :] = np.inf, -np.inf
        for n in range((leaf * count) >> levels, ((leaf + 1) * count) >> levels):
            for c in range(3):
                for a in range(3):
                    box[0, a] = min(box[0, a], triangles[n, c, a])
                    box[1, a] = max(box[1, a], triangles[n, c, a])
    for node in range(leaves - 2, -1, -1):
        for a in range(3):
            boxes[node, 0, a] = min(boxes[2 * node + 1, 0, a], boxes[2 * node + 2, 0, a])
            boxes[node, 1, a] = max(boxes[2 * node + 1, 1, a], boxes[2 * node + 2, 1, a])


@kernel
def _distance_kernel(
    triangles: FloatArray, boxes: FloatArray, levels: int, points: FloatArray,
    distance: FloatArray, closest: FloatArray,
) -> None:
    """closest : (n, 3) for the nearest places, too, or (0, 3) for none."""
    nodes = np.empty(2 * MAX_TREE_DEPTH, dtype=np.int64)
    far = np.empty(2 * MAX_TREE_DEPTH)
    nearest, before, side = 0, np.inf, 1.0
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        nearest, qx, qy, qz = _nearest(triangles, boxes, levels, x, y, z, nearest, nodes, far)
        away = np.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2)
        step_mm = np.inf
        if row > 0:
            step_mm = np.sqrt((x - points[row - 1, 0]) ** 2 + (y - points[row - 1, 1]) ** 2
                          + (z - points[row - 1, 2]) ** 2)
        # Else no surface is between the two places.
        if not step_mm < (1.0 - 1e-9) * max(before, away):
            side = 1.0 if _winding(triangles, boxes, levels, x, y, z, nodes) != 0 else -1.0
        before = away
        distance[row] = side * away
        if len(closest) > 0:
            closest[row, 0], closest[row, 1], closest[row, 2] = qx, qy, qz


@kernel
def _inside_kernel(
    triangles: FloatArray, boxes: FloatArray, levels: int, points: FloatArray,
    inside: NDArray[np.bool_],
) -> None:
    nodes = np.empty(2 * MAX_TREE_DEPTH, dtype=np.int64)
    for row in range(len(points)):
        x, y, z = points[row, 0], points[row, 1], points[row, 2]
        inside[row] = _winding(triangles, boxes, levels, x, y, z, nodes) != 0


@inner_kernel
def _nearest(
    triangles: FloatArray, boxes: FloatArray, levels: int, x: float, y: float, z: float,
    guess: int, nodes: NDArray[np.int64], far: FloatArray,
) -> tuple[int, float, float, float]:
    """The triangle nearest to a place, and the nearest point of it. guess : a triangle near it"""
    count, leaves = len(triangles), 1 << levels
    nearest = guess
    bx, by, bz, _ = closest_on_triangle(triangles, guess, x, y, z)
    least = (bx - x) ** 2 + (by - y) ** 2 + (bz - z) ** 2
    nodes[0], far[0], waiting = 0, _box_squared(boxes, 0, x, y, z), 1
    while waiting > 0:
        waiting -= 1
        node, away = nodes[waiting], far[waiting]
        if away >= least:
            continue
        if node >= leaves - 1:
            leaf = node - (leaves - 1)
            for n in range((leaf * count) >> levels, ((leaf + 1) * count) >> levels):
                qx, qy, qz, _ = closest_on_triangle(triangles, n, x, y, z)
                squared = (qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2
                if squared < least:
                    nearest, least, bx, by, bz = n, squared, qx, qy, qz
            continue
        left, right = 2 * node + 1, 2 * node + 2
        to_left, to_right = _box_squared(boxes, left, x, y, z), _box_squared(boxes, right, x, y, z)
        if to_left < to_right:
            left, right, to_left, to_right = right, left, to_right, to_left
        if to_left < least:
            nodes[waiting], far[waiting], waiting = left, to_left, waiting + 1
        if to_right < least:
            nodes[waiting], far[waiting], waiting = right, to_right, waiting + 1
    return nearest, bx, by, bz


@inner_kernel
def _box_squared(boxes: FloatArray, node: int, x: float, y: float, z: float) -> float:
    dx = max(boxes[node, 0, 0] - x, 0.0, x - boxes[node, 1, 0])
    dy = max(boxes[node, 0, 1] - y, 0.0, y - boxes[node, 1, 1])
    dz = max(boxes[node, 0, 2] - z, 0.0, z - boxes[node, 1, 2])
    return float(dx * dx + dy * dy + dz * dz)


@inner_kernel
def _winding(
    triangles: FloatArray, boxes: FloatArray, levels: int, x: float, y: float, z: float,
    nodes: NDArray[np.int64],
) -> int:
    """How often the mesh winds around a place: triangles above it that face up, less those down.

    A triangle is above where the place lies inside its shadow by the even-odd rule, half open in y
    and with each edge computed from its lower end: two triangles that share an edge get bit for
    bit the same answer for it, so no ray slips between them or counts both.
    """
    count, leaves = len(triangles), 1 << levels
    total, waiting = 0, 1
    nodes[0] = 0
    while waiting > 0:
        waiting -= 1
        node = nodes[waiting]
        if (
            boxes[node, 1, 2] < z or not boxes[node, 0, 0] <= x <= boxes[node, 1, 0]
            or not boxes[node, 0, 1] <= y <= boxes[node, 1, 1]
        ):
            continue
        if node < leaves - 1:
            nodes[waiting], nodes[waiting + 1] = 2 * node + 1, 2 * node + 2
            waiting += 2
            continue
        leaf = node - (leaves - 1)
        for n in range((leaf * count) >> levels, ((leaf + 1) * count) >> levels):
            total += _above(triangles, n, x, y, z)
    return total


@inner_kernel
def _above(triangles: FloatArray, n: int, x: float, y: float, z: float) -> int:
    t = triangles[n]
    enter, leave, met = np.inf, -np.inf, 0
    for e in range(3):
        p, q = e, (e + 1) % 3
        if t[p, 1] > t[q, 1] or (t[p, 1] == t[q, 1] and t[p, 0] > t[q, 0]):
            p, q = q, p
        if (t[p, 1] > y) != (t[q, 1] > y):
            at = t[p, 0] + (y - t[p, 1]) * ((t[q, 0] - t[p, 0]) / (t[q, 1] - t[p, 1]))
            enter, leave, met = min(enter, at), max(leave, at), met + 1
    if met != 2 or not enter < x <= leave:
        return 0
    ux, uy, uz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    vx, vy, vz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    area = ux * vy - uy * vx
    if area == 0.0:
        return 0
    height = t[0, 2] + (
        (x - t[0, 0]) * (uz * vy - uy * vz) + (y - t[0, 1]) * (ux * vz - uz * vx)
    ) / area
    height = min(max(height, min(t[0, 2], t[1, 2], t[2, 2])), max(t[0, 2], t[1, 2], t[2, 2]))
    if height <= z:
        return 0
    return 1 if area > 0.0 else -1
