"""How far apart the tracks of an island lie, and what they carry where they meet in its middle.

Tracks lie at depth a/2, then every pitch d. Where the walls' tracks meet, at depth R, what is
left from the innermost to the middle is g = (R − a/2) mod d:

- g < d/4: two tracks would pile up; one *centreline* track replaces them (the outermost only
  where it misses next to nothing of the outline: g < a/50);
- 2g ≤ `widest_gap_mm`: two tracks, spaced 2g;
- else: two tracks and a centreline between them.

The pitch may stretch or shrink by up to `PITCH_TOLERANCE` to bring 2g near d along most of the
medial axis. What misfit is left the *share* of each track levels: the width of the strip it has
to fill, half of the way to each neighbour. The planner lays share · layer height per millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

#: Largest part by which an island's pitch may differ from the process's.
PITCH_TOLERANCE = 0.15
#: A track's centre may lie this part of a bead outside the a/2 inset.
INSET_TOLERANCE = 0.05
#: Outermost tracks nearer to their middle than this part of a bead become one: not more, or
#: the outline would be missed.
_OUTER_MERGE = 0.02
#: What is nowhere so deep, in beads, is left out; what is so deep but for rounding is not.
LEAST_DEPTH = 0.5 - INSET_TOLERANCE - 1e-6
#: Beads this many widths apart still meet: without overlap, one width is the rule itself.
_NO_VOID = 1.01


@dataclass(frozen=True)
class Centrelines:
    """What happens along a medial axis; each (n,) for its n vertices.

    runs : bool, a centreline track runs there
    parts : bool, two tracks run there, too near to each other for the raster to part them
    merges : intp, the level whose tracks those replace there, −1 where they replace none
    share_mm : float64, the strip a centreline has to fill there
    way_mm : float64, ≥ 0, from the innermost level to the middle
    wide : bool, contours lie around there
    slim : bool, all there is across is one centreline, or two tracks the raster does not part
    """

    runs: BoolArray
    parts: BoolArray
    merges: IntArray
    share_mm: FloatArray
    way_mm: FloatArray
    wide: BoolArray
    slim: BoolArray


def widest_gap_mm(bead_mm: float, pitch_mm: FloatArray | float) -> FloatArray:
    """Tracks may lie so far apart without one between: 1.5 pitches, but no void to speak of."""
    return np.minimum(1.5 * np.asarray(pitch_mm), _NO_VOID * bead_mm)


def centrelines(
    radius_mm: FloatArray, bead_mm: float, pitch_mm: float, narrow_mm: float
) -> Centrelines:
    """Where centrelines run along a medial axis of depth `radius_mm` (n,).

    narrow_mm : contours nearer than this to their middle are beyond the raster; at most a/2, so
        that two tracks there leave no void
    """
    depth, level, rest = _levels(radius_mm, bead_mm, pitch_mm)
    outer = level == 0
    laid = radius_mm >= LEAST_DEPTH * bead_mm
    merge = laid & (rest < np.where(outer, _OUTER_MERGE * bead_mm, pitch_mm / 4))
    narrow = rest < narrow_mm
    gap = (depth >= 0) & ~narrow & (2 * rest > widest_gap_mm(bead_mm, pitch_mm))
    parts = laid & ~merge & narrow
    share = np.where(gap, rest, np.where(outer, pitch_mm + 2 * rest, pitch_mm + rest))
    return Centrelines(
        runs=merge | gap, parts=parts, merges=np.where(merge | parts, level, -1), share_mm=share,
        way_mm=np.maximum(rest, 0.0), wide=(depth >= 0) & ~(merge | gap | parts),
        slim=outer & (merge | parts))


def share_around_mm(radius_mm: float, pitch_mm: float) -> float:
    """The strip a lone ring has to fill: the disc as far as half a pitch beyond it."""
    return (radius_mm + pitch_mm / 2) ** 2 / (2 * radius_mm)


def share_beside_mm(rest_mm: FloatArray, bead_mm: float, pitch_mm: float) -> FloatArray:
    """The strip a contour track has to fill where its way to the middle is `rest_mm`.

    rest_mm : (n,) float64; infinite where another contour lies inside it
    """
    gap = 2 * rest_mm > widest_gap_mm(bead_mm, pitch_mm)
    inner = np.where(gap, rest_mm / 2, rest_mm)
    return np.asarray(pitch_mm / 2 + np.where(rest_mm < pitch_mm, inner, pitch_mm / 2))


def fitting_pitch_mm(
    radius_mm: FloatArray, weight: FloatArray, deepest_mm: float, bead_mm: float, pitch_mm: float
) -> float:
    """The pitch within the tolerance whose tracks meet best along a medial axis.

    radius_mm, weight : (n,) float64, depth and length of its pieces
    deepest_mm : largest depth of the island; decides where it has no axis but a point (a disc)
    """
    point = weight.sum() < bead_mm
    if point:
        radius_mm, weight = np.array([deepest_mm]), np.ones(1)
    widest = max(1.0, min(1 + PITCH_TOLERANCE, _NO_VOID * bead_mm / pitch_mm))
    # A point's misfit grows with every ring around it, and one radius costs little to try.
    steps = np.linspace(1 - PITCH_TOLERANCE, widest, 601 if point else 61)
    misfit = _misfit(radius_mm, bead_mm, pitch_mm * steps[:, None], point)
    cost = misfit**2 @ weight / weight.sum() + 0.02 * (steps - 1) ** 2
    return float(pitch_mm * steps[int(np.argmin(cost))])


def _levels(
    radius_mm: FloatArray, bead_mm: float, pitch_mm: FloatArray | float
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Depth below the first contour, number of the innermost, way from it to the middle."""
    depth = radius_mm - bead_mm / 2
    level = np.maximum(np.floor(depth / pitch_mm), 0).astype(np.intp)
    return depth, level, depth - level * pitch_mm


def _misfit(
    radius_mm: FloatArray, bead_mm: float, pitch_mm: FloatArray, point: bool
) -> FloatArray:
    """How far the spacing in the middle is from one pitch, in pitches.

    radius_mm : (n,), pitch_mm : (p, 1); returns (p, n)
    point : the middle is a point, where no centreline can run
    """
    _, level, rest = _levels(radius_mm, bead_mm, pitch_mm)
    if point:
        return np.asarray(2 * rest / pitch_mm - 1)
    gap = 2 * rest > widest_gap_mm(bead_mm, pitch_mm)
    spacing = np.where(gap, rest, 2 * rest)
    spacing = np.where((rest < pitch_mm / 4) & (level > 0), rest + pitch_mm, spacing)
    alone = (level == 0) & (rest < _OUTER_MERGE * bead_mm)
    return np.asarray(np.where(alone, 0.0, spacing / pitch_mm - 1))
