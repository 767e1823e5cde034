"""Bands of a section between lines of equal mixture, each about as wide as a track.

The first line is where the field begins to change; each next one is swept anew from the one before,
a pitch farther, so that the spacing is true in the plane however steep the field is. In odd layers
lines lie half-way between those of the others: a step of mixture between two beads is then in the
middle of the beads above it, and what is melted again mixes across it. What is left
of a band where its lines come together goes to the next one; where they lie far apart, because the
field is flat, the band is wider and takes several tracks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lmctl.field.outline_distance import plane_distance
from lmctl.plan.geometry.mixture_map import MixtureMap
from lmctl.plan.geometry.planar_region import (
    TOUCHING_PITCHES,
    grown,
    joined,
    opened,
    region_of,
    true_pieces,
)

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: A band is nowhere narrower than this, in pitches: a track of the least strip fits.
_LEAST_WIDTH_PITCHES = 0.76
#: The first bands of odd layers are so many and so wide, in pitches: each a little wider than a
#: track of the least strip, and together half a pitch more than one.
_NARROW_BANDS, _NARROW_PITCHES = 2, 0.77
#: The lines move together or apart so that a whole number of bands fits, where it does not within
#: this part of one.
_SAME_PITCHES = 0.02
#: Of the places a pitch from a line, so many are of lower grade than the next line [percent].
_NEXT_LINE_PERCENTILE = 25.0
#: Mixtures of neighbouring lines a pitch apart differ by this part of a quantum at least.
_LEAST_STEP = 0.75
#: The field counts as flat within so much of its ends, in volume fraction.
_FLAT = 0.01
#: What a circle does not reach of a corner of a band, in square pitches, stays with the band.
_CORNER_PITCHES_SQ = 0.35
#: Crumbs of less area are dropped: squares of this part of a pitch.
_CRUMB_PITCHES = 0.05
#: How much of an outline may move in simplifying it, in pitches.
_SIMPLIFY_PITCHES = 0.005
_MOST_BANDS = 1000


def mixture_bands(
    whole: CrossSection, field: MixtureMap, pitch_mm: float, step: float, *, is_odd_layer: bool
) -> list[CrossSection]:
    """Bands that together are the whole, in order of grade.

    step : quantum of mixture: a field within it is of one band
    is_odd_layer : the lines lie half-way between those of other layers
    """
    if field.highest - field.lowest <= step:
        return [whole]
    levels = line_levels(field, pitch_mm, step, is_odd_layer=is_odd_layer)
    left, found = whole, []
    for lines in field.below(levels):
        under = region_of(lines)
        band = _band_of(left ^ under, pitch_mm)
        if not band.is_empty():
            found.append(band)
            left = left - band
    last = _band_of(left, pitch_mm)
    if not last.is_empty():
        found.append(last)
        left = left - last
    return _with_rest(found or [whole], left, pitch_mm)


def line_levels(
    field: MixtureMap, pitch_mm: float, step: float, *, is_odd_layer: bool
) -> list[float]:
    """Grades of the lines between bands, rising.

    is_odd_layer : the first two bands are narrow, so that the others lie half a pitch from those of
        other layers
    """
    levels, across = _swept_levels(field, pitch_mm, step, narrow_bands=0)
    whole = max(round(across), 1)
    if not is_odd_layer and abs(across - whole) < _SAME_PITCHES:
        return levels
    return _swept_levels(field, pitch_mm * across / whole, step,
                         narrow_bands=_NARROW_BANDS if is_odd_layer else 0)[0]


def _swept_levels(
    field: MixtureMap, pitch_mm: float, step: float, narrow_bands: int
) -> tuple[list[float], float]:
    """Grades of lines each a pitch from the one before, and how many pitches there are in all.

    narrow_bands : so many bands are narrow, the first ones
    """
    grade, node = field.grade, field.grid.pitch_mm
    low, high = field.lowest + _FLAT, field.highest - _FLAT
    levels, across = [low], 0.0
    while levels[-1] < high and len(levels) < _MOST_BANDS:
        beyond = field.inside & (grade > levels[-1])
        away = np.abs(plane_distance(field.lines_of(levels[-1]), field.grid))
        reach = pitch_mm * (_NARROW_PITCHES if len(levels) <= narrow_bands else 1.0)
        if len(levels) == 1:  # where the field is not flat, the first band has begun already
            side = np.count_nonzero(beyond & (away < node)) * node
            done = np.count_nonzero(field.inside & ~beyond) * node**2 / max(side, node)
            reach -= done if done < _LEAST_WIDTH_PITCHES * pitch_mm else 0.0
        ring = beyond & (np.abs(away - reach) < 0.7 * node)
        there = levels[-1] + (grade[ring] - levels[-1]) * reach / np.maximum(away[ring], 1e-9)
        reached = float(np.percentile(there, _NEXT_LINE_PERCENTILE)) if ring.any() else high
        reached = max(reached, levels[-1] + _LEAST_STEP * step * reach / pitch_mm)
        across += min((high - levels[-1]) / (reached - levels[-1]), 1.0)
        levels.append(min(reached, high))
    return levels, across


def _band_of(region: CrossSection, pitch_mm: float) -> CrossSection:
    """What of a region is wide enough for a track, corners included."""
    band = opened(region, _LEAST_WIDTH_PITCHES * pitch_mm / 2)
    if band.area() <= (_CRUMB_PITCHES * pitch_mm) ** 2:
        return type(region)()
    small = [piece for piece in true_pieces(region - band, pitch_mm)
             if piece.area() < _CORNER_PITCHES_SQ * pitch_mm**2]
    return joined(band, small, pitch_mm)


def _with_rest(
    bands: list[CrossSection], rest: CrossSection, pitch_mm: float
) -> list[CrossSection]:
    """Bands with each piece of the rest given to the band it adjoins most."""
    for piece in true_pieces(rest, pitch_mm):
        around = grown(piece, TOUCHING_PITCHES * pitch_mm)
        shared = [(around ^ band).area() for band in bands]
        nearest = int(np.argmax(shared))
        if shared[nearest] > 0:
            bands[nearest] = joined(bands[nearest], [piece], pitch_mm)
    return [band.simplify(_SIMPLIFY_PITCHES * pitch_mm) for band in bands]
