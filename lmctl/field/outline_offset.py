"""Outlines moved outwards or inwards in their plane, exactly (manifold3d, to 1e-8 mm)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lmctl.array_types import FloatArray

#: Sides of a full turn around a corner that is rounded: 0.1 % of the offset at most is missing.
_SEGMENTS = 96


def offset_loops(loops: Sequence[FloatArray], by_mm: float) -> list[FloatArray]:
    """The outline of what lies within `by_mm` of the inside; negative: deeper than that in it.

    Corners are rounded, so that the new outline is everywhere as far from the old.

    loops : closed, (k, 2) float64 [mm], first point repeated last, the inside on the left
    returns : loops likewise, outer ones counter-clockwise, holes clockwise
    """
    if by_mm == 0 or not loops:
        return list(loops)
    from manifold3d import CrossSection, FillRule, JoinType

    outline = CrossSection([loop[:-1] for loop in loops], FillRule.EvenOdd)
    moved = outline.offset(by_mm, JoinType.Round, circular_segments=_SEGMENTS)
    found = [np.asarray(polygon, dtype=np.float64) for polygon in moved.to_polygons()]
    return [np.vstack([polygon, polygon[:1]]) for polygon in found if len(polygon) >= 3]
