"""Order tracks group by group, always the one whose entry is nearest, from vertex to vertex.

Entries are looked up in square bins, so that the time grows in proportion to the tracks. Of equally
near entries, that of the track with the lowest number comes first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import BoolArray, FloatArray, IndexArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel

#: How a change of mixture (volume fraction) weighs against a turn of a closed track's start.
_TURNS_PER_FRACTION = 5.0
#: How a change of mixture weighs against travel, in choosing the end of an open track [mm].
_MM_PER_FRACTION = 100.0
#: Bins are made anew when this part of the tracks in them is done.
_DONE_PART = 0.5


@inner_kernel
def _change(fractions: FloatArray, vertex: int, mixture: FloatArray) -> float:
    most = 0.0
    for k in range(len(mixture)):
        most = max(most, abs(fractions[vertex, k] - mixture[k]))
    return most


@inner_kernel
def _bins(
    x: FloatArray, y: FloatArray, track: IntArray, count: int, is_done: BoolArray
) -> tuple[int, float, float, float, int, int, IntArray]:
    """Sort `count` entries in place into bins, leaving out those of tracks that are done.

    returns : entries left, lowest x and y, side of a bin, bins along x and y, and the first entry
        of each bin, row by row
    """
    left = 0
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for e in range(count):
        if is_done[track[e]]:
            continue
        x[left], y[left], track[left] = x[e], y[e], track[e]
        low_x, high_x = min(low_x, x[left]), max(high_x, x[left])
        low_y, high_y = min(low_y, y[left]), max(high_y, y[left])
        left += 1
    wide, high = high_x - low_x, high_y - low_y
    side = max(np.sqrt(wide * high / left), max(wide, high) / left)
    if side <= 0.0:
        side = 1.0
    nx, ny = int(wide / side) + 1, int(high / side) + 1
    home = np.empty(left, np.int64)
    first = np.zeros(nx * ny + 1, np.int64)
    for e in range(left):
        home[e] = int((y[e] - low_y) / side) * nx + int((x[e] - low_x) / side)
        first[home[e] + 1] += 1
    for cell in range(nx * ny):
        first[cell + 1] += first[cell]
    place = first.copy()
    old_x, old_y, old_track = x[:left].copy(), y[:left].copy(), track[:left].copy()
    for e in range(left):
        at = place[home[e]]
        place[home[e]] += 1
        x[at], y[at], track[at] = old_x[e], old_y[e], old_track[e]
    return left, low_x, low_y, side, nx, ny, first


@inner_kernel
def _nearest(
    x: FloatArray, y: FloatArray, track: IntArray, is_done: BoolArray, low_x: float, low_y: float,
    side: float, nx: int, ny: int, first: IntArray, px: float, py: float,
) -> int:
    """The track not done whose entry is nearest to a place: bins in rings around that of the place.
    """
    i = min(max(int((px - low_x) / side), 0), nx - 1)
    j = min(max(int((py - low_y) / side), 0), ny - 1)
    found, least = -1, np.inf
    for ring in range(max(nx, ny)):
        for row in range(max(0, j - ring), min(ny, j + ring + 1)):
            is_edge = row == j - ring or row == j + ring
            for column in range(i - ring, i + ring + 1, 1 if is_edge or ring == 0 else 2 * ring):
                if column < 0 or column >= nx:
                    continue
                for e in range(first[row * nx + column], first[row * nx + column + 1]):
                    if is_done[track[e]]:
                        continue
                    d = (x[e] - px) ** 2 + (y[e] - py) ** 2
                    if d < least or (d == least and track[e] < found):
                        found, least = track[e], d
        if least < (ring * side) ** 2:  # what lies beyond the ring is farther
            break
    return found


@inner_kernel
def _enter_closed(
    t: int, starts: IndexArray, along: FloatArray, fractions: FloatArray, preferred: int,
    mixture: FloatArray, is_known: bool,
) -> int:
    """The vertex of a closed track to begin at: the preferred one, or one nearer in mixture."""
    a, b = starts[t], starts[t + 1] - 1
    at = preferred
    if is_known:
        whole = along[b]
        best = np.inf
        for v in range(a, b):
            turn = abs(along[v] - along[preferred]) / whole
            change = np.round(_change(fractions, v, mixture), 3)
            cost = min(turn, 1 - turn) + _TURNS_PER_FRACTION * change
            if cost < best:
                best, at = cost, v
    return a if at == b else at  # the last vertex is the first again


@kernel
def vertices_nearest_first(
    points: FloatArray, starts: IndexArray, along: FloatArray, fractions: FloatArray,
    closed: BoolArray, directed: BoolArray, sequence: IndexArray, bounds: IndexArray,
    preferred: IndexArray, reverse: bool, at_mm: FloatArray, last: FloatArray, has_last: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Vertices of m tracks in the order in which they are deposited, (n,), and where each track
    begins among them, (m + 1,).

    points : (n, 2); starts : (m + 1,) of tracks; along : (n,) length from each track's first vertex
    fractions : (n, materials); closed, directed : (m,); preferred : (m,) vertex to begin closed
        tracks at
    sequence : (m,) tracks group by group; bounds : (groups + 1,) of the groups in it
    reverse : closed tracks are deposited backwards
    at_mm : (2,) where the nozzle comes from; last : (materials,) mixture there, if `has_last`
    """
    m = len(sequence)
    order, first, backwards = np.empty(m, np.int64), np.empty(m, np.int64), np.zeros(m, np.bool_)
    ex, ey, owner = np.empty(2 * m), np.empty(2 * m), np.empty(2 * m, np.int64)
    is_done = np.zeros(m, np.bool_)
    x, y = at_mm[0], at_mm[1]
    mixture = last.copy()
    known = has_last
    done = 0
    for g in range(len(bounds) - 1):
        count, left = 0, bounds[g + 1] - bounds[g]
        for k in range(bounds[g], bounds[g + 1]):
            t = sequence[k]
            a, b = starts[t], starts[t + 1] - 1
            ends = 1 if closed[t] or directed[t] else 2
            for end in range(ends):
                v = preferred[t] if closed[t] else (a if end == 0 else b)
                ex[count], ey[count], owner[count] = points[v, 0], points[v, 1], t
                count += 1
        anew = left
        while left > 0:
            if left == anew:
                count, low_x, low_y, side, nx, ny, cells = _bins(ex, ey, owner, count, is_done)
                anew = int((1 - _DONE_PART) * left)
            t = _nearest(ex, ey, owner, is_done, low_x, low_y, side, nx, ny, cells, x, y)
            is_done[t] = True
            left -= 1
            a, b = starts[t], starts[t + 1] - 1
            order[done] = t
            if closed[t]:
                leave = _enter_closed(t, starts, along, fractions, preferred[t], mixture, known)
                first[done], backwards[done] = leave, reverse
            else:
                cost_a = np.sqrt((points[a, 0] - x) ** 2 + (points[a, 1] - y) ** 2)
                cost_b = np.sqrt((points[b, 0] - x) ** 2 + (points[b, 1] - y) ** 2)
                if known:
                    cost_a += _MM_PER_FRACTION * _change(fractions, a, mixture)
                    cost_b += _MM_PER_FRACTION * _change(fractions, b, mixture)
                at_b = (cost_b < cost_a or (cost_b == cost_a and reverse)) and not directed[t]
                first[done], backwards[done] = b if at_b else a, at_b
                leave = a if at_b else b
            done += 1
            x, y = points[leave, 0], points[leave, 1]
            for k in range(len(mixture)):
                mixture[k] = fractions[leave, k]
            known = True
    vertex = np.empty(len(points), np.int64)
    begins = np.zeros(m + 1, np.int64)
    n = 0
    for k in range(m):
        t = order[k]
        a, b = starts[t], starts[t + 1] - 1
        v, step = first[k], -1 if backwards[k] else 1
        for _ in range(a, b + 1):
            vertex[n] = v
            n += 1
            v += step
            if closed[t]:  # past the seam; the last vertex is the first again
                if v >= b and step > 0:
                    v = a
                elif v < a:
                    v = b - 1
        begins[k + 1] = n
    return vertex, begins
