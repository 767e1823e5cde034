"""Tracks while they are linked: points, strip widths and mixtures in one table, cut by length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.polyline import track_lengths

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
    return track_lengths(line.table)


def rows_between_arc_lengths(
    table: FloatArray, arc_mm: FloatArray, begin_mm: float, end_mm: float
) -> FloatArray:
    """Rows of a closed line from one arc length to another, forwards or backwards."""
    rows = np.asarray(_rows_kernel(
        np.ascontiguousarray(table), arc_mm, min(begin_mm, end_mm), max(begin_mm, end_mm)))
    return rows if begin_mm <= end_mm else rows[::-1]


@kernel
def _rows_kernel(table: FloatArray, arc: FloatArray, low: float, high: float) -> FloatArray:
    """Rows at both arc lengths, taken round, and those between."""
    whole, n = arc[-1], len(arc) - 1
    turns = int(np.floor(high / whole)) - int(np.floor(low / whole)) + 1
    rows = np.empty((turns * n + 2, table.shape[1]))
    count = 1
    for turn in range(int(np.floor(low / whole)), int(np.floor(high / whole)) + 1):
        first = np.searchsorted(arc[:n], low + 1e-9 - turn * whole, side="right")
        last = np.searchsorted(arc[:n], high - 1e-9 - turn * whole)
        for k in range(first, last):
            rows[count] = table[k]
            count += 1
    for end in range(2):
        at = (low if end == 0 else high) % whole
        after = min(max(np.searchsorted(arc, at, side="right"), 1), n)
        step = arc[after] - arc[after - 1]
        share = (at - arc[after - 1]) / step if step > 0 else 0.0
        for c in range(table.shape[1]):
            rows[0 if end == 0 else count, c] = table[after - 1, c] + share * (
                table[after, c] - table[after - 1, c])
    return rows[: count + 1].copy()


@kernel
def point_at_arc_length(table: FloatArray, arc: FloatArray, at: float) -> tuple[float, float]:
    """The point (x, y) of a closed line at an arc length, taken round."""
    at = at % arc[-1]
    after = min(max(int(np.searchsorted(arc, at, side="right")), 1), len(arc) - 1)
    before = after - 1
    step = arc[after] - arc[before]
    share = (at - arc[before]) / step if step > 0 else 0.0
    return (table[before, 0] + share * (table[after, 0] - table[before, 0]),
            table[before, 1] + share * (table[after, 1] - table[before, 1]))
