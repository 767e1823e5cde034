"""Polylines in the plane: length along them, points at given lengths, fewer vertices."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel


def arc_lengths(points: FloatArray) -> FloatArray:
    """Length from the first vertex to each, (k,) float64 [mm], of a polyline (k, 2 or 3)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def points_at_lengths(points: FloatArray, lengths_mm: FloatArray) -> FloatArray:
    """The points at these lengths along a polyline, (n, d) float64."""
    along = arc_lengths(points)
    return np.stack(
        [np.interp(lengths_mm, along, points[:, axis]) for axis in range(points.shape[1])], axis=1
    )


def densified_polyline(points: FloatArray, spacing_mm: float) -> FloatArray:
    """The polyline with vertices added where they are farther apart than `spacing_mm`."""
    along = arc_lengths(points)
    pieces = np.maximum(1, np.ceil(np.diff(along) / spacing_mm).astype(int))
    if pieces.max(initial=1) == 1:
        return points
    index = np.repeat(np.arange(len(pieces)), pieces)
    share = (np.arange(len(index)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[index]
    inner = points[index] + share[:, None] * (points[index + 1] - points[index])
    return np.vstack([inner, points[-1:]])


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
