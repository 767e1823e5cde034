"""Tracks while they are linked: points, strip widths and mixtures in one table, cut by length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.polyline import arc_lengths

#: The longest bridge, and how deep inside the outline it has to stay, in pitches.
LONGEST_BRIDGE, LEAST_DEPTH = 1.5, 0.2
#: A closed track is at least so many bridge lengths long to be cut.
MIN_LOOP_BRIDGE_LENGTHS = 2.6


@dataclass(frozen=True)
class LinkableTrack:
    """A track while it is linked.

    table : (k, 3 + materials) float64: x, y, strip width [mm], volume fractions
    is_directed : it is to be deposited from its first point to its last
    """

    table: FloatArray
    is_closed: bool
    island: int
    is_directed: bool = False


@dataclass(frozen=True)
class LinkRules:
    """pitch_mm : nominal; spacing_mm : of the points on bridges; mixture_step : equal mixtures
    differ by no more; seam_mm : (2,) where bridges are wanted, or None; seam_angle : else, the
    direction from the middle of the layer [radians]
    """

    pitch_mm: float
    spacing_mm: float
    mixture_step: float
    seam_mm: tuple[float, float] | None
    seam_angle: float

    @property
    def longest_bridge_mm(self) -> float:
        return LONGEST_BRIDGE * self.pitch_mm

    @property
    def least_depth_mm(self) -> float:
        """How deep inside the outline a bridge has to stay."""
        return LEAST_DEPTH * self.pitch_mm


def arc_lengths_of(line: LinkableTrack) -> FloatArray:
    return arc_lengths(line.table[:, :2])


def rows_at_arc_lengths(table: FloatArray, arc_mm: FloatArray, at_mm: FloatArray) -> FloatArray:
    """Rows of a closed line at arc lengths, taken round."""
    at = at_mm % arc_mm[-1]
    after = np.clip(np.searchsorted(arc_mm, at, side="right"), 1, len(arc_mm) - 1)
    before = after - 1
    step = arc_mm[after] - arc_mm[before]
    share = np.where(step > 0, (at - arc_mm[before]) / np.where(step > 0, step, 1.0), 0.0)
    return np.asarray(table[before] + share[:, None] * (table[after] - table[before]))


def rows_between_arc_lengths(
    table: FloatArray, arc_mm: FloatArray, begin_mm: float, end_mm: float
) -> FloatArray:
    """Rows of a closed line from one arc length to another, forwards or backwards."""
    whole = float(arc_mm[-1])
    low, high = min(begin_mm, end_mm), max(begin_mm, end_mm)
    ends = rows_at_arc_lengths(table, arc_mm, np.array([low, high]))
    pieces = [ends[:1]]
    for turn in range(int(np.floor(low / whole)), int(np.floor(high / whole)) + 1):
        first = np.searchsorted(arc_mm[:-1], low + 1e-9 - turn * whole, side="right")
        last = np.searchsorted(arc_mm[:-1], high - 1e-9 - turn * whole, side="left")
        pieces.append(table[first:last])
    pieces.append(ends[1:])
    rows = np.vstack(pieces)
    return rows if begin_mm <= end_mm else rows[::-1]
