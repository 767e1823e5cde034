"""How many tracks lie across the material at each point of its medial axis.

The nearest whole number to width / pitch (one at least from half a bead on), as in contouring with
beads of variable width (Kuipers et al. 2020, doi:10.1016/j.cad.2020.102907). An odd number puts a
track on the axis itself. Along a stretch shorter than two beads that would be a stub, so the
number is made even there; and where an even stretch that short parts two odd ones, odd.

Branches that run into corners belong to what they come from: tracks there follow the outline, and
their number is that of the axis uphill, or of the deepest point if no axis is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import BoolArray, FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.field.union_find import unite
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster

#: A stretch with a track on the axis is at least so long, in beads.
SHORTEST_CENTRELINE_BEADS = 2.0
#: An odd number may fill a width of so many pitches more, between two odd stretches (where
#: walls cross) and at the end of one.
_MOST_MORE_BETWEEN, _MOST_MORE_AT_END = 1.2, 0.6
#: So many tracks, from and to, become one more in every other layer. Of fewer the strips would be
#: too thin.
_ONE_MORE = 5, 10
#: Where so many pitches or more lie across, the strip of the second track moves those within it by
#: a quarter pitch from both sides, outwards in odd layers and inwards in the others
#: (level_field.py). What is left in the middle is so half a pitch more than in the mean, or less:
#: one track more in odd layers lies half a pitch from the others all the way.
_MOVED_APART = 11
#: Points of the axis whose depth differs by less, in nodes, are as deep as each other.
_LEVEL_NODES = 0.25
#: Opposite walls face each other along a stretch so long at least, in nodes; where spokes meet in
#: the middle of a hexagon two of them may, for a node.
_SHORTEST_CENTRAL_NODES = 2.0
#: Rounds of mending stretches: each takes one away, so few are ever needed.
_MOST_ROUNDS = 200


@dataclass(frozen=True)
class BeadCount:
    """For each point of a medial axis.

    track_count : (v,) int64, tracks across, 0 where the material is too narrow for one
    depth_mm : (v,) float64, half the width that those tracks divide among them
    owner : (v,) int64, the point of the axis that decided: itself, or one uphill
    is_point : (v,) bool, the middle is a point rather than a line: rings lie around it
    has_centreline : (v,) bool, a track may run along the axis here, if the count is odd
    """

    track_count: IntArray
    depth_mm: FloatArray
    owner: IntArray
    is_point: BoolArray
    has_centreline: BoolArray


def bead_count(
    axis: MedialAxis, raster: SectionRaster, bead_mm: float, pitch_mm: float,
    least_width_mm: float, *, is_odd_layer: bool = False,
) -> BeadCount:
    """Tracks across at every point of the axis; none where it is narrower than `least_width_mm`.

    is_odd_layer : where five or more lie across in other layers, one more does, between them
    """
    order = np.argsort(-axis.depth_mm, kind="stable")
    links = axis.links
    first, neighbours = _neighbours(links, len(axis.points_mm))
    is_central = _is_on_stretch(axis, _SHORTEST_CENTRAL_NODES * raster.grid.pitch_mm)
    owner, uphill = _owners_kernel(
        order, first, neighbours, axis.depth_mm, is_central,
        (axis.points_mm - np.array(raster.grid.origin_mm)) / raster.grid.pitch_mm,
        raster.depth_mm, axis.at_edge, _LEVEL_NODES * raster.grid.pitch_mm)
    own = owner == np.arange(len(owner))
    count = _nearest_count(2 * axis.depth_mm, least_width_mm, pitch_mm)
    if is_odd_layer:
        count += (count >= _ONE_MORE[0]) & (count <= _ONE_MORE[1])
    whole = np.floor(2 * axis.depth_mm / pitch_mm).astype(np.int64)
    count = np.where(whole >= _MOVED_APART, whole + int(is_odd_layer), count)
    peak = own & ~is_central
    count[peak] = _even_count(2 * axis.depth_mm, count, pitch_mm)[peak]
    wide = axis.depth_mm >= least_width_mm / 2 * (1 - 1e-6)
    on_line = (is_central | peak) & wide
    _mark_uphill(uphill, is_central & wide, on_line)
    count, is_point = _without_stubs(
        count, owner, links[on_line[links].all(axis=1)], axis, on_line,
        SHORTEST_CENTRELINE_BEADS * bead_mm, pitch_mm)
    middle = _is_middle(axis.depth_mm, owner, count)
    return BeadCount(track_count=count, depth_mm=axis.depth_mm[owner], owner=owner,
                     is_point=is_point,
                     has_centreline=on_line & middle)


def _is_middle(depth_mm: FloatArray, owner: IntArray, count: IntArray) -> BoolArray:
    """Where the innermost tracks lie beside the axis: downhill of what decides, they cross it."""
    return np.asarray(depth_mm > depth_mm[owner] * (1 - 1 / np.maximum(count, 1)))


def _nearest_count(width_mm: FloatArray, least_width_mm: float, pitch_mm: float) -> IntArray:
    count = np.floor(width_mm / pitch_mm + 0.5).astype(np.int64)
    wide = width_mm >= least_width_mm * (1 - 1e-6)
    return np.where(wide, np.maximum(count, 1), 0)


def _even_count(width_mm: FloatArray, count: IntArray, pitch_mm: float) -> IntArray:
    """The even number nearest to the width in pitches; one track stays one."""
    even = 2 * np.floor(width_mm / pitch_mm / 2 + 0.5).astype(np.int64)
    return np.where(count <= 1, count, np.maximum(even, 2))


def _without_stubs(
    count: IntArray, owner: IntArray, links: IntArray, axis: MedialAxis,
    on_line: BoolArray, shortest_mm: float, pitch_mm: float,
) -> tuple[IntArray, BoolArray]:
    """The counts without short stretches, and which points lie in a short stretch of their own."""
    width_mm = 2 * axis.depth_mm[owner]
    for _ in range(_MOST_ROUNDS):
        count = count[owner]
        runs, run_mm = _runs(count, links, owner, axis)
        odd = on_line & (count % 2 == 1) & (count > 1) & (run_mm[runs] < shortest_mm)
        if odd.any():
            count[odd] = _even_count(width_mm, count, pitch_mm)[odd]
            continue
        run = _even_run_beside_odd(
            count, runs, run_mm, links, shortest_mm, width_mm / pitch_mm)
        if run is None:
            break
        number, new = run
        count[(runs == number) & on_line] = new
    count = count[owner]
    runs, run_mm = _runs(count, links, owner, axis)
    is_point = on_line & (run_mm[runs] < shortest_mm)
    return count, is_point[owner]


def _even_run_beside_odd(
    count: IntArray, runs: IntArray, run_mm: FloatArray, links: IntArray,
    shortest_mm: float, across: FloatArray,
) -> tuple[int, int] | None:
    """A short even stretch at the end of, or between, stretches of one odd number; that number.

    across : (v,) width in pitches; where it is too much for the odd number the stretch stays even
    """
    ends = runs[links]
    bounds = links[ends[:, 0] != ends[:, 1]]
    pairs = np.vstack([bounds, bounds[:, ::-1]])
    if len(pairs) == 0:
        return None
    here, beside = count[pairs[:, 0]], count[pairs[:, 1]]
    run = runs[pairs[:, 0]]
    short = (here % 2 == 0) & (here > 0) & (run_mm[run] < shortest_mm)
    for number in np.unique(run[short])[np.argsort(run_mm[np.unique(run[short])])]:
        met = beside[run == number]
        met = met[met > 0]
        value = int(here[run == number][0])
        if len(met) == 0 or met.min() != met.max() or met[0] % 2 == 0:
            continue
        most = float(across[runs == number].max())
        widest = met[0] + (_MOST_MORE_BETWEEN if len(met) > 1 else _MOST_MORE_AT_END)
        if abs(int(met[0]) - value) == 1 and most <= widest:
            return int(number), int(met[0])
    return None


def _runs(
    count: IntArray, links: IntArray, owner: IntArray, axis: MedialAxis
) -> tuple[IntArray, FloatArray]:
    """Which stretch of one number each point is in, (v,), and the extent of each, by number.

    The extent is from corner to corner of its box, but for where tracks cross the axis.
    """
    same = links[count[links[:, 0]] == count[links[:, 1]]]
    label = np.asarray(_components_kernel(len(count), same))
    points = np.unique(same[_is_middle(axis.depth_mm, owner, count)[same].all(axis=1)])
    return label, _extents_mm(label, points, axis.points_mm)


def _is_on_stretch(axis: MedialAxis, shortest_mm: float) -> BoolArray:
    """Central points on a stretch of such that is long enough, (v,)."""
    links = axis.links[axis.is_central[axis.links].all(axis=1)]
    label = np.asarray(_components_kernel(len(axis.points_mm), links))
    extent = _extents_mm(label, np.unique(links), axis.points_mm)
    return np.asarray(axis.is_central & (extent[label] >= shortest_mm))


def _extents_mm(label: IntArray, points: IntArray, points_mm: FloatArray) -> FloatArray:
    """Of each label the diagonal of the box around those of its points that are named, (v,)."""
    low, high = np.full((2, len(label), 2), np.inf)
    np.minimum.at(low, label[points], points_mm[points])
    np.minimum.at(high, label[points], -points_mm[points])
    extent = np.where(np.isfinite(low), -high - low, 0.0)
    return np.hypot(extent[:, 0], extent[:, 1])


def _mark_uphill(uphill: IntArray, is_central: BoolArray, on_line: BoolArray) -> None:
    """Mark the ways uphill from central points: stretches between them that widen quickly."""
    for start in np.flatnonzero(is_central):
        point = int(uphill[start])
        while point >= 0 and not on_line[point]:
            on_line[point] = True
            point = int(uphill[point])


def _neighbours(links: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """(v + 1,) where each point's neighbours begin, and these one after the other."""
    ends = np.concatenate([links[:, 0], links[:, 1]])
    others = np.concatenate([links[:, 1], links[:, 0]])
    order = np.argsort(ends, kind="stable")
    return np.searchsorted(ends[order], np.arange(count + 1)), others[order]


