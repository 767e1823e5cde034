"""What a strategy is given, a slice and its material field, and what it gives back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.config.part_file import ProcessSettings
from lmctl.plan.geometry.intended_slice import pitch_mm
from lmctl.plan.geometry.islands import Islands, islands_of
from lmctl.plan.geometry.link_lines import LinkableTrack, LinkRules
from lmctl.plan.geometry.mixture_map import MixtureAt, MixtureMap, mixture_map
from lmctl.plan.geometry.section_raster import SectionRaster, raster_pitch_mm, section_raster
from lmctl.plan.geometry.toolpath import Toolpath

if TYPE_CHECKING:
    from lmctl.part.part import PartSection

#: Points of tracks are at most so far apart, in beads: so finely is the material field sampled.
MAX_POINT_SPACING_BEADS = 0.1
#: The map of mixtures reaches so far beyond the outline, in pitches.
_BEYOND_PITCHES = 2.0
#: Seams turn by so much from layer to layer, so that no ridge builds up [radians].
GOLDEN_ANGLE = float(np.pi * (3 - np.sqrt(5)))
#: A track of less extent may, on the program's raster, hold no motion that a controller can make.
_LEAST_EXTENT_MM = 0.042


@dataclass(frozen=True)
class SliceTask:
    """One slice, or a region of one, to be filled with tracks.

    section : the part in this plane; loops : of the intended slice, or of the region
    layer : number, counted from the lowest one that meets the part
    fractions_at : the part's material field in this plane
    """

    section: PartSection
    loops: list[FloatArray]
    process: ProcessSettings
    layer: int
    fractions_at: MixtureAt

    @property
    def bead_mm(self) -> float:
        return self.process.bead_width_mm

    @property
    def pitch_mm(self) -> float:
        return pitch_mm(self.process)

    @property
    def is_odd_layer(self) -> bool:
        return self.layer % 2 == 1

    @property
    def least_width_mm(self) -> float:
        """What is narrower gets no track."""
        return self.bead_mm if self.process.narrow_features == "omit" else self.bead_mm / 2

    @cached_property
    def raster(self) -> SectionRaster:
        return section_raster(self.loops, raster_pitch_mm(self.bead_mm, self.pitch_mm))

    @cached_property
    def islands(self) -> Islands:
        return islands_of(self.loops, self.raster)

    @cached_property
    def mixture_map(self) -> MixtureMap | None:
        return mixture_map(self.raster, self.fractions_at, _BEYOND_PITCHES * self.pitch_mm)

    def link_rules(self) -> LinkRules:
        seam = self.process.seam
        return LinkRules(
            pitch_mm=self.pitch_mm, spacing_mm=self.bead_mm * MAX_POINT_SPACING_BEADS,
            mixture_step=self.process.fraction_step,
            seam_mm=seam if isinstance(seam, tuple) else None,
            seam_angle=self.layer * GOLDEN_ANGLE if seam == "spread" else 0.0)

    def with_mixtures(self, tracks: list[Toolpath], island: IndexArray) -> list[LinkableTrack]:
        """Tracks with the material field along them, sampled once.

        island : of each track. Tracks that a controller cannot move along are left out
        """
        kept = [(track.densified(self.bead_mm * MAX_POINT_SPACING_BEADS), max(int(owner), 0))
                for track, owner in zip(tracks, island, strict=True)
                if np.ptp(track.points_mm, axis=0).max() >= _LEAST_EXTENT_MM]
        if not kept:
            return []
        fractions = self.fractions_at(np.vstack([track.points_mm for track, _ in kept]))
        ends = np.cumsum([len(track.points_mm) for track, _ in kept])[:-1]
        return [
            LinkableTrack(np.column_stack([track.points_mm, track.strip_width_mm, mixture]),
                          track.is_closed, owner)
            for (track, owner), mixture in zip(kept, np.split(fractions, ends), strict=True)
        ]


@dataclass(frozen=True)
class StrategyTracks:
    """Tracks of a slice in no order, and the area of those in narrow places [mm²]."""

    tracks: list[LinkableTrack]
    narrow_mm2: float = 0.0
