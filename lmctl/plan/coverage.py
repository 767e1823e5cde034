"""How much of a slice its tracks cover, and how much of it hangs over the slice below.

Areas are the outline's own; nodes of the grid only say which part of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lmctl.field.plane import loop_area_mm2
from lmctl.plan.plane_values import plane_values
from lmctl.plan.polyline import densified
from lmctl.plan.tracks import Section, Track

FloatArray = NDArray[np.float64]


def covered_area_mm2(section: Section, tracks: list[Track], bead_mm: float) -> tuple[float, float]:
    """(covered area, whole area) of a slice [mm²]."""
    grid = section.grid
    area_mm2 = slice_area_mm2(section)
    j, i = np.nonzero(section.distance > 0)
    if not tracks or len(i) == 0:
        return 0.0, area_mm2
    nodes = np.stack([grid.x_mm[i], grid.y_mm[j]], axis=1)
    step = bead_mm / 10
    laid = np.vstack([densified(track.points, step) for track in tracks])
    reach = np.hypot(bead_mm / 2, step / 2)
    gap, _ = cKDTree(laid).query(nodes, distance_upper_bound=reach)
    return float(np.isfinite(gap).mean()) * area_mm2, area_mm2


def slice_area_mm2(section: Section) -> float:
    """Area within the outline of a slice [mm²]: holes run the other way round."""
    return max(0.0, sum(loop_area_mm2(loop) for loop in section.loops))


def overhang_area_mm2(section: Section, below: Section | None, lean_mm: float) -> float:
    """Area of a slice farther than `lean_mm` outside the one below it [mm²]; 0 on the platform.

    lean_mm : layer height · tan of the steepest lean that needs no support
    """
    inside = section.distance > 0
    if below is None or not inside.any():
        return 0.0
    grid = section.grid
    if below.grid == grid:
        outside = below.distance[inside] < -lean_mm
    else:
        j, i = np.nonzero(inside)
        nodes = np.stack([grid.x_mm[i], grid.y_mm[j]], axis=1)
        outside = plane_values(below.distance, below.grid, nodes) < -lean_mm
    return float(outside.mean()) * slice_area_mm2(section)
