"""Smooth surfaces that bodies are bounded by: planes, balls, mantles, and these shifted or carried.

A body's edges and corners are where several of its surfaces meet. So the search for the nearest
place on an edge uses two surfaces at once, each with its own exact direction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.features import unit_vector
from lmctl.part.bodies.intersection_steps import step_along

Vector = tuple[float, float, float]

#: Surfaces that may meet at one point: a crease has two, a corner three.
MAX_ACTIVE = 3

#: Steps of a search at most, and the last of them, which lead to the surfaces the shortest way.
MAX_STEPS = 16
FINAL_STEPS = 2

#: Steps after which a search that leads away is given up.
MAX_DIVERGING_STEPS = 1

#: A point counts as on an exact surface within this share of the pitch.
ON_SURFACE_PITCHES = 1e-5


class Surface(Protocol):
    """A smooth surface with a signed distance that is exact near it."""

    @property
    def surface_tolerance_mm(self) -> float:
        """How far from zero its distance may be on it [mm]; 0 where it is exact."""

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        """Whether the way down the slope leads to its nearest point from everywhere."""

    def distance_at(self, points: FloatArray) -> FloatArray:
        """Signed distance at points (n, 3) -> (n,) [mm]"""

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """The direction in which it grows, (n, 3) -> (n, 3) of length 1."""


@dataclass(frozen=True)
class LateralSurface:
    """The endless round wall of a bar that may taper: positive towards its axis.

    base_mm, axis : where it has base_radius_mm, and the direction (of length 1) in which its
        radius grows by `slope` per mm
    """

    base_mm: Vector
    axis: Vector
    base_radius_mm: float
    slope: float

    surface_tolerance_mm = 0.0
    gradient_leads_to_closest_point = True

    def distance_at(self, points: FloatArray) -> FloatArray:
        radial, axial, _ = axis_coordinates(points, self.base_mm, self.axis)
        share = 1.0 / np.hypot(1.0, self.slope)
        return np.asarray(share * (self.base_radius_mm + self.slope * axial - radial))

    def inward_directions(self, points: FloatArray) -> FloatArray:
        _, _, outward = axis_coordinates(points, self.base_mm, self.axis)
        share = 1.0 / np.hypot(1.0, self.slope)
        return np.asarray(share * (self.slope * np.array(self.axis) - outward))


@dataclass(frozen=True)
class OffsetSurface:
    """A surface moved along its own direction by a level [mm]."""

    surface: Surface
    level_mm: float

    @property
    def surface_tolerance_mm(self) -> float:
        return self.surface.surface_tolerance_mm

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        return self.surface.gradient_leads_to_closest_point

    def distance_at(self, points: FloatArray) -> FloatArray:
        return self.surface.distance_at(points) - self.level_mm

    def inward_directions(self, points: FloatArray) -> FloatArray:
        return self.surface.inward_directions(points)


@dataclass(frozen=True, eq=False)
class SurfaceSet:
    """All the surfaces that a search runs over.

    pitch_mm : to which tolerances are related
    """

    surfaces: tuple[Surface, ...]
    pitch_mm: float

    @cached_property
    def surface_tolerance_mm(self) -> FloatArray:
        """How near to zero each has to be at a point on it, (n,) [mm]."""
        least = ON_SURFACE_PITCHES * self.pitch_mm
        return np.array([max(surface.surface_tolerance_mm, least) for surface in self.surfaces])

    @cached_property
    def gradient_leads_to_closest_point(self) -> NDArray[np.bool_]:
        return np.array([surface.gradient_leads_to_closest_point for surface in self.surfaces],
                        dtype=bool)

    def distances_to(self, points: FloatArray, which: IntArray) -> FloatArray:
        """From one surface each, unsigned; (n,) numbers, −1 for none, which is 0 away."""
        value, _ = self._active(points, which[:, None], inwards=False)
        return np.abs(value[:, 0])

    def closest_points(
        self, points: FloatArray, start: FloatArray, active: IntArray, within_mm: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The point nearest to each of `points` at which all its active surfaces meet.

        start : (n, 3) [mm], where to begin; active : (n, MOST_ACTIVE) numbers, −1 for none
        within_mm : (n,), how far away it may be
        returns : (n, 3) [mm] and whether each was found
        """
        direct = (active[:, 1] < 0) & self.gradient_leads_to_closest_point[active[:, 0]]
        at, found = start.copy(), np.zeros(len(points), dtype=bool)
        for rows, search in ((np.flatnonzero(direct), self._closest_by_slope),
                             (np.flatnonzero(~direct), self._settle)):
            if len(rows):
                at[rows], found[rows] = search(
                    points[rows], start[rows], active[rows], within_mm[rows])
        found &= np.linalg.norm(at - points, axis=1) < within_mm
        return at, found

    def _closest_by_slope(
        self, points: FloatArray, _start: FloatArray, active: IntArray, _within_mm: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Straight down the slope of one surface each; and whether that leads to it."""
        which = active[:, 0]
        value, inward = self._active(points, which[:, None])
        closest = points - value * inward[:, 0]
        found: NDArray[np.bool_] = self.distances_to(closest,
                                                     which) <= self.surface_tolerance_mm[which]
        return closest, found

    def _settle(
        self, points: FloatArray, start: FloatArray, active: IntArray, within_mm: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Along the surfaces towards each point, and straight back onto them, in turns.

        The step length follows from how the remaining way changed in the step before (Barzilai
        and Borwein, doi:10.1093/imanum/8.1.141): surfaces that bend away from a far point need
        short steps. A search that leads far away is given up.
        """
        at, rows = start.copy(), np.arange(len(points))
        before = np.zeros((len(points), 2, 3))
        for number in range(MAX_STEPS):
            value, inward = self._active(at[rows], active[rows])
            last = number >= MAX_STEPS - FINAL_STEPS
            is_moving = step_along(
                rows, points, at, value, inward, before, self.pitch_mm, number == 0, last)
            if number >= MAX_DIVERGING_STEPS:
                is_moving &= np.linalg.norm(at[rows] - points[rows], axis=1) < 2.0 * within_mm[rows]
            rows = rows[is_moving]
            if len(rows) == 0:
                break
        value, _ = self._active(at, active, inwards=False)
        slack = np.where(active >= 0, self.surface_tolerance_mm[active], np.inf)
        return at, np.all(np.abs(value) <= slack, axis=1)

    def _active(
        self, points: FloatArray, active: IntArray, *, inwards: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Distances (n, m) and directions inwards (n, m, 3) of the active surfaces (n, m)."""
        value = np.zeros(active.shape)
        inward = np.zeros((*active.shape, 3))
        for number, places in places_by_number(active.ravel()):
            row, slot = np.divmod(places, active.shape[1])
            at = points[row]
            value[row, slot] = self.surfaces[number].distance_at(at)
            if inwards:
                inward[row, slot] = self.surfaces[number].inward_directions(at)
        return value, inward


def places_by_number(numbers: IntArray) -> Iterator[tuple[int, IntArray]]:
    """Each number ≥ 0 of (n,) once, and the places where it is."""
    order = np.argsort(numbers, kind="stable")
    found, first = np.unique(numbers[order], return_index=True)
    ends = [*first[1:], len(order)]
    for number, start, end in zip(found, first, ends, strict=False):
        if number >= 0:
            yield int(number), order[start:end]


def axis_coordinates(
    points: FloatArray, base: Vector, axis: Vector
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Distance from an axis (n,), height along it (n,), and the way out from it (n, 3).

    axis : of length 1; on it any way out is as good
    """
    along = np.asarray(axis)
    offset = points - np.asarray(base)
    axial = offset @ along
    across = offset - axial[:, None] * along
    radial = np.sqrt(np.einsum("ij,ij->i", across, across))
    clear = radial > 1e-12
    outward = across / np.where(clear, radial, 1.0)[:, None]
    if not clear.all():
        aside = np.eye(3)[int(np.argmin(np.abs(along)))]
        outward[~clear] = unit_vector(np.cross(along, aside))
    return radial, axial, outward
