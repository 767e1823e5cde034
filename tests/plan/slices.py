"""Geometry of a layer whose slice is a shapely polygon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.geometry import LayerGeometry, layer_geometry
from lmctl.preflight.placement import place_part

BEAD = 2.0
PITCH = BEAD * (1 - 0.333)


def loops_of(poly) -> list[np.ndarray]:
    """Closed loops of a polygon: outlines counter-clockwise, holes clockwise."""
    loops = []
    for piece in shapely.get_parts(poly):
        oriented = shapely.orient_polygons(piece)
        loops += [np.array(ring.coords) for ring in (oriented.exterior, *oriented.interiors)]
    return loops


def geometry_maker(make_part, profile, height_mm: float) -> Callable[..., LayerGeometry]:
    """A function from polygon, mixture, layer and keys of [process] to the layer's geometry."""

    def make(poly, mixture=lambda p: 0.5, layer=0, **process) -> LayerGeometry:
        part = make_part(loops_of(poly), mixture, height_mm=height_mm,
                         process=ProcessSettings(**process))
        return layer_geometry(part, place_part(part, profile), layer)

    return make
