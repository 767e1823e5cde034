"""Height and slope of a surface over the xy plane: a plane, the upper side of a bar, a grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.plane import PlaneGrid

#: Beyond this part of its radius the side of a bar counts as a wall, of no height.
_WALL = 0.995


class SurfaceHeights(Protocol):
    """A surface with one height at each place (x, y). Lengths in mm, part coordinates."""

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        """z at places (n, 2) -> (n,); continued beyond the surface's edge."""

    def slope(self, places_mm: FloatArray) -> FloatArray:
        """∂z/∂x and ∂z/∂y at places (n, 2) -> (n, 2)."""

    def covers(self, places_mm: FloatArray) -> NDArray[np.bool_]:
        """Whether the surface reaches to places (n, 2) -> (n,)."""


class OffsetHeights(SurfaceHeights, Protocol):
    """A surface whose parallel surfaces are known in closed form."""

    def raised_height_mm(
        self, places_mm: FloatArray, distance_mm: float | FloatArray
    ) -> FloatArray:
        """z of the surface at a distance above it, one or (n,), at places (n, 2) -> (n,)."""

    def raised_slope(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        """∂z/∂x and ∂z/∂y of the surface at a distance above it, (n, 2)."""

    def distance_mm(self, points_mm: FloatArray) -> FloatArray:
        """Distance of points (n, 3) from it, positive above -> (n,)."""

    def stretch(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        """How much the surfaces above it rise along z for a rise in distance, (n,), ≥ 1."""


@dataclass(frozen=True)
class PlaneHeights:
    """A plane through a point, with its unit normal upwards, each (3,)."""

    point_mm: FloatArray
    normal: FloatArray

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        away = places_mm - self.point_mm[:2]
        return np.asarray(self.point_mm[2] - away @ self.normal[:2] / self.normal[2])

    def slope(self, places_mm: FloatArray) -> FloatArray:
        return np.tile(-self.normal[:2] / self.normal[2], (len(places_mm), 1))

    def covers(self, places_mm: FloatArray) -> NDArray[np.bool_]:
        return np.ones(len(places_mm), dtype=np.bool_)

    def raised_height_mm(
        self, places_mm: FloatArray, distance_mm: float | FloatArray
    ) -> FloatArray:
        return np.asarray(self.height_mm(places_mm) + distance_mm / self.normal[2])

    def raised_slope(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        return self.slope(places_mm)

    def distance_mm(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray((points_mm - self.point_mm) @ self.normal)

    def stretch(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        return np.full(len(places_mm), 1.0 / self.normal[2])


@dataclass(frozen=True)
class BarHeights:
    """The upper side of a round bar. point_mm : (3,) of its axis; axis : (2,) its direction, of
    length 1, level"""

    point_mm: FloatArray
    axis: FloatArray
    radius_mm: float

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        return self.raised_height_mm(places_mm, 0.0)

    def slope(self, places_mm: FloatArray) -> FloatArray:
        return self.raised_slope(places_mm, 0.0)

    def covers(self, places_mm: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(np.abs(self._beside_mm(places_mm)) < _WALL * self.radius_mm)

    def raised_height_mm(
        self, places_mm: FloatArray, distance_mm: float | FloatArray
    ) -> FloatArray:
        radius = self.radius_mm + distance_mm
        beside = np.minimum(np.abs(self._beside_mm(places_mm)), _WALL * radius)
        return np.asarray(self.point_mm[2] + np.sqrt(radius**2 - beside**2))

    def raised_slope(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        radius = self.radius_mm + distance_mm
        beside = np.clip(self._beside_mm(places_mm), -_WALL * radius, _WALL * radius)
        falls = -beside / np.sqrt(radius**2 - beside**2)
        return np.asarray(falls[:, None] * self._across)

    def distance_mm(self, points_mm: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(self._beside_mm(points_mm[:, :2]),
                                   points_mm[:, 2] - self.point_mm[2]) - self.radius_mm)

    def stretch(self, places_mm: FloatArray, distance_mm: float) -> FloatArray:
        radius = self.radius_mm + distance_mm
        beside = np.minimum(np.abs(self._beside_mm(places_mm)), _WALL * radius)
        return np.asarray(radius / np.sqrt(radius**2 - beside**2))

    @property
    def _across(self) -> FloatArray:
        return np.array([-self.axis[1], self.axis[0]])

    def _beside_mm(self, places_mm: FloatArray) -> FloatArray:
        """Signed distance from the axis in the xy plane, (n,)."""
        return np.asarray((places_mm - self.point_mm[:2]) @ self._across)


@dataclass(frozen=True, eq=False)
class GridHeights:
    """Heights at the nodes of a grid in the xy plane, bilinear in between.

    values_mm : (ny, nx) float64, a number everywhere; covered : (ny, nx) bool, where measured
    """

    grid: PlaneGrid
    values_mm: FloatArray
    covered: NDArray[np.bool_]

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        j, i, v, u = self._cell(places_mm)
        a, b, c, d = self._corners(j, i)
        return np.asarray((1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d))

    def slope(self, places_mm: FloatArray) -> FloatArray:
        j, i, v, u = self._cell(places_mm)
        a, b, c, d = self._corners(j, i)
        return np.column_stack([(1 - v) * (b - a) + v * (d - c),
                                (1 - u) * (c - a) + u * (d - b)]) / self.grid.pitch_mm

    def covers(self, places_mm: FloatArray) -> NDArray[np.bool_]:
        ny, nx = self.grid.shape
        i, j = (np.rint((places_mm[:, axis] - self.grid.origin_mm[axis]) / self.grid.pitch_mm)
                .astype(np.intp) for axis in (0, 1))
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny)
        return inside & self.covered[np.clip(j, 0, ny - 1), np.clip(i, 0, nx - 1)]

    def nodes_mm(self) -> FloatArray:
        """All nodes as points (ny·nx, 3) float64."""
        y, x = np.meshgrid(self.grid.y_mm, self.grid.x_mm, indexing="ij")
        return np.column_stack([x.ravel(), y.ravel(), self.values_mm.ravel()])

    def _cell(
        self, places_mm: FloatArray
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], FloatArray, FloatArray]:
        """Row and column of each place's cell, and how far across it the place is, 0 to 1."""
        ny, nx = self.grid.shape
        u = np.clip((places_mm[:, 0] - self.grid.origin_mm[0]) / self.grid.pitch_mm, 0, nx - 1)
        v = np.clip((places_mm[:, 1] - self.grid.origin_mm[1]) / self.grid.pitch_mm, 0, ny - 1)
        i, j = np.minimum(u.astype(np.intp), nx - 2), np.minimum(v.astype(np.intp), ny - 2)
        return j, i, v - j, u - i

    def _corners(
        self, j: NDArray[np.intp], i: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        values = self.values_mm
        return values[j, i], values[j, i + 1], values[j + 1, i], values[j + 1, i + 1]
