"""One section on a raster of its own: depth and nearest edge of the outline at every node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.outline_distance import nearest_segments
from lmctl.field.plane import PlaneGrid

#: Nodes a bead and a pitch: two tracks 0.7 pitches apart are then more than three nodes apart.
NODES_PER_BEAD = 8
NODES_PER_PITCH = 5
#: Nodes outside the box of the outline, each side.
_PADDING = 3
#: Where the raster begins, in nodes: no multiple of a simple fraction, so that the middles of
#: shapes drawn on round numbers do not run along rows of nodes.
_OFFSET = (0.381966, 0.276393)


@dataclass(frozen=True)
class SectionRaster:
    """Depth below an outline, and where the outline is nearest.

    grid : of the nodes
    depth_mm : (ny, nx) float32, distance to the outline, positive inside; well outside it stays at
        −1.5 node distances
    segments : (m, 4) float64, x0 y0 x1 y1 of the outline's edges from the grid's origin [mm]
    ends : (m, 2) int64, first and last segment of each one's loop
    nearest : (ny, nx) int32, row of `segments` nearest to each node, −1 well outside
    """

    grid: PlaneGrid
    depth_mm: NDArray[np.float32]
    segments: FloatArray
    ends: NDArray[np.int64]
    nearest: NDArray[np.int32]


def raster_pitch_mm(bead_mm: float, pitch_mm: float) -> float:
    """Node distance of the raster on which tracks of such a bead and pitch are planned."""
    return min(bead_mm / NODES_PER_BEAD, pitch_mm / NODES_PER_PITCH)


def section_raster(loops: Sequence[FloatArray], node_mm: float) -> SectionRaster:
    """The raster around closed loops (k, 2) [mm]; there has to be one at least."""
    points = np.vstack(loops)
    low, high = points.min(axis=0), points.max(axis=0)
    origin = low - (_PADDING - np.array(_OFFSET)) * node_mm
    nx, ny = (np.ceil((high - origin) / node_mm).astype(int) + _PADDING).tolist()
    grid = PlaneGrid((float(origin[0]), float(origin[1])), node_mm, (ny, nx))
    return SectionRaster(grid, *nearest_segments(loops, grid, inside_only=True))
