"""Find pieces of the part that lie between the section planes, so that no layer has them.

Where something of the part begins and ends between the middles of a layer and the next, the part is
cut there too. What then lies outside both layers, by more than a wall could lean, is a piece too
flat for the layer height.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.intended_slice import intended_loops
from lmctl.plan.geometry.layer_geometry import LostFeature
from lmctl.plan.geometry.losses import lost_feature_of_outline
from lmctl.plan.polyline import densified_polyline
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: The most planes at which the part is cut between two layers.
_MOST_PLANES = 4
#: Heights nearer to each other than this part of a layer hold nothing between them.
_LEAST_GAP = 1e-3
#: What lies so far outside both layers is a piece of its own, in beads.
_OUTSIDE_BEADS = 0.25
#: Points of outlines are looked at so far apart, in beads.
_SPACING_BEADS = 0.25


def flat_pieces(
    part: Part, placement: Placement, layer: int, loops: Sequence[FloatArray]
) -> list[LostFeature]:
    """Pieces between the middle of a layer and that of the next, or the top; of the lowest layer,
    also those between the bottom and its middle.

    loops : the intended slice of the layer
    """
    z_mm, height = placement.cut_height_mm(layer), placement.layer_height_mm
    planes = _planes_between(part.turning_heights_mm, z_mm, z_mm + height, height)
    if placement.skipped + layer == 0:
        planes = [*_planes_between(part.turning_heights_mm, z_mm - height, z_mm, height), *planes]
    above: list[FloatArray] | None = None
    found: list[LostFeature] = []
    for z in planes:
        between = intended_loops(part.section(z).loops, part.process)
        if _same(between, loops):
            continue
        away = _OUTSIDE_BEADS * part.process.bead_width_mm
        for piece in _outside_of(between, loops, away, part.process.bead_width_mm):
            if above is None:
                above = intended_loops(
                    part.section(placement.cut_height_mm(layer + 1)).loops, part.process)
            rest = _outside_of([piece], above, away, part.process.bead_width_mm)
            found += [lost_feature_of_outline("flat", outline, part.process) for outline in rest
                      if not _is_known(outline, found, part.process.bead_width_mm)]
    return found


def _planes_between(
    turning_mm: FloatArray, low_mm: float, high_mm: float, height_mm: float
) -> list[float]:
    """Heights half-way between neighbouring turning heights, of the widest gaps."""
    inside = turning_mm[(turning_mm > low_mm) & (turning_mm < high_mm)]
    gaps = np.diff(inside)
    wide = np.argsort(-gaps, kind="stable")[:_MOST_PLANES]
    wide = np.sort(wide[gaps[wide] > _LEAST_GAP * height_mm])
    return [float((inside[k] + inside[k + 1]) / 2) for k in wide]


def _same(one: Sequence[FloatArray], other: Sequence[FloatArray]) -> bool:
    return len(one) == len(other) and all(
        np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def _outside_of(
    loops: Sequence[FloatArray], of: Sequence[FloatArray], away_mm: float, bead_mm: float
) -> list[FloatArray]:
    """Stretches of outlines that lie farther than `away_mm` outside others: (k, 2) each."""
    if not of:
        return list(loops)
    segments = np.vstack([np.hstack([loop[:-1], loop[1:]]) for loop in of])
    found = []
    for loop in loops:
        fine = densified_polyline(loop, _SPACING_BEADS * bead_mm)
        outside = np.asarray(_outside_kernel(fine, segments, away_mm))
        edges = np.flatnonzero(np.diff(np.concatenate([[0], outside.astype(np.int8), [0]])))
        found += [fine[begin:end] for begin, end in zip(edges[::2], edges[1::2], strict=True)
                  if end - begin > 2]
    return found


def _is_known(outline: FloatArray, found: list[LostFeature], bead_mm: float) -> bool:
    """Whether a piece at the same place has been found at another height."""
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    return any(np.hypot(*(middle - np.array(piece.at_mm))) < bead_mm for piece in found)


@kernel
def _outside_kernel(
    points: FloatArray, segments: FloatArray, away: float
) -> NDArray[np.bool_]:
    """Which points lie outside closed outlines, by parity, and farther than `away` from them."""
    result = np.zeros(len(points), np.bool_)
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        inside, near = False, False
        for s in range(len(segments)):
            ax, ay, bx, by = segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
            if (ay > y) != (by > y) and ax + (y - ay) * (bx - ax) / (by - ay) > x:
                inside = not inside
            ux, uy = bx - ax, by - ay
            size = ux * ux + uy * uy
            t = 0.0
            if size > 0.0:
                t = min(1.0, max(0.0, ((x - ax) * ux + (y - ay) * uy) / size))
            dx, dy = x - ax - t * ux, y - ay - t * uy
            near = near or dx * dx + dy * dy <= away * away
        result[n] = not inside and not near
    return result
