"""What a strategy is given, a slice and its material field, and what it gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.config.part_file import ProcessSettings, RegionStrategy
from lmctl.plan.geometry.flat_tracks import FlatTracks, flat_tracks
from lmctl.plan.geometry.intended_slice import pitch_mm
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.link_lines import LinkableTrack, LinkRules
from lmctl.plan.geometry.mixture_map import MixtureAt, MixtureMap, mixture_map
from lmctl.plan.geometry.section_raster import SectionRaster, raster_pitch_mm
from lmctl.plan.geometry.slice_outline import SliceOutline, slice_outline
from lmctl.plan.geometry.toolpath import Toolpath

if TYPE_CHECKING:
    from lmctl.part.part import PartSection

#: Points of tracks are at most so far apart, in beads: so finely is the material field sampled.
MAX_POINT_SPACING_BEADS = 0.1
#: The map of mixtures reaches so far beyond the outline, in pitches.
_BEYOND_PITCHES = 2.0
#: Seams turn by so much from layer to layer, so that no ridge builds up [radians].
GOLDEN_ANGLE = float(np.pi * (3 - np.sqrt(5)))


@dataclass(frozen=True)
class SliceTask:
    """One slice, or a region of one, to be filled with tracks.

    section : the part in this plane; loops : of the intended slice, or of the region
    layer : number, counted from the lowest one that meets the part
    fractions_at : the part's material field in this plane
    bodies : (outline, strategy) of bodies that have one of their own; of several the first
    links : whether neighbouring tracks may be linked
    """

    section: PartSection
    loops: list[FloatArray]
    process: ProcessSettings
    layer: int
    fractions_at: MixtureAt
    bodies: tuple[tuple[list[FloatArray], RegionStrategy], ...] = ()
    links: bool = True

    @property
    def bead_mm(self) -> float:
        return self.process.bead_width_mm

    @property
    def pitch_mm(self) -> float:
        return pitch_mm(self.process)

    @property
    def spacing_mm(self) -> float:
        """Points of tracks are at most so far apart."""
        return self.bead_mm * MAX_POINT_SPACING_BEADS

    @property
    def is_odd_layer(self) -> bool:
        return self.layer % 2 == 1

    @property
    def least_width_mm(self) -> float:
        """What is narrower gets no track."""
        return self.bead_mm if self.process.narrow_features == "omit" else self.bead_mm / 2

    @cached_property
    def outline(self) -> SliceOutline:
        return slice_outline(self.loops, raster_pitch_mm(self.bead_mm, self.pitch_mm))

    @property
    def raster(self) -> SectionRaster:
        return self.outline.raster

    @property
    def islands(self) -> Islands:
        return self.outline.islands

    @cached_property
    def mixture_map(self) -> MixtureMap | None:
        return mixture_map(self.raster, self.fractions_at, _BEYOND_PITCHES * self.pitch_mm)

    def with_strategy(self, strategy: RegionStrategy, loops: list[FloatArray]) -> SliceTask:
        """The task of filling a region of this slice by another strategy."""
        return replace(self, loops=loops, bodies=(), process=self.process.model_copy(
            update={"strategy": strategy}))

    def link_rules(self) -> LinkRules:
        seam = self.process.seam
        return LinkRules(
            pitch_mm=self.pitch_mm, spacing_mm=self.spacing_mm,
            mixture_step=self.process.fraction_step,
            seam_mm=seam if isinstance(seam, tuple) else None,
            seam_angle=self.layer * GOLDEN_ANGLE if seam == "spread" else 0.0)

    def with_mixtures(self, tracks: Sequence[Toolpath], island: IndexArray) -> list[LinkableTrack]:
        """Tracks with the material field along them, closed ones first.

        island : of each track. Tracks that a controller cannot move along are left out
        """
        return self.mixtures_along(flat_tracks(tracks, island, self.spacing_mm))

    def mixtures_along(self, tracks: FlatTracks) -> list[LinkableTrack]:
        """Tracks with the material field along them, sampled once."""
        if len(tracks.island) == 0:
            return []
        fractions = self.fractions_at(tracks.table[:, :2])
        table = np.empty((len(tracks.table), 3 + fractions.shape[1]))
        table[:, :3], table[:, 3:] = tracks.table, fractions
        return [
            LinkableTrack(table[begin:end], bool(is_closed), int(island))
            for begin, end, is_closed, island in zip(
                tracks.starts[:-1], tracks.starts[1:], tracks.is_closed, tracks.island,
                strict=True)
        ]


@dataclass(frozen=True)
class StrategyTracks:
    """Tracks of a slice in no order, and the area of those in narrow places [mm²]."""

    tracks: list[LinkableTrack]
    narrow_mm2: float = 0.0
