"""Choose the order, start point and direction in which the tracks of a layer are deposited.

Tracks are sorted by composition, in one sweep from one end of the layer's range to the other. The
next layer sweeps back, so the mixture changes as little as possible. Where every other track comes
first (`geometry.alternate_tracks`), those between are swept back. Tracks of equal mixture are
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

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.sequence.flat_arrays import arc_lengths_mm
from lmctl.plan.sequence.nearest_first import vertices_nearest_first

#: "spread" turns the seam by the golden angle from layer to layer, so that no ridge builds up;
#: "aligned" keeps it at one angle; a point (x, y) [mm, part coordinates] draws it near.
Seam = Literal["spread", "aligned"] | tuple[float, float]

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@dataclass(frozen=True)
class OrderedTracks:
    """The tracks of a layer as they are deposited, one after the other; n vertices, m tracks.

    points_mm : (n, 2) float64; strip_width_mm : (n,) float64
    fractions : (n, materials) float64, to be fed: the part's material field, or what makes up for
        dilution
    melted : what beads melt of the layer below, where dilution is compensated
    designed : (n, materials) float64, the part file's own mixture; None without alloy rules
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
    designed: FloatArray | None = None

    @property
    def n_tracks(self) -> int:
        return len(self.starts) - 1

    @property
    def lengths_mm(self) -> FloatArray:
        """Length of each track, (m,)."""
        return np.asarray(self.along_mm[self.starts[1:] - 1] - self.along_mm[self.starts[:-1]])

    def places_every(self, step_mm: float) -> tuple[FloatArray, FloatArray]:
        """Points (k, 2) and mixtures (k, materials) so far apart along the tracks, k > 0."""
        at_mm = np.arange(self.along_mm[0] + step_mm / 2, self.along_mm[-1], step_mm)
        vertex = np.searchsorted(self.along_mm, at_mm, side="right")
        at_mm = at_mm[~np.isin(vertex, self.starts)]  # not between one track and the next
        if not len(at_mm):
            return self.points_mm, self.fractions

        def at_places(columns: FloatArray) -> FloatArray:
            return np.column_stack([np.interp(at_mm, self.along_mm, one) for one in columns.T])

        return at_places(self.points_mm), at_places(self.fractions)


#: Between the lengths of one track and the next in `OrderedTracks.along_mm`.
TRACK_GAP_MM = 1.0


def order_tracks(
    geometry: LayerGeometry, turn: int, at_mm: FloatArray, last: FloatArray | None, step: float,
    change_s: Callable[[FloatArray, FloatArray], float], seam: Seam = "spread",
    rearranged: Callable[[IndexArray], IndexArray] | None = None,
) -> OrderedTracks:
    """The tracks of a layer in order of deposition.

    turn : number of the layer in the job; turns the seam and alternates the direction
    at_mm : (2,) where the nozzle comes from, in the part's own coordinates
    last : (materials,) mixture at the end of the layer before, None in the first
    step : mixtures within it count as equal
    change_s : time a change from one mixture to another takes; decides the first sweep's direction
    rearranged : another order of tracks of equal mixture than nearest first
    """
    if geometry.n_tracks == 0:
        return _in_order(geometry, np.empty(0, np.intp), np.zeros(1, np.intp))
    along = arc_lengths_mm(geometry.points_mm, geometry.starts)
    means = _mean_fractions(geometry, along)
    rank = np.round(_along_range(means) / step).astype(np.int64)
    values, group = np.unique(rank, return_inverse=True)
    size = np.bincount(group)
    group_means = np.stack([np.bincount(group, column) / size for column in means.T], axis=1)
    if _sweeps_down(group_means, last, change_s):
        group = len(values) - 1 - group
    groups = len(values)
    if geometry.rounds is not None:  # every other round sweeps back
        group = np.where(geometry.rounds % 2, groups - 1 - group, group) + groups * geometry.rounds
        groups *= int(geometry.rounds.max()) + 1
    centre = _centres_mm(geometry)
    sequence = np.argsort(group, kind="stable")
    bounds = np.searchsorted(group[sequence], np.arange(groups + 1))
    if rearranged is not None:
        sequence = np.concatenate([
            rearranged(sequence[a:b]) for a, b in pairwise(bounds.tolist())])
        bounds = np.arange(len(sequence) + 1)
    preferred = _seam_vertices(geometry, centre, turn, seam)
    directed = geometry.is_directed
    if directed is None:
        directed = np.zeros(geometry.n_tracks, dtype=np.bool_)
    vertices, starts = vertices_nearest_first(
        geometry.points_mm, geometry.starts, along, geometry.fractions, geometry.is_closed,
        directed, sequence, bounds, preferred, bool(turn % 2), np.asarray(at_mm, dtype=np.float64),
        np.zeros(geometry.fractions.shape[1]) if last is None else last, last is not None)
    return _in_order(geometry, vertices, starts)


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
    mixtures: FloatArray, last: FloatArray | None,
    change_s: Callable[[FloatArray, FloatArray], float],
) -> bool:
    """Whether to begin at the high end: it is nearer to the last mixture, or costs less time."""
    if last is not None:
        return bool(np.abs(mixtures[-1] - last).sum() < np.abs(mixtures[0] - last).sum())
    pairs = list(pairwise(mixtures))
    return sum(change_s(b, a) for a, b in pairs) < sum(change_s(a, b) for a, b in pairs)


def _centres_mm(geometry: LayerGeometry) -> FloatArray:
    """The middle of the layer, (2,), or for each vertex that of its copy, (n, 2)."""
    if geometry.copy is None:
        return np.asarray(geometry.points_mm.mean(axis=0))
    copy = np.repeat(geometry.copy, np.diff(geometry.starts))
    count = np.bincount(copy)
    middle = np.column_stack([np.bincount(copy, axis) / count for axis in geometry.points_mm.T])
    return np.asarray(middle[copy])


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
    return np.asarray(_first_least(off, geometry.starts))


@kernel
def _first_least(values: FloatArray, starts: IndexArray) -> IndexArray:
    """The first index of the least value of each stretch, (m,)."""
    found = np.empty(len(starts) - 1, np.int64)
    for k in range(len(found)):
        at = starts[k]
        for v in range(starts[k] + 1, starts[k + 1]):
            if values[v] < values[at]:
                at = v
        found[k] = at
    return found


def _in_order(
    geometry: LayerGeometry, vertices: IndexArray, starts: IndexArray
) -> OrderedTracks:
    """The tracks that these vertices (n,) make up; starts : (m + 1,) of each among them."""
    points = geometry.points_mm[vertices]
    rising = np.sign(np.diff(vertices, append=0))
    rising[starts[1:] - 1] = 0
    turned = np.repeat(np.add.reduceat(rising, starts[:-1]) < 0, np.diff(starts)) if (
        len(vertices)) else np.zeros(0, np.bool_)
    return OrderedTracks(
        points, geometry.strip_width_mm[vertices], geometry.fractions[vertices], starts,
        arc_lengths_mm(points, starts, TRACK_GAP_MM),
        None if geometry.melted is None else geometry.melted.at_vertices(vertices, turned),
        None if geometry.designed is None else geometry.designed[vertices])
