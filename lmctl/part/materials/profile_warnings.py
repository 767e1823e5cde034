"""Warn of doubtful compositions: features far outside the part, profiles that never change.

Neither is wrong in itself; both are nearly always a slip of units or of coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lmctl.part.bodies.body import Body
from lmctl.part.materials.composition import (
    BlendedComposition,
    CompositionField,
    GradedComposition,
    OverlapComposition,
    TransformedComposition,
)

#: Places sampled along each side of the part's box.
PLACES_PER_SIDE = 24


def flat_profile_warnings(rule: CompositionField, body: Body) -> list[str]:
    """A line for each profile that is flat all over the part, with the distances it meets there."""
    graded = [g for g in _graded(rule) if np.ptp(g.profile.changing_range_mm) > 0]
    if not graded:
        return []
    low, high = body.tight_bounds_mm
    shares = (np.arange(PLACES_PER_SIDE) + 0.5) / PLACES_PER_SIDE
    steps = np.stack(np.meshgrid(shares, shares, shares, indexing="ij"), axis=-1).reshape(-1, 3)
    points = low + steps * (high - low)
    points = points[body.distance_at(points) > 0]
    if len(points) == 0:
        return []
    said = []
    for one in graded:
        distance = one.feature.distance(points)
        least, most = float(distance.min()), float(distance.max())
        start, end = one.profile.changing_range_mm
        if least >= end or most <= start:
            kind = type(one.feature).__name__.lower()
            said.append(
                f"the composition does not change in the part: it lies {least:.4g} to "
                f"{most:.4g} mm from the {kind}, its profile runs from {start:g} to {end:g} mm; "
                f"is the {kind} where it should be?"
            )
    return said


def _graded(rule: CompositionField) -> Iterator[GradedComposition]:
    """The profiles of a rule that are evaluated in the part's own coordinates."""
    match rule:
        case GradedComposition():
            yield rule
        case BlendedComposition():
            yield from rule.parts
        case OverlapComposition() | TransformedComposition():
            return
