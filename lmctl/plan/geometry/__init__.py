"""Geometry stage: one layer of a part to flat arrays of tracks; pure, so layers run in parallel.

`layer_geometry` makes a `LayerGeometry` from (part, placement, layer) alone. Nothing here depends
on the machine, time or order.
"""

from lmctl.plan.geometry.layer_geometry import (
    IslandFigures,
    LayerFigures,
    LayerGeometry,
    LostFeature,
    OverhangPlace,
)
from lmctl.plan.geometry.stage import layer_geometry

__all__ = [
    "IslandFigures", "LayerFigures", "LayerGeometry", "LostFeature", "OverhangPlace",
    "layer_geometry",
]
