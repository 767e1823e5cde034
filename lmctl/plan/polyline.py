"""Polylines in the plane: length along them, points at given lengths, fewer vertices."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel


def arc_lengths(points: FloatArray) -> FloatArray:
    """Length from the first vertex to each, (k,) float64 [mm], of a polyline (k, 2 or 3)."""
    return np.asarray(_arc_lengths_kernel(np.ascontiguousarray(points), points.shape[1]))


@kernel
def _arc_lengths_kernel(points: FloatArray, dimensions: int) -> FloatArray:
    """`arc_lengths` of points whose coordinates are the first columns of a table."""
    along = np.zeros(len(points))
    for k in range(1, len(points)):
        step = 0.0
        for c in range(dimensions):
            step += (points[k, c] - points[k - 1, c]) ** 2
        along[k] = along[k - 1] + np.sqrt(step)
    return along


def track_lengths(table: FloatArray) -> FloatArray:
    """`arc_lengths` in the plane of a table (k, 2 or more) whose first columns are x and y."""
    return np.asarray(_arc_lengths_kernel(np.ascontiguousarray(table), 2))


def points_at_lengths(points: FloatArray, lengths_mm: FloatArray) -> FloatArray:
    """The points at these lengths along a polyline, (n, d) float64."""
    along = arc_lengths(points)
    return np.stack(
        [np.interp(lengths_mm, along, points[:, axis]) for axis in range(points.shape[1])], axis=1
    )


def densified_polyline(points: FloatArray, spacing_mm: float) -> FloatArray:
    """The polyline with vertices added where they are farther apart than `spacing_mm`."""
    table = np.ascontiguousarray(points)
    count = _densified_count(table, spacing_mm)
    return points if count == len(points) else np.asarray(_densify(table, spacing_mm, count))


@inner_kernel
def _pieces(points: FloatArray, k: int, spacing: float) -> int:
    """How many pieces a segment is cut into, one at least."""
    step = 0.0
    for c in range(points.shape[1]):
        step += (points[k + 1, c] - points[k, c]) ** 2
    return max(1, int(np.ceil(np.sqrt(step) / spacing)))


@kernel
def _densified_count(points: FloatArray, spacing: float) -> int:
    total = 1
    for k in range(len(points) - 1):
        total += _pieces(points, k, spacing)
    return total


@kernel
def _densify(points: FloatArray, spacing: float, total: int) -> FloatArray:
    """(total, d) with each segment cut into equal pieces no longer than `spacing`."""
    result = np.empty((total, points.shape[1]))
    row = 0
    for k in range(len(points) - 1):
        count = _pieces(points, k, spacing)
        for part in range(count):
            for c in range(points.shape[1]):
                result[row, c] = points[k, c] + part / count * (points[k + 1, c] - points[k, c])
            row += 1
    for c in range(points.shape[1]):
        result[row, c] = points[-1, c]
    return result


@kernel
def resampled_polyline(points: FloatArray, spacing_mm: float, deviation_mm: float) -> FloatArray:
    """Points on a polyline (k, 2) in the plane, each `spacing_mm` along it from the one before.

    Nearer where the vertices passed by would lie farther than `deviation_mm` from the straight line
    between both, and before the last vertex, which stays.
    """
    n = len(points)
    length = 0.0
    for k in range(n - 1):
        length += np.sqrt((points[k + 1, 0] - points[k, 0]) ** 2
                          + (points[k + 1, 1] - points[k, 1]) ** 2)
    result = np.empty((n + int(length / spacing_mm) + 2, 2))
    result[0, 0], result[0, 1] = points[0, 0], points[0, 1]
    count = 1
    x, y = points[0, 0], points[0, 1]
    ahead = 1  # the next vertex
    while ahead < n:
        qx, qy, last, left = x, y, ahead, spacing_mm
        while last < n:  # the place so far along, and the vertex after it
            step = np.sqrt((points[last, 0] - qx) ** 2 + (points[last, 1] - qy) ** 2)
            if step > left:
                qx += (points[last, 0] - qx) * left / step
                qy += (points[last, 1] - qy) * left / step
                break
            left -= step
            qx, qy = points[last, 0], points[last, 1]
            last += 1
        ux, uy = qx - x, qy - y
        size = np.sqrt(ux * ux + uy * uy)
        worst, corner = deviation_mm, -1
        for k in range(ahead, min(last, n - 1)):
            wx, wy = points[k, 0] - x, points[k, 1] - y
            away = abs(wx * uy - wy * ux) / size if size > 0 else np.sqrt(wx * wx + wy * wy)
            if away > worst:
                worst, corner = away, k
        if corner >= 0:
            qx, qy, last = points[corner, 0], points[corner, 1], corner + 1
        x, y, ahead = qx, qy, last
        result[count, 0], result[count, 1] = x, y
        count += 1
    return result[:count]


def simplified_vertex_indices(
    points: FloatArray, tolerance_mm: float, fixed: IndexArray
) -> IndexArray:
    """Which vertices to keep so that the polyline moves by no more than `tolerance_mm`.

    Douglas–Peucker between the vertices `fixed`, which always stay, as do both ends.

    points : (k, 3) float64: x, y [mm] and any third value that shall be kept as closely,
        scaled so that the tolerance fits it
    returns : rising indices, (m,) intp
    """
    keep = np.zeros(len(points), dtype=np.bool_)
    keep[0] = keep[-1] = True
    keep[fixed] = True
    _mark(np.ascontiguousarray(points), tolerance_mm**2, keep)
    return np.flatnonzero(keep)


@kernel
def _mark(points: FloatArray, tolerance_sq: float, keep: BoolArray) -> None:
    n = len(points)
    mark_kept_vertices(points, tolerance_sq, keep, np.empty((n, 2), np.int64), n)


@inner_kernel
def mark_kept_vertices(
    points: FloatArray, tolerance_sq: float, keep: BoolArray, stack: IntArray, n: int
) -> None:
    """Mark in `keep` the vertices Douglas–Peucker needs between those already marked.

    Of points (≥ n, 3) the first n are used. stack : (≥ n, 2), overwritten
    """
    start = 0
    while start < n - 1:
        end = start + 1
        while not keep[end]:
            end += 1
        depth = 1
        stack[0, 0], stack[0, 1] = start, end
        while depth > 0:
            depth -= 1
            first, last = stack[depth, 0], stack[depth, 1]
            if last - first < 2:
                continue
            ax, ay, az = points[first, 0], points[first, 1], points[first, 2]
            ux, uy, uz = points[last, 0] - ax, points[last, 1] - ay, points[last, 2] - az
            size = ux * ux + uy * uy + uz * uz
            worst, at = -1.0, first
            for k in range(first + 1, last):
                wx, wy, wz = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - az
                t = 0.0
                if size > 0.0:
                    t = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / size))
                dx, dy, dz = wx - t * ux, wy - t * uy, wz - t * uz
                d = dx * dx + dy * dy + dz * dz
                if d > worst:
                    worst, at = d, k
            if worst > tolerance_sq:
                keep[at] = True
                stack[depth, 0], stack[depth, 1] = first, at
                stack[depth + 1, 0], stack[depth + 1, 1] = at, last
                depth += 2
        start = end
