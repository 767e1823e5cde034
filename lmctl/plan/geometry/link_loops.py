"""Join neighbouring closed tracks: walk once around a spanning tree of pairs of bridges."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from lmctl.array_types import FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.link_lines import (
    MIN_LOOP_BRIDGE_LENGTHS,
    LinkableTrack,
    LinkRules,
    arc_lengths_of,
    point_at_arc_length,
    rows_between_arc_lengths,
)
from lmctl.plan.geometry.link_places import BridgePlaces, bridge_places
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.polyline import densified_polyline

#: Two bridges on one track keep so many bridge lengths between their middles.
_APART = 2.5
#: The most places at which a bridge between two loops is tried.
_MOST_PLACES = 1000
#: Bridges may be longer than the gap they span by this part; at need, by this.
_STRAIGHT, _MOST_SKEW = 0.05, 0.5


@dataclass
class _Bridge:
    """Where loops a and b are joined: arc lengths of the middles, and the length of a bridge."""

    a: int
    b: int
    at_a_mm: float
    at_b_mm: float
    length_mm: float


def merged_loops(
    loops: list[LinkableTrack], others: list[LinkableTrack], raster: SectionRaster,
    rules: LinkRules, places: BridgePlaces | None = None,
) -> list[LinkableTrack]:
    """All loops joined into as few as bridges allow, and the other lines after them.

    places : those of these loops and other lines, in this order; found where they are not given
    """
    if len(loops) < 2:
        return [*loops, *others]
    table = np.vstack([line.table for line in (*loops, *others)])
    starts = np.cumsum([0, *(len(line.table) for line in (*loops, *others))])
    points = table[:, :2]
    if places is None:
        places = bridge_places(
            points, starts, len(loops), raster, rules.pitch_mm, rules.longest_bridge_mm,
            rules.least_depth_mm)
    usable = places.skew <= _MOST_SKEW
    for column in range(3, table.shape[1]):
        usable &= np.abs(table[places.vertex, column] - table[places.other, column]) \
            <= rules.mixture_step + 1e-9
    vertex, other = places.vertex[usable], places.other[usable]
    skew = places.skew[usable]
    rank = np.where(skew <= _STRAIGHT, 0, 1)  # bridges across first, slanting ones at need
    order = np.lexsort((_seam_distance(points, vertex, rules), rank))
    vertex, other = vertex[order], other[order]
    # What bridges are longer, the stretches they replace are too.
    gap = (places.gap_mm[usable] * (1 + skew))[order]
    arcs = [arc_lengths_of(loop) for loop in loops]
    bridges = _spanning_bridges(vertex, other, gap, starts, arcs)
    return [*_assembled(loops, arcs, bridges, rules), *others]


def _spanning_bridges(
    vertex: IntArray, other: IntArray, gap_mm: FloatArray, starts: IndexArray,
    arcs: list[FloatArray],
) -> list[_Bridge]:
    """Bridges that join all loops that can be, none to a loop twice; the first places first."""
    if len(vertex) == 0:
        return []
    loop = np.searchsorted(starts, vertex, side="right") - 1
    beside = np.searchsorted(starts, other, side="right") - 1
    along = np.concatenate(arcs)
    at_loop, at_beside = along[vertex], along[other]
    size = np.maximum(gap_mm, 1e-6)
    order, bounds = _by_pair(loop, beside)
    chosen = _spanning_kernel(
        order, bounds, loop, beside, at_loop, at_beside, size,
        np.array([arc[-1] for arc in arcs]), _MOST_PLACES, _APART, MIN_LOOP_BRIDGE_LENGTHS)
    return [
        _Bridge(int(loop[k]), int(beside[k]), float(at_loop[k]), float(at_beside[k]),
                float(size[k]))
        for k in chosen.tolist()]


@inner_kernel
def _root(root: IntArray, number: int) -> int:
    while root[number] != number:
        root[number] = root[root[number]]
        number = root[number]
    return number


@inner_kernel
def _is_free(
    used_at: FloatArray, used_size: FloatArray, newest: IntArray, before: IntArray, loop: int,
    at: float, size: float, whole: float, apart: float, least_lengths: float,
) -> bool:
    """Whether a loop has room for a bridge beside those that it has."""
    if whole < least_lengths * size:
        return False
    k = newest[loop]
    while k >= 0:
        away = abs(at - used_at[k])
        if min(away, whole - away) < apart * max(size, used_size[k]):
            return False
        k = before[k]
    return True


@kernel
def _spanning_kernel(
    order: IndexArray, bounds: IndexArray, loop: IndexArray, beside: IndexArray,
    at_loop: FloatArray, at_beside: FloatArray, size: FloatArray, whole: FloatArray,
    most_places: int, apart: float, least_lengths: float,
) -> IntArray:
    """Numbers of the places chosen, pair by pair; a pair's are order[bounds[p]:bounds[p + 1]]."""
    n = len(whole)
    root = np.arange(n)
    newest = np.full(n, -1, np.int64)  # of each loop's bridges; `before` is the one before that
    before = np.empty(2 * n, np.int64)
    used_at, used_size = np.empty(2 * n), np.empty(2 * n)
    chosen = np.empty(n, np.int64)
    count = 0
    for pair in range(len(bounds) - 1):
        first = order[bounds[pair]]
        if _root(root, loop[first]) == _root(root, beside[first]):
            continue
        for e in range(bounds[pair], min(bounds[pair + 1], bounds[pair] + most_places)):
            k = order[e]
            if not (_is_free(used_at, used_size, newest, before, loop[k], at_loop[k], size[k],
                             whole[loop[k]], apart, least_lengths)
                    and _is_free(used_at, used_size, newest, before, beside[k], at_beside[k],
                                 size[k], whole[beside[k]], apart, least_lengths)):
                continue
            root[_root(root, beside[k])] = _root(root, loop[k])
            for end in range(2):
                one, at = (loop[k], at_loop[k]) if end == 0 else (beside[k], at_beside[k])
                entry = 2 * count + end
                used_at[entry], used_size[entry] = at, size[k]
                before[entry], newest[one] = newest[one], entry
            chosen[count] = k
            count += 1
            break
    return chosen[:count].copy()


