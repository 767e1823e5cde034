"""Features a material is graded from: geometry that distance is measured to.

Source: docs/explanation/multi-colour-distance-field.md, Material field.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.features import (
    axis_distance,
    plane_offset,
    point_distance,
    segment_distance,
)
from lmctl.field.kernel import kernel
from lmctl.field.triangles import closest_points_on_rows
from lmctl.part.bodies.body import Body
from lmctl.part.bodies.surfaces import Vector

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

#: Straight pieces that approximate each span of a spline; off by less than 1e-4 of its length.
PIECES_PER_SPAN = 64

#: Triangles are cut until none is longer than this share of the surface's size.
MAX_EDGE_FRACTION = 0.02
MAX_PIECES = 2_000_000
NEIGHBOURS = 12


class Feature(Protocol):
    """Geometry that distance is measured to."""

    def distance(self, points: FloatArray) -> FloatArray:
        """points (n, 3) [mm] -> (n,) float64 [mm]"""


@dataclass(frozen=True)
class PointDistance:
    """Distance to a point."""

    at_mm: Vector

    def distance(self, points: FloatArray) -> FloatArray:
        return point_distance(points, self.at_mm)


@dataclass(frozen=True)
class SegmentDistance:
    """Distance to a straight line between two points."""

    start_mm: Vector
    end_mm: Vector

    def distance(self, points: FloatArray) -> FloatArray:
        return segment_distance(points, self.start_mm, self.end_mm)


@dataclass(frozen=True)
class AxisDistance:
    """Distance to an infinite line; direction of any length but 0."""

    point_mm: Vector
    direction: Vector

    def distance(self, points: FloatArray) -> FloatArray:
        return axis_distance(points, self.point_mm, self.direction)


@dataclass(frozen=True, eq=False)
class PolylineDistance:
    """Distance to straight lines through points; vertices_mm : (m, 3) float64, m ≥ 2"""

    vertices_mm: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        return _polyline_kernel(np.ascontiguousarray(points), self.vertices_mm)


@dataclass(frozen=True)
class PlaneDistance:
    """Distance to a plane, on either side; normal of any length but 0."""

    point_mm: Vector
    normal: Vector

    def distance(self, points: FloatArray) -> FloatArray:
        return np.abs(plane_offset(points, self.point_mm, self.normal))


@dataclass(frozen=True)
class DepthBelowSurface:
    """Depth below a body's surface, or below an iso-contour of its distance.

    Source: Zhou et al. 2009, Eq. (1).
    """

    body: Body
    level_mm: float = 0.0

    def distance(self, points: FloatArray) -> FloatArray:
        return self.body.distance_at(points) - self.level_mm


@dataclass(frozen=True)
class CoordinateValue:
    """x (0), y (1) or z (2) itself, with its sign."""

    axis: int

    def distance(self, points: FloatArray) -> FloatArray:
        return np.asarray(points[:, self.axis], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class TriangleSheetDistance:
    """Distance to triangles, which need not close or agree on a side.

    corners_mm : (m, 3, 3) float64, m ≥ 1
    """

    corners_mm: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        """Exact: pieces are searched in order of their middles until none can be nearer."""
        points = np.ascontiguousarray(points)
        distance = np.empty(len(points))
        rows, count = np.arange(len(points)), min(NEIGHBOURS, len(self._pieces))
        while len(rows):
            middles, pieces = self._tree.query(points[rows], k=[*range(1, count + 1)])
            best = np.full(len(rows), np.inf)
            for column in range(count):
                found = closest_points_on_rows(
                    self._pieces, pieces[:, column].astype(np.int32), points[rows])
                best = np.minimum(best, np.linalg.norm(found - points[rows], axis=1))
            distance[rows] = best
            if count == len(self._pieces):
                break
            rows = rows[middles[:, -1] < best + self._reach]
            count = min(4 * count, len(self._pieces))
        return distance

    @cached_property
    def _pieces(self) -> FloatArray:
        """The triangles, long ones halved until their middles represent their location."""
        pieces = self.corners_mm
        size = float(np.ptp(pieces.reshape(-1, 3), axis=0).max())
        while len(pieces) < MAX_PIECES:
            edges = np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2)
            long = edges.max(axis=1) > MAX_EDGE_FRACTION * size
            if not long.any():
                break
            cut, first = pieces[long], edges[long].argmax(axis=1)
            rows = np.arange(len(cut))
            a, b, c = (cut[rows, (first + k) % 3] for k in range(3))
            middle = 0.5 * (a + b)
            halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
            pieces = np.concatenate([pieces[~long], *halves])
        return np.ascontiguousarray(pieces)

    @cached_property
    def _reach(self) -> float:
        """How far a piece reaches from its middle at most [mm]."""
        away = self._pieces - self._pieces.mean(axis=1, keepdims=True)
        return float(np.linalg.norm(away, axis=2).max())

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # late: few features need it

        return cKDTree(self._pieces.mean(axis=1))


def spline_polyline(points_mm: FloatArray) -> PolylineDistance:
    """The natural cubic spline through points (m, 3), by chord length, as fine straight pieces."""
    if len(points_mm) == 2:
        return PolylineDistance(points_mm)
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points_mm, axis=0), axis=1))])
    from scipy.interpolate import CubicSpline  # late: few features need it

    curve = CubicSpline(chords, points_mm, bc_type="natural")
    shares = np.linspace(0.0, 1.0, PIECES_PER_SPAN, endpoint=False)
    at = (chords[:-1, None] + shares * np.diff(chords)[:, None]).ravel()
    return PolylineDistance(np.ascontiguousarray(curve(np.append(at, chords[-1]))))


@kernel
def _polyline_kernel(points: FloatArray, vertices: FloatArray) -> FloatArray:
    result = np.empty(len(points))
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        least = np.inf
        for e in range(len(vertices) - 1):
            ax, ay, az = vertices[e, 0], vertices[e, 1], vertices[e, 2]
            ux, uy, uz = vertices[e + 1, 0] - ax, vertices[e + 1, 1] - ay, vertices[e + 1, 2] - az
            wx, wy, wz = x - ax, y - ay, z - az
            t = (wx * ux + wy * uy + wz * uz) / (ux * ux + uy * uy + uz * uz)
            t = min(1.0, max(0.0, t))
            d2 = (wx - t * ux) ** 2 + (wy - t * uy) ** 2 + (wz - t * uz) ** 2
            least = min(least, d2)
        result[n] = np.sqrt(least)
    return result
