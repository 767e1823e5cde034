"""The nodes of a part's tree: each answers how deep a place is, and where its outline runs.

This module holds the interface of a body and the defaults that most bodies share. Bodies with a
stored field are in `stored`, those with a formula in `formulas` and `prism`, those made of others
in `combined`, `offset` and `moved`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

if TYPE_CHECKING:
    from lmctl.field.grid import Window
    from lmctl.field.plane import PlaneGrid
    from lmctl.part.bodies.measured import Bounds
    from lmctl.part.bodies.surfaces import Surface


class Body(Protocol):
    """A node. Distances are signed, positive inside, true distances everywhere [mm]."""

    @property
    def tight_bounds_mm(self) -> Bounds:
        """Lowest and highest x, y, z of the solid, each (3,) float64 [mm]; may be infinite."""

    def support_mm(self, direction: FloatArray) -> float:
        """How far it reaches from the origin along a direction (3,) of length 1, at most [mm]."""

    @property
    def enclosing_box_mm(self) -> Bounds:
        """A box that holds it, found without a search for its surface; may be infinite."""

    @property
    def identity_key(self) -> Hashable:
        """Equal for bodies that are known to be the same."""

    @property
    def surface_tolerance_mm(self) -> float:
        """How far from zero its distance may be at its surface [mm]; 0 where that is exact."""

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        """Whether the way down the slope leads to its nearest point from everywhere, and it is
        smooth."""

    @property
    def distance_bound_is_exact(self) -> bool:
        """Whether `bound` is the distance already."""

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        """Smooth surfaces that hold its own; each with 1 where the body is on its positive side,
        else −1."""

    @property
    def remaining_surface(self) -> Surface | None:
        """The surface that covers what `surfaces` leaves out; None if that is nothing."""

    @property
    def maximum_depth_mm(self) -> float:
        """The greatest distance from the surface inside, refined between stored nodes."""

    def distance_at(self, points: FloatArray) -> FloatArray:
        """Distance at points (n, 3) float64 -> (n,) float64 [mm]."""

    def distance_bound(self, points: FloatArray) -> FloatArray:
        """A cheap distance of the right sign and at most the true size; zero on the same surface,
        and changing by at most 1 mm per mm."""

    def closest_points(self, points: FloatArray) -> FloatArray:
        """The surface point nearest to each of points (n, 3) -> (n, 3) float64 [mm]."""

    def inward_directions(self, points: FloatArray) -> FloatArray:
        """The direction in which the distance grows, (n, 3) -> (n, 3) float64 of length 1."""

    def distance(self, window: Window) -> NDArray[np.float32]:
        """Distance at the nodes of a slab, float32 of window.shape [mm]."""

    def section_values(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        """(ny, nx) float32, positive inside, zero on the outline; a distance only near it."""

    def outline_loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        """The outline at height z: closed loops (k, 2) float64 [mm], the inside on the left."""


class BodyDefaults(ABC):
    """Defaults that most bodies share."""

    @property
    @abstractmethod
    def tight_bounds_mm(self) -> Bounds:
        """As `Body` has it."""

    @property
    @abstractmethod
    def surface_tolerance_mm(self) -> float:
        """As `Body` has it."""

    @abstractmethod
    def distance_at(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    @abstractmethod
    def inward_directions(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    def support_mm(self, direction: FloatArray) -> float:
        low, high = self.tight_bounds_mm
        return float(np.maximum(low * direction, high * direction).sum())

    @property
    def enclosing_box_mm(self) -> Bounds:
        return self.tight_bounds_mm

    @property
    def identity_key(self) -> Hashable:
        return self

    @property
    def gradient_leads_to_closest_point(self) -> bool:
        return False

    @property
    def distance_bound_is_exact(self) -> bool:
        return True

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return ((self, 1),)

    @property
    def remaining_surface(self) -> Surface | None:
        return None

    def distance_bound(self, points: FloatArray) -> FloatArray:
        return self.distance_at(points)


def plane_points(plane: PlaneGrid, z_mm: float) -> FloatArray:
    """The nodes of a plane as points (ny·nx, 3) float64 [mm], in the array's own order."""
    yy, xx = np.meshgrid(plane.y_mm, plane.x_mm, indexing="ij")
    return np.stack([xx.ravel(), yy.ravel(), np.full(xx.size, float(z_mm))], axis=1)


def empty_section(plane: PlaneGrid) -> NDArray[np.float32]:
    """The cut of a plane that misses the body: −inf at every node."""
    return np.full(plane.shape, -np.inf, dtype=np.float32)
