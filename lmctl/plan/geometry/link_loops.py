"""Join neighbouring closed tracks: walk once around a spanning tree of pairs of bridges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.link_lines import (
    MIN_LOOP_BRIDGE_LENGTHS,
    LinkableTrack,
    LinkRules,
    arc_lengths_of,
    rows_at_arc_lengths,
    rows_between_arc_lengths,
)
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.plane_values import interpolate_bilinear
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
    loops: list[LinkableTrack], others: list[LinkableTrack], raster: SectionRaster, rules: LinkRules
) -> list[LinkableTrack]:
    """All loops joined into as few as bridges allow, and the other lines after them."""
    if len(loops) < 2:
        return [*loops, *others]
    every = [*loops, *others]
    points = np.vstack([line.table[:, :2] for line in every])
    starts = np.cumsum([0, *(len(line.table) for line in every)])
    owner = np.repeat(np.arange(len(every)), np.diff(starts))
    near, gap = _nearest_kernel(points, owner, rules.longest_bridge_mm)
    usable = (near >= 0) & (owner < len(loops))
    usable[usable] &= owner[near[usable]] < len(loops)
    candidates = np.flatnonzero(usable)
    if len(candidates) == 0:
        return every
    mixture = np.vstack([line.table[:, 3:] for line in every])
    equal = np.abs(mixture[candidates] - mixture[near[candidates]]).max(axis=1) \
        <= rules.mixture_step + 1e-9
    middle = (points[candidates] + points[near[candidates]]) / 2
    deep = interpolate_bilinear(raster.depth_mm, raster.grid, middle) > rules.least_depth_mm
    candidates = candidates[equal & deep]
    arcs = [arc_lengths_of(loop) for loop in loops]
    along = np.concatenate(arcs)
    skew = _skew(
        points[: len(along)], along, starts[: len(loops) + 1], owner, candidates, near, gap)
    rank = np.where(skew <= _STRAIGHT, 0, 1)  # bridges across first, slanting ones at need
    order = np.lexsort((_seam_distance(points, rules)[candidates], rank))
    gap[candidates] *= 1 + skew  # what bridges are longer, the stretches they replace are too
    candidates = candidates[order][skew[order] <= _MOST_SKEW]
    length = np.array([arc[-1] for arc in arcs])
    bridges = _spanning_bridges(candidates, near, gap, owner, along, length)
    return [*_assembled(loops, arcs, bridges, rules), *others]


def _skew(
    points: FloatArray, along_mm: FloatArray, starts: IntArray, owner: IntArray,
    candidates: IntArray, near: IntArray, gap: FloatArray,
) -> FloatArray:
    """By how much the two bridges at each candidate are longer than the gap they are to span."""
    whole = along_mm[starts[1:] - 1]
    offset = np.concatenate([[0.0], np.cumsum(whole + 1.0)])[:-1]
    every = along_mm + np.repeat(offset, np.diff(starts))
    half = gap[candidates] / 2

    def beside(vertices: IntArray, by_mm: FloatArray) -> FloatArray:
        loop = owner[vertices]
        at = offset[loop] + (along_mm[vertices] + by_mm) % whole[loop]
        return np.stack([np.interp(at, every, points[:, k]) for k in (0, 1)], axis=1)

    a = beside(candidates, -half), beside(candidates, half)
    b = beside(near[candidates], -half), beside(near[candidates], half)

    def span(p: FloatArray, q: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(p - q, axis=1))

    total = np.minimum(span(a[0], b[0]) + span(a[1], b[1]), span(a[0], b[1]) + span(a[1], b[0]))
    return np.asarray(total / np.maximum(2 * gap[candidates], 1e-9) - 1)


def _spanning_bridges(
    candidates: IntArray, near: IntArray, gap: FloatArray, owner: IntArray,
    along_mm: FloatArray, length_mm: FloatArray,
) -> list[_Bridge]:
    """Bridges that join all loops that can be, none to a loop twice; the first candidates first."""
    root = list(range(len(length_mm)))
    used: list[list[tuple[float, float]]] = [[] for _ in root]

    def found(loop: int) -> int:
        while root[loop] != loop:
            root[loop] = root[root[loop]]
            loop = root[loop]
        return loop

    def is_free(loop: int, at_mm: float, size_mm: float) -> bool:
        whole = float(length_mm[loop])
        if whole < MIN_LOOP_BRIDGE_LENGTHS * size_mm:
            return False
        return all(
            min(abs(at_mm - other), whole - abs(at_mm - other)) >= _APART * max(size_mm, size)
            for other, size in used[loop])

    bridges: list[_Bridge] = []
    for places in _by_pair(candidates, near, owner):
        a, b = int(owner[places[0]]), int(owner[near[places[0]]])
        if found(a) == found(b):
            continue
        for vertex in places[:_MOST_PLACES].tolist():
            other = int(near[vertex])
            a, b = int(owner[vertex]), int(owner[other])
            size = max(float(gap[vertex]), 1e-6)
            at_a, at_b = float(along_mm[vertex]), float(along_mm[other])
            if is_free(a, at_a, size) and is_free(b, at_b, size):
                root[found(b)] = found(a)
                used[a].append((at_a, size))
                used[b].append((at_b, size))
                bridges.append(_Bridge(a, b, at_a, at_b, size))
                break
    return bridges


def _by_pair(candidates: IntArray, near: IntArray, owner: IntArray) -> list[IntArray]:
    """The candidates of each two loops, in their order; those with the foremost one first."""
    if len(candidates) == 0:
        return []
    pairs = np.sort(np.stack([owner[candidates], owner[near[candidates]]], axis=1), axis=1)
    key = pairs[:, 0] * (owner.max() + 1) + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    groups = np.split(order, starts[1:])
    groups.sort(key=lambda group: int(group[0]))
    return [candidates[group] for group in groups]


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
    whole_mm: float, cuts: list[tuple[float, float, int, float]], entry_mm: float | None, *,
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
    rest = sorted((sense * (cut[0] - first[0]) % whole_mm, cut) for cut in cuts if cut is not first)
    found = []
    at = begin
    for away, (_, gap, child, child_cut) in rest:
        middle = first[0] + sense * away
        found.append((at, middle - sense * gap / 2, child, (child_cut, gap)))
        at = middle + sense * gap / 2
    end = first[0] + sense * (whole_mm - first[1] / 2)
    last = (first[2], (first[3], first[1])) if entry_mm is None else (-1, (0.0, 0.0))
    found.append((at, end, *last))
    return found


def _goes_forward(
    here: FloatArray, table: FloatArray, arc_mm: FloatArray, entry: tuple[float, float]
) -> bool:
    """Whether a loop cut open is entered at the end of its gap, the way its arc lengths rise."""
    cut, gap = entry
    ends = rows_at_arc_lengths(table, arc_mm, np.array([cut - gap / 2, cut + gap / 2]))[:, :2]
    away = np.linalg.norm(ends - here[:2], axis=1)
    return bool(away[1] < away[0])


def _seam_distance(points_mm: FloatArray, rules: LinkRules) -> FloatArray:
    """How far points are from where the seam is wanted: in mm of a point, else in radians."""
    if rules.seam_mm is not None:
        return np.asarray(np.linalg.norm(points_mm - np.array(rules.seam_mm), axis=1))
    arm = points_mm - points_mm.mean(axis=0)
    angle = np.arctan2(arm[:, 1], arm[:, 0]) - rules.seam_angle
    return np.asarray(np.abs((angle + np.pi) % (2 * np.pi) - np.pi))


@kernel
def _nearest_kernel(
    points: FloatArray, owner: IntArray, reach: float
) -> tuple[IntArray, FloatArray]:
    """For each point the nearest one of another owner within reach, −1 for none; and how far."""
    n = len(points)
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    nx = int((points[:, 0].max() - low_x) / reach) + 1
    ny = int((points[:, 1].max() - low_y) / reach) + 1
    cell = np.empty(n, np.int64)
    count = np.zeros(nx * ny + 1, np.int64)
    for k in range(n):
        cell[k] = int((points[k, 1] - low_y) / reach) * nx + int((points[k, 0] - low_x) / reach)
        count[cell[k] + 1] += 1
    first = np.cumsum(count)
    place = first.copy()
    order = np.empty(n, np.int64)
    for k in range(n):
        order[place[cell[k]]] = k
        place[cell[k]] += 1
    near = np.full(n, -1, np.int64)
    gap = np.full(n, np.inf)
    for k in range(n):
        i, j = cell[k] % nx, cell[k] // nx
        least = reach * reach
        for jn in range(max(0, j - 1), min(ny, j + 2)):
            for im in range(max(0, i - 1), min(nx, i + 2)):
                for e in range(first[jn * nx + im], first[jn * nx + im + 1]):
                    other = order[e]
                    if owner[other] == owner[k]:
                        continue
                    d2 = (points[other, 0] - points[k, 0]) ** 2 + (
                        points[other, 1] - points[k, 1]) ** 2
                    if d2 < least:
                        least = d2
                        near[k] = other
                        gap[k] = np.sqrt(d2)
    return near, gap
