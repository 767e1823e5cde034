"""Cut tracks where powder could not follow their mixture even at the least speed.

There a track is deposited as two, and the mixture changes between them with the beam off. The cut
lies where a change that is too fast is over, so that what follows begins with its own mixture; of a
change that takes longer than two beads, where powder begins to come late. A piece shorter than two
beads is not worth its start: there the track stays whole, and its mixture comes late.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.flat_arrays import arc_lengths_mm, indices_within_stretches
from lmctl.plan.sequence.mixture_ramps import (
    NO_LAG_S,
    approach_flow,
    deliverable_ramp_fraction,
    powder_limits_of,
)
from lmctl.plan.sequence.speed_factor import MIXTURE_TOLERANCE_FRACTION, SPEED_FACTORS

#: The shortest piece that a cut may leave, in beads.
LEAST_PIECE_BEADS = 2.0


@dataclass(frozen=True)
class CutTracks:
    """A layer with its tracks cut.

    cuts : how many were made; too_short : places that wanted one where a piece would be too short
    """

    geometry: LayerGeometry
    cuts: int
    too_short: int


def cut_tracks(geometry: LayerGeometry, recipe: Recipe) -> CutTracks:
    """The tracks of a layer, each cut where its mixture changes faster than powder can."""
    if geometry.n_tracks == 0:
        return CutTracks(geometry, 0, 0)
    first = geometry.starts[:-1]
    span = np.maximum.reduceat(geometry.fractions, first) - np.minimum.reduceat(
        geometry.fractions, first)
    varies = span.max(axis=1) > 2 * MIXTURE_TOLERANCE_FRACTION
    if not varies.any():
        return CutTracks(geometry, 0, 0)
    length = np.zeros(len(geometry.points_mm))
    length[1:] = np.diff(arc_lengths_mm(geometry.points_mm, geometry.starts))
    length[first] = 0.0
    limits, slowest = powder_limits_of(recipe), min(SPEED_FACTORS)
    at, too_short = _cuts(
        geometry.fractions, recipe.flow_g_s(geometry.fractions) * slowest, length,
        length / (recipe.speed(geometry.fractions) * slowest), geometry.starts, varies,
        np.maximum(limits.lag_s, NO_LAG_S), limits.max_flow_g_s, limits.volume_mm3_g,
        LEAST_PIECE_BEADS * recipe.bead_mm, MIXTURE_TOLERANCE_FRACTION)
    if len(at) == 0:
        return CutTracks(geometry, 0, int(too_short))
    return CutTracks(_cut_at(geometry, np.asarray(at)), len(at), int(too_short))


def _cut_at(geometry: LayerGeometry, at: IntArray) -> LayerGeometry:
    """The same layer with tracks cut at vertices `at` (k,), rising, none at an end."""
    cuts = np.searchsorted(at, geometry.starts)
    begin: list[int] = []
    end: list[int] = []
    owner: list[int] = []
    closed: list[bool] = []
    for number in range(geometry.n_tracks):
        own = at[cuts[number]:cuts[number + 1]].tolist()
        low, high = int(geometry.starts[number]), int(geometry.starts[number + 1]) - 1
        edges = [low, *own, high]
        if own and geometry.is_closed[number]:  # from the last cut, through the seam, to the first
            edges = [*own, own[0] + high - low]
        begin += edges[:-1]
        end += edges[1:]
        owner += [number] * (len(edges) - 1)
        closed += [bool(geometry.is_closed[number]) and not own] * (len(edges) - 1)
    tracks: IndexArray = np.array(owner, dtype=np.intp)
    size = np.array(end) - np.array(begin) + 1
    vertex = np.repeat(begin, size) + indices_within_stretches(size)
    last = np.repeat(geometry.starts[tracks + 1] - 1, size)
    whole = last - np.repeat(geometry.starts[tracks], size)
    vertex = np.where(vertex > last, vertex - whole, vertex)  # a closed track's last is its first
    directed = geometry.is_directed
    return replace(
        geometry, points_mm=geometry.points_mm[vertex],
        strip_width_mm=geometry.strip_width_mm[vertex], fractions=geometry.fractions[vertex],
        melted=None if geometry.melted is None else geometry.melted.at_vertices(vertex),
        starts=np.concatenate([[0], np.cumsum(size)]).astype(np.intp),
        is_closed=np.array(closed, dtype=np.bool_), island=geometry.island[tracks],
        is_directed=None if directed is None else directed[tracks],
        copy=None if geometry.copy is None else geometry.copy[tracks],
        rounds=None if geometry.rounds is None else geometry.rounds[tracks],
        designed=None if geometry.designed is None else geometry.designed[vertex])


@kernel
def _cuts(
    fractions: FloatArray, flow: FloatArray, length: FloatArray, lasting: FloatArray,
    starts: IndexArray, varies: BoolArray, lag: FloatArray, most: FloatArray, volume: FloatArray,
    least_mm: float, tolerance: float,
) -> tuple[NDArray[np.int64], int]:
    """Vertices at which to cut, rising, and how many cuts would leave too short a piece."""
    found = np.empty(len(length), np.int64)
    count, too_short = 0, 0
    now = np.empty(flow.shape[1])
    for track in range(len(varies)):
        if not varies[track]:
            continue
        begin, end = starts[track], starts[track + 1]
        left = 0.0
        for k in range(begin + 1, end):
            left += length[k]
        done = 0.0
        approach_flow(now, flow[begin], 1.0)
        k = begin + 1
        while k < end:
            share = deliverable_ramp_fraction(now, flow[k], lasting[k], lag, most)
            approach_flow(now, flow[k], min(share, 1.0))
            done += length[k]
            left -= length[k]
            if not _is_off(now, flow[k], volume, tolerance):
                k += 1
                continue
            # how far the change goes that is too fast here: until it is slower, or turns round
            change, stop = _change(fractions, k - 1, k), k
            while stop + 1 < end and _change(fractions, stop, stop + 1) > 0.3 * change:
                stop += 1
            ahead = 0.0
            for j in range(k + 1, stop + 1):
                ahead += length[j]
            at = stop
            if ahead > least_mm:
                at, ahead = k, 0.0
            if done + ahead >= least_mm and left - ahead >= least_mm and at < end - 1:
                found[count] = at
                count += 1
                approach_flow(now, flow[at], 1.0)
                left -= ahead
                done = 0.0
                k = at + 1
                continue
            too_short += 1
            # powder comes late: go on where it has caught up
            k += 1
            while k < end:
                share = deliverable_ramp_fraction(now, flow[k], lasting[k], lag, most)
                approach_flow(now, flow[k], min(share, 1.0))
                done += length[k]
                left -= length[k]
                k += 1
                if not _is_off(now, flow[k - 1], volume, tolerance):
                    break
    return found[:count], too_short


@inner_kernel
def _change(fractions: FloatArray, a: int, b: int) -> float:
    most = 0.0
    for m in range(fractions.shape[1]):
        most = max(most, abs(fractions[b, m] - fractions[a, m]))
    return most


@inner_kernel
def _is_off(flow: FloatArray, wanted: FloatArray, volume: FloatArray, tolerance: float) -> bool:
    """Whether flows deposit another mixture than wanted."""
    total, other = 0.0, 0.0
    for m in range(len(flow)):
        total += flow[m] * volume[m]
        other += wanted[m] * volume[m]
    for m in range(len(flow)):
        if abs(flow[m] * volume[m] / total - wanted[m] * volume[m] / other) > tolerance:
            return True
    return False