def _by_pair(loop: IndexArray, beside: IndexArray) -> tuple[IndexArray, IndexArray]:
    """The places of each two loops, in their order, those with the foremost one first; and where
    those of each pair begin, (pairs + 1,)."""
    low, high = np.minimum(loop, beside), np.maximum(loop, beside)
    order = np.argsort(low * (int(high.max()) + 1) + high, kind="stable")
    key = (low * (int(high.max()) + 1) + high)[order]
    begin = np.flatnonzero(np.append(True, key[1:] != key[:-1]))
    size = np.diff(np.append(begin, len(order)))
    by_first = np.argsort(order[begin])
    begin, size = begin[by_first], size[by_first]
    bounds = np.append(0, np.cumsum(size))
    within = np.arange(len(order)) - np.repeat(bounds[:-1], size)
    return order[np.repeat(begin, size) + within], bounds


def _assembled(
    loops: list[LinkableTrack], arcs: list[FloatArray], bridges: list[_Bridge], rules: LinkRules
) -> list[LinkableTrack]:
    """The trees of loops, each walked as one closed line."""
    cuts: list[list[tuple[float, float, int, float]]] = [[] for _ in loops]
    for bridge in bridges:
        cuts[bridge.a].append((bridge.at_a_mm, bridge.length_mm, bridge.b, bridge.at_b_mm))
        cuts[bridge.b].append((bridge.at_b_mm, bridge.length_mm, bridge.a, bridge.at_a_mm))
    done = [False] * len(loops)
    merged = []
    for number, loop in enumerate(loops):
        if done[number]:
            continue
        if not cuts[number]:
            merged.append(loop)
            continue
        pieces = _walk_of_tree(number, loops, arcs, cuts, done)
        table = np.vstack([*pieces, pieces[0][:1]])
        merged.append(LinkableTrack(densified_polyline(table, rules.spacing_mm), True, loop.island))
    return merged


