"""Regions of a section as polygons: cut with each other, opened, and turned back into loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: Sides of a full turn around a corner that is rounded.
_SEGMENTS = 48
#: Slivers of rounding are thinner than twice this, in pitches.
_SLIVER_PITCHES = 0.005
#: Pieces no farther apart touch, in pitches; and by how much they are grown to be one.
TOUCHING_PITCHES = 0.03
_WELD_PITCHES = 0.01


def region_of(loops: Sequence[FloatArray]) -> CrossSection:
    """What closed loops (k, 2) [mm] enclose, by the even-odd rule."""
    from manifold3d import CrossSection, FillRule

    return CrossSection([loop[:-1] for loop in loops], FillRule.EvenOdd)


def loops_of(region: CrossSection) -> list[FloatArray]:
    """Outlines of a region: closed loops (k, 2) [mm], the inside on the left."""
    found = [np.asarray(polygon, dtype=np.float64) for polygon in region.to_polygons()]
    return [np.vstack([polygon, polygon[:1]]) for polygon in found if len(polygon) >= 3]


def opened(region: CrossSection, radius_mm: float) -> CrossSection:
    """The region without what a circle of that radius cannot reach from inside."""
    from manifold3d import JoinType

    inner = region.offset(-radius_mm, JoinType.Round, circular_segments=_SEGMENTS)
    if inner.is_empty():
        return inner
    outer = inner.offset(radius_mm * (1 + 1e-3), JoinType.Round, circular_segments=_SEGMENTS)
    return outer ^ region


def grown(region: CrossSection, by_mm: float) -> CrossSection:
    """What lies within `by_mm` of a region."""
    from manifold3d import JoinType

    return region.offset(by_mm, JoinType.Round, circular_segments=_SEGMENTS)


def pieces_of(region: CrossSection) -> list[CrossSection]:
    """The connected pieces of a region, each with its holes."""
    pieces = region.decompose()
    # manifold3d gives a hole as a piece of its own, wound the other way, where it all but touches
    # the outline around it.
    holes = [region_of(loops_of(piece)) for piece in pieces if piece.area() < 0]
    whole = [piece for piece in pieces if piece.area() > 0]
    for hole in holes:
        around = [number for number, piece in enumerate(whole)
                  if (piece ^ hole).area() > 0.5 * hole.area()]
        if around:
            least = min(around, key=lambda number: whole[number].area())
            whole[least] = whole[least] - hole
    return whole


def true_pieces(region: CrossSection, pitch_mm: float) -> list[CrossSection]:
    """The pieces of a region, without the slivers that rounding leaves along outlines."""
    return pieces_of(opened(region, _SLIVER_PITCHES * pitch_mm))


def joined(
    region: CrossSection, pieces: Sequence[CrossSection], pitch_mm: float
) -> CrossSection:
    """A region with those of these pieces that touch it."""
    from manifold3d import CrossSection, OpType

    touching = [piece for piece in pieces
                if (grown(piece, TOUCHING_PITCHES * pitch_mm) ^ region).area() > 0]
    if not touching:
        return region
    # grown by a little, so that no slit stays
    weld = [grown(piece, _WELD_PITCHES * pitch_mm) for piece in touching]
    return CrossSection.batch_boolean([region, *weld], OpType.Add)
