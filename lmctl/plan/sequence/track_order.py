"""Choose the order, start point and direction in which the tracks of a layer are deposited.

Tracks are sorted by composition, in one sweep from one end of the layer's range to the other. The
next layer sweeps back, so the mixture changes as little as possible. Tracks of equal mixture are
sorted by nearness. The start of a closed track (its seam) follows `process.seam`; where the
mixture varies along the track, it is near to what the nozzle already delivers. The direction
alternates from layer to layer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.sequence.flat_arrays import arc_lengths_mm, indices_within_stretches

#: "spread" turns the seam by the golden angle from layer to layer, so that no ridge builds up;
#: "aligned" keeps it at one angle; a point (x, y) [mm, part coordinates] draws it near.
Seam = Literal["spread", "aligned"] | tuple[float, float]

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
#: How a change of mixture (volume fraction) weighs against a turn of a closed track's start.
_TURNS_PER_FRACTION = 5.0
#: How a change of mixture weighs against travel, in choosing the end of an open track [mm].
_MM_PER_FRACTION = 100.0


@dataclass(frozen=True)
class OrderedTracks:
    """The tracks of a layer as they are deposited, one after the other; n vertices, m tracks.

    points_mm : (n, 2) float64; strip_width_mm : (n,) float64
    fractions : (n, materials) float64, to be fed: the part's material field, or what makes up for
        dilution
    melted : what beads melt of the layer below, where dilution is compensated
    starts : (m + 1,) intp, track k is vertices starts[k] to starts[k + 1]
    along_mm : (n,) float64, rising strictly from track to track: length along each track from
        `TRACK_GAP_MM` beyond the end of the one before, so that one array of lengths addresses
        places on all of them
    """

    points_mm: FloatArray
    strip_width_mm: FloatArray
    fractions: FloatArray
    starts: IndexArray
    along_mm: FloatArray
    melted: MeltedBelow | None = None

    @property
    def n_tracks(self) -> int:
        return len(self.starts) - 1

    @property
    def lengths_mm(self) -> FloatArray:
        """Length of each track, (m,)."""
        return np.asarray(self.along_mm[self.starts[1:] - 1] - self.along_mm[self.starts[:-1]])


#: Between the lengths of one track and the next in `OrderedTracks.along_mm`.
TRACK_GAP_MM = 1.0


def order_tracks(
    geometry: LayerGeometry, turn: int, at_mm: FloatArray, last: FloatArray | None, step: float,
    change_s: Callable[[FloatArray, FloatArray], float], seam: Seam = "spread",
) -> OrderedTracks:
    """The tracks of a layer in order of deposition.

    turn : number of the layer in the job; turns the seam and alternates the direction
    at_mm : (2,) where the nozzle comes from, in the part's own coordinates
    last : (materials,) mixture at the end of the layer before, None in the first
    step : mixtures within it count as equal
    change_s : time a change from one mixture to another takes; decides the first sweep's direction
    """
    if geometry.n_tracks == 0:
        return _in_order(geometry, *(np.empty(0, np.intp) for _ in range(3)))
    along = arc_lengths_mm(geometry.points_mm, geometry.starts)
    means = _mean_fractions(geometry, along)
    rank = np.round(_along_range(means) / step).astype(np.int64)
    values, group = np.unique(rank, return_inverse=True)
    group_means = [means[group == number].mean(axis=0) for number in range(len(values))]
    if _sweeps_down(group_means, last, change_s):
        group = len(values) - 1 - group
    centre = geometry.points_mm.mean(axis=0)
    sequence = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[sequence], np.arange(len(values) + 1))
    preferred = _seam_vertices(geometry, centre, turn, seam)
    directed = geometry.is_directed
    if directed is None:
        directed = np.zeros(geometry.n_tracks, dtype=np.bool_)
    order, first, reverse = _greedy_order(
        geometry.points_mm, geometry.starts, along, geometry.fractions, geometry.is_closed,
        directed, sequence, bounds, preferred, bool(turn % 2), np.asarray(at_mm, dtype=np.float64),
        np.zeros(geometry.fractions.shape[1]) if last is None else last, last is not None)
    return _in_order(geometry, order, first, reverse)


def _mean_fractions(geometry: LayerGeometry, along_mm: FloatArray) -> FloatArray:
    """Mean mixture of every track by length, (m, materials)."""
    weight = np.diff(along_mm)
    weight[geometry.starts[1:-1] - 1] = 0.0  # from one track to the next is no length
    middle = (geometry.fractions[1:] + geometry.fractions[:-1]) / 2
    first = geometry.starts[:-1]
    total = np.add.reduceat(weight, first)
    return np.asarray(np.add.reduceat(weight[:, None] * middle, first, axis=0) / total[:, None])


def _along_range(means: FloatArray) -> FloatArray:
    """Each mixture's place along the layer's main direction of change, (m,)."""
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


def _seam_vertices(
    geometry: LayerGeometry, centre_mm: FloatArray, turn: int, seam: Seam
) -> IndexArray:
    """The vertex of every track at which the seam is preferred, (m,)."""
    if isinstance(seam, tuple):
        off = np.linalg.norm(geometry.points_mm - np.asarray(seam), axis=1)
    else:
        arm = geometry.points_mm - centre_mm
        angle = np.arctan2(arm[:, 1], arm[:, 0]) - (turn * GOLDEN_ANGLE if seam == "spread" else 0)
        off = np.abs((angle + np.pi) % (2 * np.pi) - np.pi)
    first = geometry.starts[:-1]
    least = np.repeat(np.minimum.reduceat(off, first), np.diff(geometry.starts))
    at = np.flatnonzero(off == least)
    track = np.searchsorted(geometry.starts, at, side="right") - 1
    return np.asarray(at[np.searchsorted(track, np.arange(geometry.n_tracks))])


def _in_order(
    geometry: LayerGeometry, order: IndexArray, first: IndexArray, reverse: IndexArray
) -> OrderedTracks:
    """Gather vertices: track order[k] from its vertex first[k], backwards where reversed."""
    size = np.diff(geometry.starts)[order]
    starts = np.concatenate([[0], np.cumsum(size)]).astype(np.intp)
    number = indices_within_stretches(size)
    track = np.repeat(order, size)
    begin = geometry.starts[track]
    step = np.where(np.repeat(reverse, size) > 0, -1, 1)
    at = np.repeat(first, size) - begin + step * number
    closed = geometry.is_closed[track]
    around = np.where(closed, geometry.starts[track + 1] - begin - 1, np.iinfo(np.intp).max)
    index: IndexArray = np.asarray(begin + at % np.maximum(around, 1), dtype=np.intp)
    points = geometry.points_mm[index]
    along = arc_lengths_mm(points, starts)
    if len(order):
        ends = along[starts[1:] - 1] + TRACK_GAP_MM
        along = along + np.repeat(np.cumsum(ends) - ends, size)
    return OrderedTracks(
        points, geometry.strip_width_mm[index], geometry.fractions[index], starts, along,
        None if geometry.melted is None else geometry.melted.at_vertices(index))


@inner_kernel
def _change(fractions: FloatArray, vertex: int, mixture: FloatArray) -> float:
    most = 0.0
    for k in range(len(mixture)):
        most = max(most, abs(fractions[vertex, k] - mixture[k]))
    return most


@kernel
def _greedy_order(
    points: FloatArray, starts: IndexArray, along: FloatArray, fractions: FloatArray,
    closed: NDArray[np.bool_], directed: NDArray[np.bool_], sequence: IndexArray,
    bounds: IndexArray, preferred: IndexArray, reverse: bool, at_mm: FloatArray,
    last: FloatArray, has_last: bool,
) -> tuple[IndexArray, IndexArray, IndexArray]:
    """Group by group, always the track whose entry is nearest: order, first vertices, reversed."""
    m = len(sequence)
    order = np.empty(m, np.int64)
    first = np.empty(m, np.int64)
    against = np.zeros(m, np.int64)
    waiting = sequence.copy()
    x, y = at_mm[0], at_mm[1]
    mixture = last.copy()
    known = has_last
    done = 0
    for g in range(len(bounds) - 1):
        begin, end = bounds[g], bounds[g + 1]
        for place in range(begin, end):
            nearest, least = place, np.inf
            for k in range(place, end):
                t = waiting[k]
                a = preferred[t] if closed[t] else starts[t]
                d = (points[a, 0] - x) ** 2 + (points[a, 1] - y) ** 2
                if not closed[t] and not directed[t]:
                    b = starts[t + 1] - 1
                    d = min(d, (points[b, 0] - x) ** 2 + (points[b, 1] - y) ** 2)
                if d < least or (d == least and t < waiting[nearest]):
                    nearest, least = k, d
            t = waiting[nearest]
            waiting[nearest] = waiting[place]
            waiting[place] = t
            a, b = starts[t], starts[t + 1] - 1
            order[done] = t
            if closed[t]:
                at = preferred[t]
                if known:
                    whole = along[b]
                    best = np.inf
                    for v in range(a, b):
                        turn = abs(along[v] - along[preferred[t]]) / whole
                        change = np.round(_change(fractions, v, mixture), 3)
                        cost = min(turn, 1 - turn) + _TURNS_PER_FRACTION * change
                        if cost < best:
                            best, at = cost, v
                if at == b:  # the first vertex again
                    at = a
                first[done] = at
                against[done] = 1 if reverse else 0
                leave = at
            else:
                cost_a = np.sqrt((points[a, 0] - x) ** 2 + (points[a, 1] - y) ** 2)
                cost_b = np.sqrt((points[b, 0] - x) ** 2 + (points[b, 1] - y) ** 2)
                if known:
                    cost_a += _MM_PER_FRACTION * _change(fractions, a, mixture)
                    cost_b += _MM_PER_FRACTION * _change(fractions, b, mixture)
                at_b = (cost_b < cost_a or (cost_b == cost_a and reverse)) and not directed[t]
                first[done] = b if at_b else a
                against[done] = 1 if at_b else 0
                leave = a if at_b else b
            done += 1
            x, y = points[leave, 0], points[leave, 1]
            for k in range(len(mixture)):
                mixture[k] = fractions[leave, k]
            known = True
    return order, first, against
