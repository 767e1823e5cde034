"""What the outline of a slice alone decides: its raster, islands and tracks before mixtures.

Layers of straight walls repeat their outline to the last bit. What follows from it is kept until
another outline comes, so that such layers cost their mixtures, links and figures only. Nothing kept
depends on anything else, so plans are the same with and without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.flat_tracks import FlatTracks, flat_tracks
from lmctl.plan.geometry.in_plane import in_plane_layout
from lmctl.plan.geometry.islands import Islands, islands_of
from lmctl.plan.geometry.link_lines import LinkRules
from lmctl.plan.geometry.link_places import BridgePlaces, bridge_places
from lmctl.plan.geometry.medial_axis import MedialAxis, medial_axis
from lmctl.plan.geometry.section_raster import SectionRaster, section_raster

#: Outlines kept: that of the last slice, of which odd and even layers are laid out differently.
_KEPT = 1


@dataclass(frozen=True, eq=False)
class OffsetLayout:
    """Offset tracks of an outline.

    narrow_mm2 : area that single tracks have to themselves where it is narrower than a bead
    places : where closed tracks may be joined; None for fewer than two
    """

    tracks: FlatTracks
    narrow_mm2: float
    places: BridgePlaces | None


class SliceOutline:
    """One outline and what is known of it.

    loops : closed, (k, 2) float64 [mm]; node_mm : of its raster
    """

    def __init__(self, loops: Sequence[FloatArray], node_mm: float) -> None:
        self.loops = loops
        self.raster: SectionRaster = section_raster(loops, node_mm)
        self.islands: Islands = islands_of(loops, self.raster)
        self._layouts: dict[tuple[float, ...], OffsetLayout] = {}

    @cached_property
    def axis(self) -> MedialAxis:
        return medial_axis(self.raster)

    def offset_layout(
        self, bead_mm: float, rules: LinkRules, least_width_mm: float, *, is_odd_layer: bool
    ) -> OffsetLayout:
        """Tracks along the outline; of the rules, those that concern lengths."""
        key = (bead_mm, rules.pitch_mm, rules.spacing_mm, least_width_mm, float(is_odd_layer))
        if key not in self._layouts:
            self._layouts[key] = self._made_layout(bead_mm, rules, least_width_mm, is_odd_layer)
        return self._layouts[key]

    def _made_layout(
        self, bead_mm: float, rules: LinkRules, least_width_mm: float, is_odd_layer: bool
    ) -> OffsetLayout:
        layout = in_plane_layout(
            self.raster, self.islands, self.axis, bead_mm, rules.pitch_mm, least_width_mm,
            rules.spacing_mm, is_odd_layer=is_odd_layer)
        tracks = flat_tracks(layout.tracks, layout.island, rules.spacing_mm)
        places = None
        if tracks.n_closed > 1:
            places = bridge_places(
                tracks.table[:, :2], tracks.starts, tracks.n_closed, self.raster, rules.pitch_mm,
                rules.longest_bridge_mm, rules.least_depth_mm)
        return OffsetLayout(tracks, layout.narrow_area_mm2(bead_mm), places)


def slice_outline(loops: Sequence[FloatArray], node_mm: float) -> SliceOutline:
    """The outline with these loops, kept from the last call where they are the same."""
    starts = np.cumsum([0, *(len(loop) for loop in loops)])
    return _kept_outline(np.vstack(loops).tobytes(), starts.tobytes(), node_mm)


@lru_cache(maxsize=_KEPT)
def _kept_outline(points: bytes, starts: bytes, node_mm: float) -> SliceOutline:
    table = np.frombuffer(points).reshape(-1, 2).copy()
    return SliceOutline(np.split(table, np.frombuffer(starts, np.intp)[1:-1]), node_mm)
