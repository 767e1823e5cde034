"""Distance to the features a material is graded from: point, segment, axis, polyline, plane.

Exact, vectorised, unsigned unless stated otherwise. points : (n, 3) float64 [mm] x, y, z;
results : (n,) float64 [mm].
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray

Vector = Sequence[float] | FloatArray


def point_distance(points: FloatArray, point: Vector) -> FloatArray:
    """Distance to one point."""
    return length(points - np.asarray(point, dtype=np.float64))


def axis_distance(points: FloatArray, origin: Vector, direction: Vector) -> FloatArray:
    """Distance to the infinite line through `origin` along `direction` (any length but 0)."""
    axis = unit_vector(direction)
    x, y, z = (points[:, k] - float(origin[k]) for k in range(3))
    along = x * axis[0] + y * axis[1] + z * axis[2]
    return np.asarray(np.sqrt(
        (x - along * axis[0])**2 + (y - along * axis[1])**2 + (z - along * axis[2])**2))


def segment_distance(points: FloatArray, start: Vector, end: Vector) -> FloatArray:
    """Distance to the segment from `start` to `end`; a point where the two are one."""
    a = np.asarray(start, dtype=np.float64)
    along = np.asarray(end, dtype=np.float64) - a
    offset = points - a
    squared = float(along @ along)
    if squared == 0.0:
        return length(offset)
    t = np.clip(offset @ along / squared, 0.0, 1.0)
    return length(offset - t[:, None] * along)


def plane_offset(points: FloatArray, origin: Vector, normal: Vector) -> FloatArray:
    """Signed distance from the plane through `origin`, positive on the side `normal` points to."""
    offset: FloatArray = (points - np.asarray(origin, dtype=np.float64)) @ unit_vector(normal)
    return offset


def unit_vector(direction: Vector) -> FloatArray:
    """`direction` at length 1; ValueError where it has none."""
    vector = np.asarray(direction, dtype=np.float64)
    size = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(size) or size == 0.0:
        raise ValueError(f"{vector.tolist()} is no direction")
    unit: FloatArray = vector / size
    return unit


def length(vectors: FloatArray) -> FloatArray:
    """Length of each row of (n, 3)."""
    result: FloatArray = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return result
