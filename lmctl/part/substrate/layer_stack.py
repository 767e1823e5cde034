"""Layers over a substrate that is not level: where each lies, and how thick it is at each place.

A *level* coordinate u counts layers: 0 on the substrate, k layer heights on top of layer k.
Planning works in (x, y, u), where layers are flat; this module maps u to height z and back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.part.substrate.surface_heights import OffsetHeights, SurfaceHeights

#: How layers lie over the substrate, once "auto" is decided.
FollowedShape = Literal["level", "shifted", "parallel", "blended"]


@dataclass(frozen=True, eq=False)
class LayerStack:
    """The layers of one part over its substrate; part coordinates, mm.

    shape : "level" at one height; "shifted": the substrate, raised; "parallel": at a distance from
        it; "blended": from the substrate to a level top
    base_mm : of level layers, the height of u = 0
    top_mm, depth_mm : of blended layers, the height of the level top, and its u
    region_mm : (k, 2) places under the part, half a bead apart or farther
    around_mm : (q, 3) points of the surface under and around the part, where that is measured
    """

    heights: SurfaceHeights
    shape: FollowedShape
    region_mm: FloatArray
    around_mm: FloatArray
    base_mm: float = 0.0
    top_mm: float = 0.0
    depth_mm: float = 1.0

    def height_mm(self, places_mm: FloatArray, level_mm: float | FloatArray) -> FloatArray:
        """z at places (n, 2) of level u, one or (n,) -> (n,)."""
        if self.shape == "level":
            return self.base_mm + np.broadcast_to(level_mm, len(places_mm)).astype(np.float64)
        if self.shape == "parallel":
            return cast(OffsetHeights, self.heights).raised_height_mm(places_mm, level_mm)
        bottom = self.heights.height_mm(places_mm)
        if self.shape == "shifted":
            return np.asarray(bottom + level_mm)
        return np.asarray(bottom + level_mm * (self.top_mm - bottom) / self.depth_mm)

    def level_mm(self, points_mm: FloatArray) -> FloatArray:
        """u of points (n, 3) -> (n,)."""
        if self.shape == "level":
            return np.asarray(points_mm[:, 2] - self.base_mm)
        if self.shape == "parallel":
            return cast(OffsetHeights, self.heights).distance_mm(points_mm)
        bottom = self.heights.height_mm(points_mm[:, :2])
        above = points_mm[:, 2] - bottom
        if self.shape == "shifted":
            return np.asarray(above)
        return np.asarray(above * self.depth_mm / (self.top_mm - bottom))

    def slope(self, places_mm: FloatArray, level_mm: float) -> FloatArray:
        """∂z/∂x and ∂z/∂y of the layer at level u, (n, 2)."""
        if self.shape == "level":
            return np.zeros((len(places_mm), 2))
        if self.shape == "parallel":
            return cast(OffsetHeights, self.heights).raised_slope(places_mm, level_mm)
        slope = self.heights.slope(places_mm)
        return slope if self.shape == "shifted" else slope * (1 - level_mm / self.depth_mm)

    def stretch(self, places_mm: FloatArray, level_mm: float) -> FloatArray:
        """Height of a layer at level u along z over the layer height, (n,)."""
        if self.shape in ("level", "shifted"):
            return np.ones(len(places_mm))
        if self.shape == "parallel":
            return cast(OffsetHeights, self.heights).stretch(places_mm, level_mm)
        return np.asarray((self.top_mm - self.heights.height_mm(places_mm)) / self.depth_mm)

    def points_mm(self, points_mm: FloatArray) -> FloatArray:
        """Points (x, y, u) as points (x, y, z), (n, 3)."""
        points = np.array(points_mm, dtype=np.float64)
        points[:, 2] = self.height_mm(points[:, :2], points[:, 2])
        return points

    def lowest_mm(self, level_mm: float) -> float:
        """Lowest z of a level under the part."""
        return float(self.height_mm(self.region_mm, level_mm).min())

    def highest_mm(self, level_mm: float) -> float:
        """Highest z of a level under the part."""
        return float(self.height_mm(self.region_mm, level_mm).max())

    def highest_around_mm(self, level_mm: float) -> float:
        """Highest z of a level under the part, or of the surface around it."""
        around = self.around_mm[:, 2].max() if len(self.around_mm) else -np.inf
        return max(self.highest_mm(level_mm), float(around))

    def steepest_slope(self, level_mm: float) -> float:
        """Steepest rise over run of a level under the part."""
        return float(np.linalg.norm(self.slope(self.region_mm, level_mm), axis=1).max())

    def is_level(self) -> bool:
        return self.shape == "level"
