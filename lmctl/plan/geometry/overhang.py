"""Find where a slice overhangs the slice below it, and how steeply."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.outline_distance import distance_outside
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.layer_geometry import OverhangPlace
from lmctl.plan.geometry.raster_pieces import connected_pieces, nodes_of_pieces
from lmctl.plan.geometry.section_raster import SectionRaster

#: From this lean on, from the vertical, overhang is reported [degrees].
WARNED_OVERHANG_DEG = 30.0
#: Smaller places are left out: a square of this part of a bead.
_LEAST_BEADS = 0.25
#: The most places that one layer lists, the largest of them.
_MOST_PLACES = 20


def overhang_places(
    loops: Sequence[FloatArray], below: Sequence[FloatArray], raster: SectionRaster,
    islands: Islands, layer_height_mm: float, bead_mm: float, limit_deg: float,
) -> tuple[OverhangPlace, ...]:
    """Pieces of a slice that lean out by more than 30° over the slice below, the largest first.

    loops, below : outlines of the slice and of the one below it, which may have none
    limit_deg : an island that reaches nothing within this lean starts in the air
    """
    if _same(loops, below):
        return ()
    inside = raster.depth_mm > 0
    beyond = distance_outside(below, raster.grid, inside)
    reach = np.float32(layer_height_mm * np.tan(np.radians(limit_deg)))
    supported = np.bincount(
        islands.label[inside & (beyond <= reach)].clip(0), minlength=len(islands)) > 0
    warned = layer_height_mm * float(np.tan(np.radians(WARNED_OVERHANG_DEG)))
    least = np.float32(max(warned, _raster_error_mm(raster)))
    label, peaks = connected_pieces(np.where(beyond > least, beyond, np.float32(0)))
    places = []
    cell = raster.grid.pitch_mm**2
    for j, i in nodes_of_pieces(label, len(peaks)):
        area = len(j) * cell
        if area < (_LEAST_BEADS * bead_mm) ** 2:
            continue
        x_mm, y_mm = raster.grid.x_mm[i], raster.grid.y_mm[j]
        island = int(islands.label[j, i].max())
        lean = beyond[j, i]
        farthest = int(np.argmax(lean))
        steepest = float(lean[farthest])
        middle = float(x_mm.mean()), float(y_mm.mean())
        angle = 89.9 if not np.isfinite(steepest) else float(
            np.degrees(np.arctan2(steepest, layer_height_mm)))
        is_in_air = island >= 0 and not bool(supported[island])
        places.append(OverhangPlace(
            at_mm=middle if is_in_air else (float(x_mm[farthest]), float(y_mm[farthest])),
            middle_mm=middle, area_mm2=area, angle_deg=min(angle, 89.9), is_in_air=is_in_air))
    places.sort(key=lambda place: (not place.is_in_air, -place.area_mm2))
    return tuple(places[:_MOST_PLACES])


def _same(loops: Sequence[FloatArray], below: Sequence[FloatArray]) -> bool:
    return len(loops) == len(below) and all(
        np.array_equal(a, b) for a, b in zip(loops, below, strict=True))


def _raster_error_mm(raster: SectionRaster) -> float:
    return 1e-3 * raster.grid.pitch_mm
