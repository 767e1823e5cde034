"""In which order, from where and which way round the tracks of a layer are laid.

Tracks go by composition, in one sweep from one end of the layer's range to the other, and the
next layer sweeps back: the least change of mixture there can be (process.md 4). Tracks of equal
mixture go by nearness. Closed tracks start at an angle that turns by the golden angle from layer
to layer, so that no seam builds up, but where the mixture varies along them, where it is nearest
to what the nozzle holds. The sense alternates from layer to layer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.polyline import arc_lengths
from lmctl.plan.tracks import Track

FloatArray = NDArray[np.float64]

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
#: How a change of mixture (volume fraction) weighs against a turn of a closed track's start.
_TURNS_PER_FRACTION = 5.0
#: How a change of mixture weighs against way, in choosing the end of an open track [mm].
_MM_PER_FRACTION = 100.0


@dataclass(frozen=True)
class Trace:
    """A track with the material field along it: points (k, 2), fractions (k, m), share_mm (k,)."""

    points: FloatArray
    fractions: FloatArray
    share_mm: FloatArray
    closed: bool

    def mean_fractions(self) -> FloatArray:
        """(m,) by length."""
        weight = np.diff(arc_lengths(self.points))
        middle = (self.fractions[1:] + self.fractions[:-1]) / 2
        return np.asarray(np.average(middle, axis=0, weights=weight))


def arrange(
    tracks: list[Track], fractions: list[FloatArray], layer: int, at_mm: FloatArray,
    last: FloatArray | None, step: float, change_s: Callable[[FloatArray, FloatArray], float],
) -> list[Trace]:
    """The tracks of a layer as they are to be laid.

    fractions : the material field at each track's points
    at_mm : (2,) where the nozzle comes from
    last : (m,) mixture at the end of the layer before, None in the first
    change_s : time a change from one mixture to another takes; decides the first sweep's sense
    """
    traces = [
        Trace(track.points, values, track.share_mm, track.closed)
        for track, values in zip(tracks, fractions, strict=True)
    ]
    if not traces:
        return []
    means = np.array([trace.mean_fractions() for trace in traces])
    rank = np.round(_along_range(means) / step).astype(int)
    groups = [np.flatnonzero(rank == value) for value in np.unique(rank)]
    if _sweeps_down([means[group].mean(axis=0) for group in groups], last, change_s):
        groups.reverse()
    centre = np.vstack([trace.points for trace in traces]).mean(axis=0)
    arranged: list[Trace] = []
    mixture = last
    for group in groups:
        waiting = [_turned(traces[i], layer, centre) for i in group]
        ends = np.array([_entries(trace) for trace in waiting])
        left = np.ones(len(waiting), dtype=np.bool_)
        while left.any():
            way = np.linalg.norm(ends - at_mm, axis=2).min(axis=1)
            nearest = int(np.argmin(np.where(left, way, np.inf)))
            left[nearest] = False
            trace = _entered(waiting[nearest], at_mm, mixture)
            arranged.append(trace)
            at_mm, mixture = trace.points[-1], trace.fractions[-1]
    return arranged


def _along_range(means: FloatArray) -> FloatArray:
    """Each mixture's place along the layer's main direction of change, (n,)."""
    spread = means - means.mean(axis=0)
    if np.abs(spread).max() < 1e-9:
        return np.zeros(len(means))
    axis = np.linalg.svd(spread, full_matrices=False)[2][0]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    return np.asarray(spread @ axis)


def _sweeps_down(
    mixtures: list[FloatArray], last: FloatArray | None,
    change_s: Callable[[FloatArray, FloatArray], float],
) -> bool:
    """Whether to begin at the high end: it is nearer to the last mixture, or costs less time."""
    if last is not None:
        return bool(np.abs(mixtures[-1] - last).sum() < np.abs(mixtures[0] - last).sum())
    pairs = list(pairwise(mixtures))
    return sum(change_s(b, a) for a, b in pairs) < sum(change_s(a, b) for a, b in pairs)


def _turned(trace: Trace, layer: int, centre: FloatArray) -> Trace:
    """Every second layer runs the other way round; a closed track starts at the layer's angle."""
    if layer % 2:
        trace = _reversed(trace)
    if not trace.closed:
        return trace
    return _rotated(trace, int(np.argmin(_off_angle(trace, layer, centre))))


def _off_angle(trace: Trace, layer: int, centre: FloatArray) -> FloatArray:
    """How far each point of a closed track is from the layer's start angle, [0, π]."""
    arm = trace.points[:-1] - centre
    angle = np.arctan2(arm[:, 1], arm[:, 0]) - layer * GOLDEN_ANGLE
    return np.asarray(np.abs((angle + np.pi) % (2 * np.pi) - np.pi))


def _entered(trace: Trace, at_mm: FloatArray, mixture: FloatArray | None) -> Trace:
    """The trace begun where it suits what the nozzle holds, if its mixture varies."""
    if not trace.closed:
        ends = np.array([0, -1])
        cost = np.linalg.norm(trace.points[ends] - at_mm, axis=1)
        if mixture is not None:
            cost += _MM_PER_FRACTION * np.abs(trace.fractions[ends] - mixture).max(axis=1)
        return trace if cost[0] <= cost[1] else _reversed(trace)
    if mixture is None:
        return trace
    change = np.abs(trace.fractions[:-1] - mixture).max(axis=1)
    turn = arc_lengths(trace.points)[:-1] / arc_lengths(trace.points)[-1]
    cost = np.minimum(turn, 1 - turn) + _TURNS_PER_FRACTION * np.round(change, 3)
    return _rotated(trace, int(np.argmin(cost)))


def _entries(trace: Trace) -> FloatArray:
    """Where a trace may be begun, (2, 2): its ends, or its start twice."""
    return trace.points[[0, 0]] if trace.closed else trace.points[[0, -1]]


def _rotated(trace: Trace, first: int) -> Trace:
    if first == 0:
        return trace
    order = np.concatenate([np.arange(first, len(trace.points) - 1), np.arange(first + 1)])
    return Trace(trace.points[order], trace.fractions[order], trace.share_mm[order], True)


def _reversed(trace: Trace) -> Trace:
    return Trace(
        trace.points[::-1], trace.fractions[::-1], trace.share_mm[::-1], trace.closed)
