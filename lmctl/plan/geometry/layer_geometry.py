"""Output of the geometry stage for the sequence stage: one layer as flat arrays, with figures.

Everything here pickles to little more than its arrays, so that a layer can be made in another
process or on another machine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.melted_below import MeltedBelow

#: What a lost piece of a slice is: all of a layer, a whole island, a part of an island thinner
#: than the beads that fill the rest, a closed void between tracks, or what is flatter than a layer.
LostKind = Literal["layer", "island", "rib", "void", "flat"]


#: Places across a bead, from edge to edge, at which the material field is sampled.
ACROSS = 5


@dataclass(frozen=True)
class LostFeature:
    """A piece of the intended slice that no track covers by at least half.

    at_mm : (x, y) of its middle, in the part's own coordinates
    size_mm : (length, width), the width being its area over its length
    area_mm2 : of the piece
    reason, remedy : for the user: why the planner left it out, and how to keep it
    """

    kind: LostKind
    at_mm: tuple[float, float]
    size_mm: tuple[float, float]
    area_mm2: float
    reason: str
    remedy: str


@dataclass(frozen=True)
class OverhangPlace:
    """A connected piece of a slice that lies beyond an overhang limit over the slice below.

    at_mm : (x, y) where it leans out farthest, in the part's own coordinates
    middle_mm : (x, y) of its middle, which may lie outside it; area_mm2 : of the piece
    angle_deg : steepest lean over it, from the vertical, in (0, 90)
    is_in_air : it touches nothing within reach of the limit: material would start in the air
    """

    at_mm: tuple[float, float]
    middle_mm: tuple[float, float]
    area_mm2: float
    angle_deg: float
    is_in_air: bool


@dataclass(frozen=True)
class IslandFigures:
    """One connected piece of the intended slice that has tracks.

    at_mm : (x, y) of its middle, in the part's own coordinates
    slice_mm2, inside_mm2 : its area, and what of it is filled
    """

    at_mm: tuple[float, float]
    slice_mm2: float
    inside_mm2: float


@dataclass(frozen=True)
class LayerFigures:
    """Areas of one layer [mm²], and what is wrong with it.

    The *intended* slice is the drawing moved outwards by `allowance_mm` and, with
    `outer_track = "half-bead"`, inwards by half of what a bead is wider than a pitch. A track
    deposits its strip. Areas come from a raster and are scaled to the outline's own area.

    slice_mm2 : of the intended slice
    inside_mm2 : filled inside it, over tiles of two beads, none counted twice: slice_mm2 −
        inside_mm2 is missing
    double_mm2 : deposited inside it beyond what fits
    outside_mm2 : deposited outside it (surplus): inside + double + outside is strip_mm2
    strip_mm2 : sum of length · strip width of all tracks: the planned volume over the layer height
    narrow_mm2 : strips of single tracks in what is narrower than a bead
    islands : the pieces that have tracks, each with what of it is filled
    lost : pieces of the slice that no track covers
    overhang : pieces beyond the overhang warning angle, or that start in the air
    """

    slice_mm2: float
    inside_mm2: float
    double_mm2: float
    outside_mm2: float
    strip_mm2: float
    narrow_mm2: float = 0.0
    islands: tuple[IslandFigures, ...] = ()
    lost: tuple[LostFeature, ...] = ()
    overhang: tuple[OverhangPlace, ...] = ()

    def scaled(self, factor: float) -> LayerFigures:
        """The same for a layer that is thicker than the layer height by a factor in the mean.

        Its areas times the layer height are its volumes.
        """
        areas = {name: factor * getattr(self, name) for name in (
            "slice_mm2", "inside_mm2", "double_mm2", "outside_mm2", "strip_mm2", "narrow_mm2")}
        islands = tuple(replace(island, slice_mm2=factor * island.slice_mm2,
                                inside_mm2=factor * island.inside_mm2) for island in self.islands)
        return replace(self, islands=islands, **areas)


@dataclass(frozen=True)
class LayerGeometry:
    """The tracks of one layer, in the part's own coordinates, not yet in order of deposition.

    layer : number, counted from the lowest one that meets the part (before any is left out)
    z_mm : height of the section
    points_mm : (n, 2) float64, vertices of all tracks one after the other; at most a tenth of a
        bead apart
    starts : (m + 1,) intp, track k is points starts[k] to starts[k + 1]; at least 2 points each
    strip_width_mm : (n,) float64, > 0, width of the strip the track fills there: its volume per
        length over the layer height. On a substrate with a shape layers are thicker or thinner than
        that from place to place, and the length is that in the xy plane
    fractions : (n, materials) float64, the material field there, rows summing to 1
    designed : (n, materials) float64, the part file's own mixture where alloy rules change it;
        None where `fractions` is that
    is_closed : (m,) bool, the track ends where it begins (its first point is repeated last)
    copy : (m,) intp, which copy of the part each track belongs to; None where there is one part
    is_directed : (m,) bool, the track is to be deposited from its first point to its last; None
        where none is
    island : (m,) intp, which connected piece of the slice the track belongs to, from 0
    outline_mm : (k, 2) float64, all closed loops of the intended slice, each with its first point
        repeated last, the inside on the left
    outline_starts : (l + 1,) intp, loop k is outline_mm[outline_starts[k] : outline_starts[k + 1]]
    rounds : (m,) intp, tracks of round 0 are deposited before those of round 1
        (`alternate_tracks`); None where there is but one round
    fractions_across : (n, ACROSS, materials) float64, the material field across the bead at each
        vertex, from its right edge to its left; None where dilution is not compensated
    fractions_below : (n, materials) float64, the material field one layer lower; None in the
        lowest layer, and where dilution is not compensated
    melted : what beads melt of the layer below; then `fractions` are those to feed. None as
        geometry makes it, where they are the part's own
    """

    layer: int
    z_mm: float
    points_mm: FloatArray
    starts: IndexArray
    strip_width_mm: FloatArray
    fractions: FloatArray
    is_closed: NDArray[np.bool_]
    island: IndexArray
    outline_mm: FloatArray
    outline_starts: IndexArray
    figures: LayerFigures
    is_directed: NDArray[np.bool_] | None = None
    rounds: IndexArray | None = None
    fractions_across: FloatArray | None = None
    fractions_below: FloatArray | None = None
    melted: MeltedBelow | None = None
    copy: IndexArray | None = None
    designed: FloatArray | None = None

    @property
    def n_tracks(self) -> int:
        return len(self.starts) - 1

    def track(self, number: int) -> slice:
        """Where a track's vertices are in the arrays of vertices."""
        return slice(int(self.starts[number]), int(self.starts[number + 1]))

    def loops(self) -> list[FloatArray]:
        """The outline as loops (k, 2) [mm], views of `outline_mm`."""
        return np.split(self.outline_mm, self.outline_starts[1:-1]) if len(self.outline_mm) else []
