"""Fewer starts: neighbouring closed tracks become one, and open ones are joined to them.

Two closed tracks side by side become one where a stretch of each is replaced by two bridges: the
nozzle leaves the first, goes all round the second and comes back. The stretches are as long as the
bridges, so what is deposited stays the same. All closed tracks of a region so become one (a
spanning tree of bridges). An open track goes on into a closed one that it ends beside, or into
another open one.

Bridges are short, stay inside the material, join equal mixtures, and lie where the seam would be.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.field.kernel import kernel
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.plane_values import plane_values
from lmctl.plan.polyline import densified

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

#: The longest bridge, in pitches.
LONGEST_BRIDGE = 1.5
#: Two bridges on one track keep so many bridge lengths between their middles.
_APART = 2.5
#: Bridges may be longer than the gap they span by this part; at need, by this.
_STRAIGHT, _MOST_SKEW = 0.05, 0.5
#: A closed track is at least so many bridge lengths long to be cut.
_LEAST_LOOP = 2.6
#: How deep inside the outline a bridge has to stay, in pitches.
_LEAST_DEPTH = 0.2


@dataclass(frozen=True)
class Line:
    """A track while it is linked.

    table : (k, 3 + materials) float64: x, y, strip width [mm], volume fractions
    """

    table: FloatArray
    is_closed: bool
    island: int


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


def linked(lines: list[Line], raster: SectionRaster, rules: LinkRules) -> list[Line]:
    """The same deposit in fewer tracks."""
    if len(lines) < 2:
        return lines
    loops = [line for line in lines if line.is_closed]
    merged = _merged_loops(loops, [line for line in lines if not line.is_closed], raster, rules)
    return _with_open_ends(merged, raster, rules)


@dataclass
class _Bridge:
    """Where loops a and b are joined: arc lengths of the middles, and the length of a bridge."""

    a: int
    b: int
    at_a_mm: float
    at_b_mm: float
    length_mm: float


def _merged_loops(
    loops: list[Line], others: list[Line], raster: SectionRaster, rules: LinkRules
) -> list[Line]:
    """All loops joined into as few as bridges allow, and the other lines after them."""
    if len(loops) < 2:
        return [*loops, *others]
    every = [*loops, *others]
    points = np.vstack([line.table[:, :2] for line in every])
    starts = np.cumsum([0, *(len(line.table) for line in every)])
    owner = np.repeat(np.arange(len(every)), np.diff(starts))
    near, gap = _nearest_kernel(points, owner, rules.pitch_mm * LONGEST_BRIDGE)
    usable = (near >= 0) & (owner < len(loops))
    usable[usable] &= owner[near[usable]] < len(loops)
    candidates = np.flatnonzero(usable)
    if len(candidates) == 0:
        return every
    mixture = np.vstack([line.table[:, 3:] for line in every])
    equal = np.abs(mixture[candidates] - mixture[near[candidates]]).max(axis=1) \
        <= rules.mixture_step + 1e-9
    middle = (points[candidates] + points[near[candidates]]) / 2
    deep = plane_values(raster.depth_mm, raster.grid, middle) > _LEAST_DEPTH * rules.pitch_mm
    candidates = candidates[equal & deep]
    arcs = [_arcs(loop) for loop in loops]
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
    points: FloatArray, along_mm: FloatArray, starts: IndexArray, owner: IndexArray,
    candidates: IndexArray, near: IndexArray, gap: FloatArray,
) -> FloatArray:
    """By how much the two bridges at each candidate are longer than the gap they are to span."""
    whole = along_mm[starts[1:] - 1]
    offset = np.concatenate([[0.0], np.cumsum(whole + 1.0)])[:-1]
    every = along_mm + np.repeat(offset, np.diff(starts))
    half = gap[candidates] / 2

    def beside(vertices: IndexArray, by_mm: FloatArray) -> FloatArray:
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
    candidates: IndexArray, near: IndexArray, gap: FloatArray, owner: IndexArray,
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
        if whole < _LEAST_LOOP * size_mm:
            return False
        return all(
            min(abs(at_mm - other), whole - abs(at_mm - other)) >= _APART * max(size_mm, size)
            for other, size in used[loop])

    bridges: list[_Bridge] = []
    for vertex in candidates.tolist():
        if len(bridges) == len(length_mm) - 1:  # all loops are one
            break
        other = int(near[vertex])
        a, b = int(owner[vertex]), int(owner[other])
        if found(a) == found(b):
            continue
        size = max(float(gap[vertex]), 1e-6)
        at_a, at_b = float(along_mm[vertex]), float(along_mm[other])
        if is_free(a, at_a, size) and is_free(b, at_b, size):
            root[found(b)] = found(a)
            used[a].append((at_a, size))
            used[b].append((at_b, size))
            bridges.append(_Bridge(a, b, at_a, at_b, size))
    return bridges


def _assembled(
    loops: list[Line], arcs: list[FloatArray], bridges: list[_Bridge], rules: LinkRules
) -> list[Line]:
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
        merged.append(Line(densified(table, rules.spacing_mm), True, loop.island))
    return merged


def _walk_of_tree(
    first: int, loops: list[Line], arcs: list[FloatArray],
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
        pieces.append(_stretch(loops[loop].table, arcs[loop], begin, end))
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
    ends = _at(table, arc_mm, np.array([cut - gap / 2, cut + gap / 2]))[:, :2]
    away = np.linalg.norm(ends - here[:2], axis=1)
    return bool(away[1] < away[0])


def _with_open_ends(
    lines: list[Line], raster: SectionRaster, rules: LinkRules
) -> list[Line]:
    """Open lines joined, end by end, to closed lines and to each other, the nearest first."""
    joined: list[Line] = []
    for island in sorted({line.island for line in lines}):
        joined += _with_open_ends_of(
            [line for line in lines if line.island == island], raster, rules)
    return joined


def _with_open_ends_of(
    lines: list[Line], raster: SectionRaster, rules: LinkRules
) -> list[Line]:
    """`_with_open_ends` of one island."""
    known = dict(enumerate(lines))
    number = len(lines)
    nearest: dict[tuple[int, int], tuple[float, int, int] | None] = {}
    while True:
        for key, line in known.items():
            for end in (0, -1):
                if not line.is_closed and (key, end) not in nearest:
                    nearest[key, end] = _nearest_line(key, end, known, raster, rules)
        found = [(best[0], key, end, best) for (key, end), best in nearest.items()
                 if best is not None]
        if not found:
            return list(known.values())
        _, key, end, (_, other, vertex) = min(found)
        joined = _joined(known.pop(key), end, known.pop(other), vertex, rules)
        gone = {key, other}
        # An end without a neighbour gets none: what is joined lies where its parts lay.
        nearest = {(k, e): best for (k, e), best in nearest.items()
                   if k not in gone and (best is None or best[1] not in gone)}
        known[number] = joined
        number += 1


def _nearest_line(
    number: int, end: int, lines: dict[int, Line], raster: SectionRaster, rules: LinkRules
) -> tuple[float, int, int] | None:
    """Distance, number and vertex of the line that an end of an open line may go on into."""
    here = lines[number].table[end]
    best = None
    for other, target in lines.items():
        if other == number:
            continue
        candidate = _nearest_on(here, target, raster, rules)
        if candidate is not None and (best is None or candidate[0] < best[0]):
            best = (candidate[0], other, candidate[1])
    return best


def _nearest_on(
    here: FloatArray, target: Line, raster: SectionRaster, rules: LinkRules
) -> tuple[float, int] | None:
    """Distance to a line and its vertex, where a bridge may go; of open ones an end only."""
    table = target.table if target.is_closed else target.table[[0, -1]]
    away = np.hypot(table[:, 0] - here[0], table[:, 1] - here[1])
    nearest = int(np.argmin(away))
    if away[nearest] > LONGEST_BRIDGE * rules.pitch_mm:
        return None
    if np.abs(table[nearest, 3:] - here[3:]).max() > rules.mixture_step + 1e-9:
        return None
    way = here[:2] + np.linspace(0, 1, 5)[1:-1, None] * (table[nearest, :2] - here[:2])
    depth = plane_values(raster.depth_mm, raster.grid, way)
    if depth.min() < _LEAST_DEPTH * rules.pitch_mm:
        return None
    return float(away[nearest]), nearest


def _joined(line: Line, end: int, target: Line, vertex: int, rules: LinkRules) -> Line:
    """An open line that goes on, from its end, into another one."""
    table = line.table if end == -1 else line.table[::-1]
    onward = target.table
    if target.is_closed:
        arc = _arcs(target)
        gap = min(float(np.hypot(*(onward[vertex, :2] - table[-1, :2]))), arc[-1] / _LEAST_LOOP)
        onward = _stretch(onward, arc, float(arc[vertex]), float(arc[vertex] + arc[-1] - gap))
    elif vertex == 1:
        onward = onward[::-1]
    return Line(densified(np.vstack([table, onward]), rules.spacing_mm), False, line.island)


def _arcs(line: Line) -> FloatArray:
    steps = np.linalg.norm(np.diff(line.table[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _at(table: FloatArray, arc_mm: FloatArray, at_mm: FloatArray) -> FloatArray:
    """Rows of a closed line at arc lengths, taken round."""
    at = at_mm % arc_mm[-1]
    return np.stack([np.interp(at, arc_mm, column) for column in table.T], axis=1)


def _stretch(
    table: FloatArray, arc_mm: FloatArray, begin_mm: float, end_mm: float
) -> FloatArray:
    """Rows of a closed line from one arc length to another, forwards or backwards."""
    whole = float(arc_mm[-1])
    low, high = min(begin_mm, end_mm), max(begin_mm, end_mm)
    turns = np.arange(np.floor(low / whole), np.floor(high / whole) + 1)
    inner = (turns[:, None] * whole + arc_mm[:-1]).ravel()
    inner = inner[(inner > low + 1e-9) & (inner < high - 1e-9)]
    at = np.concatenate([[low], inner, [high]])
    rows = _at(table, arc_mm, at)
    return rows if begin_mm <= end_mm else rows[::-1]


def _seam_distance(points_mm: FloatArray, rules: LinkRules) -> FloatArray:
    """How far points are from where the seam is wanted: in mm of a point, else in radians."""
    if rules.seam_mm is not None:
        return np.asarray(np.linalg.norm(points_mm - np.array(rules.seam_mm), axis=1))
    arm = points_mm - points_mm.mean(axis=0)
    angle = np.arctan2(arm[:, 1], arm[:, 0]) - rules.seam_angle
    return np.asarray(np.abs((angle + np.pi) % (2 * np.pi) - np.pi))


@kernel
def _nearest_kernel(
    points: FloatArray, owner: IndexArray, reach: float
) -> tuple[IndexArray, FloatArray]:
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
