"""The tracks of a section by its in-plane depth: contours, centrelines between them, pins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.geometry.bead_count import BeadCount, bead_count
from lmctl.plan.geometry.centrelines import centreline_tracks
from lmctl.plan.geometry.contours import contour_tracks
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.level_field import LevelField, level_field
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.pins import with_pins
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath

#: Strips are this wide at least and at most, in pitches.
LEAST_STRIP, WIDEST_STRIP = 0.7, 1.5
#: The second strip from the outline is so much wider than a pitch, and narrower in odd layers.
SECOND_STRIP_SHIFT_PITCHES = 0.25


@dataclass(frozen=True)
class InPlaneLayout:
    """Tracks of a section with the island of each, and what they were derived from."""

    tracks: list[Toolpath]
    island: NDArray[np.intp]
    axis: MedialAxis
    beads: BeadCount
    field: LevelField

    def narrow_area_mm2(self, bead_mm: float) -> float:
        """Area that single tracks have to themselves where it is narrower than a bead."""
        single = self.beads.has_centreline & (self.beads.track_count == 1)
        narrow = single & (2 * self.axis.depth_mm < bead_mm * (1 - 1e-6))
        links = self.axis.links[narrow[self.axis.links].all(axis=1)]
        length = np.linalg.norm(np.diff(self.axis.points_mm[links], axis=1)[:, 0], axis=1)
        return float((length * 2 * self.axis.depth_mm[links].mean(axis=1)).sum())


def in_plane_layout(
    raster: SectionRaster, islands: Islands, axis: MedialAxis, bead_mm: float, pitch_mm: float,
    least_width_mm: float, spacing_mm: float, *, is_odd_layer: bool = False,
) -> InPlaneLayout:
    """All tracks of a section, in no order; none in what is narrower than `least_width_mm`.

    spacing_mm : of points on contours
    is_odd_layer : tracks well inside lie half a pitch from those of other layers
    """
    beads = bead_count(axis, raster, bead_mm, pitch_mm, least_width_mm, is_odd_layer=is_odd_layer)
    second_mm = pitch_mm * (
        1 - SECOND_STRIP_SHIFT_PITCHES if is_odd_layer else 1 + SECOND_STRIP_SHIFT_PITCHES)
    field = level_field(raster, axis, beads, pitch_mm, second_mm)
    limits_mm = LEAST_STRIP * pitch_mm, WIDEST_STRIP * pitch_mm
    tracks = contour_tracks(
        field, raster, axis, pitch_mm, second_mm, limits_mm[1], spacing_mm)
    tracks += centreline_tracks(axis, beads, raster, pitch_mm, second_mm, limits_mm)
    middles = np.array([t.points_mm[len(t.points_mm) // 2] for t in tracks]).reshape(-1, 2)
    tracks, island = with_pins(tracks, islands.island_at(middles, raster), islands, axis, beads,
                               raster,
                               least_width_mm, limits_mm)
    return InPlaneLayout(tracks, island, axis, beads, field)
