"""The true shape of a plate that is not flat: heights on a grid, as a bench file states them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_protocol.table_reader import TableReader
from simulators.array_types import FloatArray


@dataclass(frozen=True)
class SubstrateHeights:
    """Heights over `substrate_z_mm` at nodes of a grid in machine coordinates, bilinear between.

    x_mm, y_mm : of the first node; pitch_mm : between nodes; rows_mm : one row along x for each y;
        beyond the grid the height at its edge holds
    """

    x_mm: float
    y_mm: float
    pitch_mm: float
    rows_mm: tuple[tuple[float, ...], ...]

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        """At places (n, 2) -> (n,)."""
        heights = np.array(self.rows_mm)
        ny, nx = heights.shape
        u = np.clip((places_mm[:, 0] - self.x_mm) / self.pitch_mm, 0, nx - 1)
        v = np.clip((places_mm[:, 1] - self.y_mm) / self.pitch_mm, 0, ny - 1)
        i, j = np.minimum(u.astype(int), nx - 2), np.minimum(v.astype(int), ny - 2)
        u, v = u - i, v - j
        near = (1 - u) * heights[j, i] + u * heights[j, i + 1]
        far = (1 - u) * heights[j + 1, i] + u * heights[j + 1, i + 1]
        return np.asarray((1 - v) * near + v * far)

    def highest_mm(self) -> float:
        return max(max(row) for row in self.rows_mm)


def read_substrate_heights(table: TableReader) -> SubstrateHeights:
    """The table [process.substrate_heights]; mistakes are reported to the table."""
    heights = SubstrateHeights(
        table.number("x_mm"), table.number("y_mm"), table.number("pitch_mm", above=0, most=100),
        table.number_rows("rows_mm", least=0.0))
    table.report_unknown_keys()
    return heights
