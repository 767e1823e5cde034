"""What bodies computed where and when they are asked for share: `at` gives all the rest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lmctl.field.grid import Window
from lmctl.field.plane import PlaneGrid, section_loops
from lmctl.part.bodies.body import plane_points
from lmctl.part.bodies.depth import greatest
from lmctl.part.bodies.measured import Bounds
from lmctl.part.bodies.surfaces import Surface

FloatArray = NDArray[np.float64]

#: Nodes evaluated at a time: keeps temporaries in tens of megabytes.
NODES_AT_ONCE = 250_000


class Analytic(ABC):
    """A body whose `at` is exact, or as good as what it is made of."""

    @property
    @abstractmethod
    def bounds_mm(self) -> Bounds:
        """As `Body` has it."""

    @abstractmethod
    def at(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    @abstractmethod
    def inward(self, points: FloatArray) -> FloatArray:
        """As `Body` has it."""

    @property
    def box_mm(self) -> Bounds:
        return self.bounds_mm

    @property
    def key(self) -> Hashable:
        return self

    @property
    def slack_mm(self) -> float:
        return 0.0

    @property
    def one_foot(self) -> bool:
        return False

    @property
    def exact_bound(self) -> bool:
        return True

    @property
    def surfaces(self) -> tuple[tuple[Surface, int], ...]:
        return ((self, 1),)

    @property
    def rest(self) -> Surface | None:
        return None

    def bound(self, points: FloatArray) -> FloatArray:
        return self.at(points)

    @cached_property
    def largest_depth_mm(self) -> float:
        return greatest(self.at, *self.bounds_mm)

    def feet(self, points: FloatArray) -> FloatArray:
        return points - self.at(points)[:, None] * self.inward(points)

    def distance(self, window: Window) -> NDArray[np.float32]:
        values = np.empty(window.shape, dtype=np.float32)
        flat = values.reshape(-1)
        for first, points in chunks(window):
            flat[first : first + len(points)] = self.at(points)
        return values

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return self.at(plane_points(plane, z_mm)).astype(np.float32).reshape(plane.shape)

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return section_loops(self.cut(z_mm, plane), plane)


def chunks(window: Window) -> Iterator[tuple[int, FloatArray]]:
    """A window's nodes in the array's own order, a bounded number at a time.

    Yields the number of the first and the points (n, 3) float64 [mm].
    """
    grid = window.grid
    x, y = grid.axis_mm(0), grid.axis_mm(1)
    z = grid.axis_mm(2)[window.z_first : window.z_last]
    rows = max(1, NODES_AT_ONCE // len(x))
    for first in range(0, len(z) * len(y), rows):
        k, j = np.divmod(np.arange(first, min(first + rows, len(z) * len(y))), len(y))
        points = np.empty((len(k), len(x), 3))
        points[:, :, 0] = x
        points[:, :, 1] = y[j, None]
        points[:, :, 2] = z[k, None]
        yield first * len(x), points.reshape(-1, 3)
