"""Several bodies as one: union, difference, intersection (method.md 4).

`min` and `max` of distances have the right zero level but are not distances (a union of two 10 mm
discs 12 mm apart gives 4 mm where 8 is right). So outlines are cut from them, and depths are
measured anew to the zero level they share.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.errors import InputError
from lmctl.field.field import Field
from lmctl.field.grid import Grid, Window
from lmctl.field.plane import PlaneGrid, section_loops
from lmctl.field.seeds import seed_triangles
from lmctl.field.sweep import sweep_sources
from lmctl.part.bodies import Body, Stored, without_slivers
from lmctl.part.measured import Bounds

FloatArray = NDArray[np.float64]
Operation = Literal["union", "difference", "intersection"]

#: Planes of a grid evaluated at a time.
SLAB_PLANES = 8


@dataclass(frozen=True)
class Combined(Stored):
    """Bodies made one; a difference takes all others from the first.

    grid : on which the combination's own field is stored; edges are rounded within its pitch
    """

    operation: Operation
    bodies: tuple[Body, ...]
    grid: Grid

    @cached_property
    def bounds_mm(self) -> Bounds:
        """Those of the shared zero level; of a union, exactly those of its bodies."""
        if self.operation == "union":
            bounds = [body.bounds_mm for body in self.bodies]
            return np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)
        corners = self._surface.reshape(-1, 3)
        return corners.min(axis=0), corners.max(axis=0)

    def cut(self, z_mm: float, plane: PlaneGrid) -> NDArray[np.float32]:
        return _combine(self.operation, [body.cut(z_mm, plane) for body in self.bodies])

    def loops(self, z_mm: float, plane: PlaneGrid) -> list[FloatArray]:
        return section_loops(self.cut(z_mm, plane), plane)

    @cached_property
    def field(self) -> Field:
        """The distance to the shared zero level, with the sign of the combination."""
        sources, surface_mm, _ = seed_triangles(self._surface, self.grid)
        values = sweep_sources(sources, surface_mm, self.grid)
        np.copysign(values, self._signs, out=values)
        return Field(self.grid, values, sources, surface_mm)

    @cached_property
    def _signs(self) -> NDArray[np.float32]:
        """min/max of the bodies' distances at every node: right in sign and zero level only."""
        values = np.empty(self.grid.shape, dtype=np.float32)
        for window in self.grid.slabs(SLAB_PLANES):
            values[window.z_first : window.z_last] = self._sign_of(window)
        return values

    def _sign_of(self, window: Window) -> NDArray[np.float32]:
        return _combine(self.operation, [body.distance(window) for body in self.bodies])

    @cached_property
    def _surface(self) -> FloatArray:
        """Triangles of the shared zero level, (m, 3, 3) float64 [mm]."""
        if not (self._signs > 0).any():
            raise InputError(
                f"the {self.operation} of the bodies leaves nothing",
                where=f"at a pitch of {self.grid.pitch_mm:g} mm",
                hint="check where the bodies lie, or give a smaller pitch_mm",
            )
        from skimage.measure import marching_cubes  # takes a second, which few parts need to spend

        corners, triangles, _, _ = marching_cubes(self._signs, 0.0)
        points = corners[:, ::-1] * self.grid.pitch_mm + np.asarray(self.grid.origin_mm)
        return without_slivers(points[triangles].astype(np.float64))


def _combine(
    operation: Operation, values: list[NDArray[np.float32]]
) -> NDArray[np.float32]:
    if operation == "union":
        return reduce(np.maximum, values)
    if operation == "intersection":
        return reduce(np.minimum, values)
    return reduce(np.minimum, [values[0], *(-value for value in values[1:])])
