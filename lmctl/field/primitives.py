"""Exact signed distance of analytic bodies, positive inside: the opposite of graphics code.

points : (n, 3) float64 [mm] x, y, z; results : (n,) float64 [mm]. Each is a true distance,
inside and outside, so iso-contours of it are evenly spaced. Nodes of a grid come from
`Window.points()`. The constructions follow the ones collected by I. Quilez
(iquilezles.org/articles/distfunctions), with the sign turned.
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.features import Vector, plane_offset, point_distance, unit_vector


def sphere_distance(points: FloatArray, centre: Vector, radius: float) -> FloatArray:
    """A ball."""
    return radius - point_distance(points, centre)


def box_distance(points: FloatArray, low: Vector, high: Vector) -> FloatArray:
    """The axis-aligned box between the corners `low` and `high`."""
    low, high = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    out = np.abs(points - 0.5 * (low + high)) - 0.5 * (high - low)
    beyond = np.maximum(out, 0.0)
    distance: FloatArray = -np.sqrt(np.einsum("ij,ij->i", beyond, beyond)) - np.minimum(
        out.max(axis=1), 0.0
    )
    return distance


def cylinder_distance(points: FloatArray, base: Vector, top: Vector, radius: float) -> FloatArray:
    """The finite cylinder whose axis runs from `base` to `top` (not the same point)."""
    radial, axial, length = _axial(points, base, top)
    return -_box_2d(radial - radius, np.abs(axial - 0.5 * length) - 0.5 * length)


def cone_distance(
    points: FloatArray, base: Vector, top: Vector, base_radius: float, top_radius: float
) -> FloatArray:
    """The frustum from `base` to `top`; one of the radii may be 0 (a cone).

    The nearest of the mantle and the two lids in the half-plane (radius, height).
    """
    radial, axial, length = _axial(points, base, top)
    lid_height = np.where(axial < 0.5 * length, 0.0, length)
    lid_radius = np.where(axial < 0.5 * length, base_radius, top_radius)
    lid_r = np.maximum(radial - lid_radius, 0.0)
    lid_squared = lid_r**2 + (axial - lid_height) ** 2
    run = top_radius - base_radius
    t = np.clip(
        ((radial - base_radius) * run + axial * length) / (run * run + length * length), 0.0, 1.0
    )
    mantle_squared = (radial - base_radius - t * run) ** 2 + (axial - t * length) ** 2
    inside = (axial > 0.0) & (axial < length) & (radial < base_radius + run * axial / length)
    distance = np.sqrt(np.minimum(lid_squared, mantle_squared))
    return np.where(inside, distance, -distance)


def torus_distance(
    points: FloatArray, centre: Vector, axis: Vector, ring_radius: float, tube_radius: float
) -> FloatArray:
    """The ring of radius `ring_radius` around `axis`, a tube of radius `tube_radius`."""
    start = np.asarray(centre, dtype=np.float64)
    radial, axial, _ = _axial(points, start, start + unit_vector(axis))
    return tube_radius - np.hypot(radial - ring_radius, axial)


def half_space_distance(points: FloatArray, origin: Vector, normal: Vector) -> FloatArray:
    """Everything behind the plane through `origin` whose outward normal is `normal`."""
    return -plane_offset(points, origin, normal)


def _axial(points: FloatArray, base: Vector, top: Vector) -> tuple[FloatArray, FloatArray, float]:
    """Distance from the axis, height above `base` along it, and its length."""
    start = np.asarray(base, dtype=np.float64)
    along = np.asarray(top, dtype=np.float64) - start
    axis = unit_vector(along)
    offset = points - start
    axial = offset @ axis
    across = offset - axial[:, None] * axis
    return np.sqrt(np.einsum("ij,ij->i", across, across)), axial, float(np.linalg.norm(along))


def _box_2d(u: FloatArray, v: FloatArray) -> FloatArray:
    """Distance outside (positive) of the quarter-plane corner u ≤ 0, v ≤ 0."""
    outside = np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0))
    distance: FloatArray = outside + np.minimum(np.maximum(u, v), 0.0)
    return distance