@kernel
def _components_kernel(count: int, links: IntArray) -> IntArray:
    """The smallest point of each point's connected piece."""
    root = np.arange(count)
    for e in range(len(links)):
        unite(root, links[e, 0], links[e, 1])
    for n in range(count):
        while root[n] != root[root[n]]:
            root[n] = root[root[n]]
    return root


@kernel
def _owners_kernel(
    order: IntArray, first: IntArray, neighbours: IntArray, depth_mm: FloatArray,
    is_central: BoolArray, at: FloatArray, depth: NDArray[np.float32],
    at_edge: NDArray[np.int32], level_mm: float,
) -> tuple[IntArray, IntArray]:
    """The deciding point of each point, and the next point uphill, −1 at a peak.

    A branch that ends though the depth still grows goes on over the raster to the next point, at
    the raster's peak to one within two nodes: branches that meet there meet in one point. A peak
    beside a central point of the same depth, within `level_mm`, ends a line: that decides.
    """
    ny, nx = depth.shape
    owner = np.full(len(order), -1, np.int64)
    uphill = np.full(len(order), -1, np.int64)
    flat_end = np.full(len(order), -1, np.int64)
    for k in range(len(order)):
        point = order[k]
        best, highest = -1, depth_mm[point] + 1e-9
        for e in range(first[point], first[point + 1]):
            other = neighbours[e]
            if depth_mm[other] > highest:
                best, highest = other, depth_mm[other]
        if best < 0 and not is_central[point]:
            i, j = int(at[point, 0] + 0.5), int(at[point, 1] + 0.5)
            while best < 0:
                bi, bj, most = i, j, depth[j, i]
                for jn in range(max(0, j - 1), min(ny, j + 2)):
                    for im in range(max(0, i - 1), min(nx, i + 2)):
                        if depth[jn, im] > most:
                            bi, bj, most = im, jn, depth[jn, im]
                at_peak = bi == i and bj == j
                i, j = bi, bj
                beside = 2 if at_peak else 1
                for jn in range(max(0, j - beside), min(ny, j + beside)):
                    for im in range(max(0, i - beside), min(nx, i + beside)):
                        for side in range(2):
                            met = at_edge[side, jn, im]
                            if met >= 0 and owner[met] >= 0 and depth_mm[met] > highest:
                                best = met
                if at_peak:
                    break
        if best < 0 and not is_central[point]:
            for e in range(first[point], first[point + 1]):
                other = neighbours[e]
                if is_central[other] and depth_mm[other] > depth_mm[point] - level_mm:
                    flat_end[point] = other
        uphill[point] = best
        owner[point] = point if is_central[point] or best < 0 else owner[best]
    for point in range(len(order)):
        last = flat_end[owner[point]]
        if last >= 0:
            owner[point] = owner[last]
    return owner, uphill
