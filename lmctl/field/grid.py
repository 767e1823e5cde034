"""Uniform grids and windows of them; the one module that converts between node and point order.

Values live at *nodes*, arrays are [z, y, x] and C-ordered, points are (n, 3) columns x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray


@dataclass(frozen=True)
class Grid:
    """A uniform grid of nodes.

    origin_mm : (x, y, z) of node [0, 0, 0]
    pitch_mm : distance of neighbouring nodes, the same along all axes, > 0
    shape : (nz, ny, nx), number of nodes
    """

    origin_mm: tuple[float, float, float]
    pitch_mm: float
    shape: tuple[int, int, int]

    @staticmethod
    def enclosing(
        low_mm: FloatArray, high_mm: FloatArray, pitch_mm: float, padding_nodes: int = 3
    ) -> Grid:
        """The grid that holds the box [low, high] with `padding_nodes` nodes to spare each side.

        Nodes lie on multiples of the pitch, so grids of one pitch share their nodes.
        """
        first = np.floor(np.asarray(low_mm) / pitch_mm).astype(int) - padding_nodes
        last = np.ceil(np.asarray(high_mm) / pitch_mm).astype(int) + padding_nodes
        nx, ny, nz = (int(n) for n in last - first + 1)
        x, y, z = (float(v) for v in first * pitch_mm)
        return Grid((x, y, z), float(pitch_mm), (nz, ny, nx))

    @property
    def n_nodes(self) -> int:
        nz, ny, nx = self.shape
        return nz * ny * nx

    def axis_mm(self, axis: int) -> FloatArray:
        """Coordinates along x (0), y (1) or z (2). shape (n,) float64 [mm]."""
        steps = np.arange(self.shape[2 - axis], dtype=np.float64)
        return np.asarray(self.origin_mm[axis] + self.pitch_mm * steps, dtype=np.float64)

    def window(self, z_first: int = 0, z_last: int | None = None) -> Window:
        """The slab of planes z_first … z_last − 1 (all planes by default)."""
        return Window(self, z_first, self.shape[0] if z_last is None else z_last)

    def slabs(self, planes: int) -> list[Window]:
        """The grid as consecutive windows of at most `planes` planes."""
        nz = self.shape[0]
        return [self.window(z, min(z + planes, nz)) for z in range(0, nz, planes)]


@dataclass(frozen=True)
class Window:
    """A slab of planes z_first ≤ z < z_last of a grid; contiguous in memory."""

    grid: Grid
    z_first: int
    z_last: int

    @property
    def shape(self) -> tuple[int, int, int]:
        return (self.z_last - self.z_first, *self.grid.shape[1:])

    def node_points(self) -> FloatArray:
        """Its nodes as points, (nz·ny·nx, 3) float64 [mm], in the arrays' own order."""
        z = self.grid.axis_mm(2)[self.z_first : self.z_last]
        zz, yy, xx = np.meshgrid(z, self.grid.axis_mm(1), self.grid.axis_mm(0), indexing="ij")
        return np.stack([xx.ravel(), yy.ravel(), zz.ravel()], axis=1)