def _walk_of_tree(
    first: int, loops: list[LinkableTrack], arcs: list[FloatArray],
    cuts: list[list[tuple[float, float, int, float]]], done: list[bool],
) -> list[FloatArray]:
    """Stretches of a tree of loops in the order of one closed walk.

    A frame of the stack is a loop, the stretches of it still to walk (from, to, next loop or −1),
    and whether it is walked backwards.
    """
    pieces: list[FloatArray] = []
    stack = [iter(_stretches(arcs[first][-1], cuts[first], None, forward=True))]
    at_loop = [(first, True)]
    done[first] = True
    while stack:
        loop, _ = at_loop[-1]
        step = next(stack[-1], None)
        if step is None:
            stack.pop()
            at_loop.pop()
            continue
        begin, end, child, entry = step
        pieces.append(rows_between_arc_lengths(loops[loop].table, arcs[loop], begin, end))
        if child < 0:
            continue
        done[child] = True
        forward = _goes_forward(pieces[-1][-1], loops[child].table, arcs[child], entry)
        stack.append(iter(_stretches(arcs[child][-1], cuts[child], entry[0], forward=forward)))
        at_loop.append((child, forward))
    return pieces


def _stretches(
    loop_mm: float, cuts: list[tuple[float, float, int, float]], entry_mm: float | None, *,
    forward: bool,
) -> list[tuple[float, float, int, tuple[float, float]]]:
    """Stretches between cuts, from the entry all round; with the loop to visit after each.

    Arc lengths run on beyond the whole, or below 0 where the loop is walked backwards.
    entry_mm : the cut by which the loop is entered; None for the first loop of a walk
    returns : (from, to, loop visited then or −1, (cut on that loop, gap there))
    """
    sense = 1.0 if forward else -1.0
    first = min(cuts) if entry_mm is None else next(c for c in cuts if c[0] == entry_mm)
    begin = first[0] + sense * first[1] / 2
    rest = sorted((sense * (cut[0] - first[0]) % loop_mm, cut) for cut in cuts if cut is not first)
    found = []
    at = begin
    for away, (_, gap, child, child_cut) in rest:
        middle = first[0] + sense * away
        found.append((at, middle - sense * gap / 2, child, (child_cut, gap)))
        at = middle + sense * gap / 2
    end = first[0] + sense * (loop_mm - first[1] / 2)
    last = (first[2], (first[3], first[1])) if entry_mm is None else (-1, (0.0, 0.0))
    found.append((at, end, *last))
    return found


def _goes_forward(
    here: FloatArray, table: FloatArray, arc_mm: FloatArray, entry: tuple[float, float]
) -> bool:
    """Whether a loop cut open is entered at the end of its gap, the way its arc lengths rise."""
    cut, gap = entry
    table = np.ascontiguousarray(table)
    away = [hypot(x - here[0], y - here[1]) for x, y in (
        point_at_arc_length(table, arc_mm, cut - gap / 2),
        point_at_arc_length(table, arc_mm, cut + gap / 2))]
    return away[1] < away[0]


def _seam_distance(points_mm: FloatArray, vertex: IntArray, rules: LinkRules) -> FloatArray:
    """How far vertices are from where the seam is wanted: in mm of a point, else in radians.

    points_mm : of all tracks, whose mean is the middle that angles are measured from
    """
    if rules.seam_mm is not None:
        return np.asarray(np.linalg.norm(points_mm[vertex] - np.array(rules.seam_mm), axis=1))
    arm = points_mm[vertex] - points_mm.mean(axis=0)
    angle = np.arctan2(arm[:, 1], arm[:, 0]) - rules.seam_angle
    return np.asarray(np.abs((angle + np.pi) % (2 * np.pi) - np.pi))
