"""Read a field between its nodes with the closest points they hold.

Source: docs/explanation/multi-colour-distance-field.md, Geometry field.

Every node of a cell stores a point of the surface and the direction inwards there. Nodes whose
points lie on one smooth sheet measure a place q by

    d = Σ w ½ (n + n̂) · (q − c) / Σ w,    n̂ the mean normal at q,

which is exact for planes and of third order for curved sheets. Two points lie on one sheet if
(n₁ + n₂) · (c₂ − c₁) = 0, as it does for any arc of a circle, however they are turned; across an
edge it does not. Sheets that meet in a ridge bound an intersection, in a groove a union.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.field.triangles import closest_on_triangle

NEAR_PITCHES = 2.0  # farther from the surface than this trilinear values do
EDGE_PITCHES = 1.0  # so do they, where an edge or the medial axis is, farther than this
BEND = 0.15  # share of |n₂ − n₁||c₂ − c₁| by which points of one sheet may miss the circle
SAME_TURN = 1e-8  # squared: directions nearer to each other than this are one
SAME_POINT_PITCHES = 1e-6  # pitches: what is nearer than this is one, but for rounding
TIGHTEST = 0.45  # squared turn a pitch: a smooth sheet is no rounder than R 1.5 pitches


@kernel
def refine_distances(
    nodes: FloatArray, values: NDArray[np.float32], sources: NDArray[np.int32],
    surface: FloatArray, inwards: FloatArray, pitch: float, distance: FloatArray,
) -> None:
    """Improve trilinear distances near the surface, in place; in node units but for values.

    nodes : (n, 3) float64, places within the grid
    values : (nz, ny, nx) float32 [mm], the stored distances
    sources : (nz, ny, nx) int32, rows of `surface`, −1 for none
    surface : (m, 1, 3) points or (m, 3, 3) triangles
    inwards : (m, 3) directions inwards at points, or (0, 3): a triangle has its own
    distance : (n,) float64, trilinear on entry
    """
    nz, ny, nx = values.shape
    c, n, sheet = np.empty((8, 3)), np.empty((8, 3)), np.empty(8, dtype=np.int64)
    w, away, edge = np.empty(8), np.empty(8), np.empty(8, dtype=np.int64)
    height, lead, mean = np.empty(8), np.empty(8, dtype=np.int64), np.empty(3)
    meets = np.empty((8, 8), dtype=np.int64)
    for q in range(len(nodes)):
        if not abs(distance[q]) < NEAR_PITCHES:
            continue
        x, y, z = nodes[q, 0], nodes[q, 1], nodes[q, 2]
        i, j, k = min(int(x), nx - 2), min(int(y), ny - 2), min(int(z), nz - 2)
        known = True
        for m in range(8):
            im, jm, km = i + (m & 1), j + ((m >> 1) & 1), k + (m >> 2)
            w[m] = (
                (x - i if m & 1 else 1.0 - (x - i)) * (y - j if m & 2 else 1.0 - (y - j))
                * (z - k if m & 4 else 1.0 - (z - k))
            )
            row = int(np.int64(sources[km, jm, im]))
            known = known and row >= 0
            if known:
                _point_of(
                    surface, inwards, row, float(im), float(jm), float(km),
                    float(values[km, jm, im]), c, n, m,
                )
                known = n[m, 0] == n[m, 0]
            if not known:
                break
            away[m] = (x - c[m, 0]) ** 2 + (y - c[m, 1]) ** 2 + (z - c[m, 2]) ** 2
            sheet[m] = -1
        if not known:
            continue
        smooth = _smooth(c, n)
        if not smooth and abs(distance[q]) > EDGE_PITCHES:
            continue
        for m in range(8):
            edge[m] = not smooth and _on_an_edge(c, n, m)
        sheets = 0
        while True:
            first = _nearest_left(sheet, away)
            if first < 0:
                break
            mean[0] = mean[1] = mean[2] = 0.0
            for m in range(8):
                if sheet[m] != -1:
                    continue
                alone = edge[m] + edge[first] > 0
                if m == first or smooth or (not alone and _one_sheet(c, n, first, m)):
                    sheet[m] = sheets
                    for a in range(3):
                        mean[a] += (w[m] + 1e-9) * n[m, a]
            size = np.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2)
            total, height[sheets] = 0.0, 0.0
            for m in range(8):
                if sheet[m] == sheets:
                    along = 0.0
                    for a in range(3):
                        along += 0.5 * (n[m, a] + mean[a] / size) * (nodes[q, a] - c[m, a])
                    total += w[m] + 1e-9
                    height[sheets] += (w[m] + 1e-9) * along
            height[sheets] /= total
            lead[sheets] = first
            sheets += 1
        joined = _joined(c, n, sheet, lead, height, meets)
        if joined == joined:
            # A distance changes no faster than the place moves: the result must agree with every
            # node, the nearest above all.
            for turn in range(9):
                m = turn if turn < 8 else (x - i > 0.5) + 2 * (y - j > 0.5) + 4 * (z - k > 0.5)
                im, jm, km = i + (m & 1), j + ((m >> 1) & 1), k + (m >> 2)
                offset = np.sqrt((x - im) ** 2 + (y - jm) ** 2 + (z - km) ** 2)
                value = values[km, jm, im] / pitch
                joined = min(max(joined, value - offset), value + offset)
            distance[q] = joined


@inner_kernel
def _point_of(
    surface: FloatArray, inwards: FloatArray, row: int, x: float, y: float, z: float,
    value: float, c: FloatArray, n: FloatArray, m: int,
) -> None:
    """The surface point nearest to a node, and the direction inwards there (nan: not known)."""
    if surface.shape[1] == 3:
        c[m, 0], c[m, 1], c[m, 2], _ = closest_on_triangle(surface, row, x, y, z)
    else:
        c[m, 0], c[m, 1], c[m, 2] = surface[row, 0, 0], surface[row, 0, 1], surface[row, 0, 2]
    n[m, 0], n[m, 1], n[m, 2] = x - c[m, 0], y - c[m, 1], z - c[m, 2]
    size = np.sqrt(n[m, 0] ** 2 + n[m, 1] ** 2 + n[m, 2] ** 2)
    if size > SAME_POINT_PITCHES:
        if value < 0.0:
            size = -size
    elif len(inwards) > 0:
        n[m, 0], n[m, 1], n[m, 2], size = inwards[row, 0], inwards[row, 1], inwards[row, 2], 1.0
    else:
        size = np.nan
    n[m, 0], n[m, 1], n[m, 2] = n[m, 0] / size, n[m, 1] / size, n[m, 2] / size


@inner_kernel
def _nearest_left(sheet: NDArray[np.int64], away: FloatArray) -> int:
    """The nearest of the points that are on no sheet yet; −1 where there are no more."""
    first = -1
    for m in range(8):
        if sheet[m] == -1 and (first < 0 or away[m] < away[first]):
            first = m
    return first


@inner_kernel
def _smooth(c: FloatArray, n: FloatArray) -> bool:
    """Whether any two of the points may lie on one smooth sheet."""
    for m in range(8):
        for o in range(m):
            across, _, turn, apart, same = _between(c, n, o, m)
            if not (
                same > 0.3 and turn <= TIGHTEST * apart + SAME_POINT_PITCHES
                and abs(across) <= BEND * np.sqrt(turn * apart) + SAME_POINT_PITCHES
            ):
                return False
    return True


@inner_kernel
def _one_sheet(c: FloatArray, n: FloatArray, a: int, b: int) -> bool:
    """Whether two points lie on one smooth sheet, where not all around do.

    An edge turns directions, too, but not along the way between the points: here only what turns
    along the way counts, which leaves out the saddles that some smooth pairs lie across.
    """
    across, along, turn, _, same = _between(c, n, a, b)
    room = along * along / max(turn, 1e-30)
    return (
        same > 0.3 and turn <= TIGHTEST * room + SAME_POINT_PITCHES
        and abs(across) <= BEND * abs(along) + SAME_POINT_PITCHES
    )


@inner_kernel
def _between(
    c: FloatArray, n: FloatArray, a: int, b: int
) -> tuple[float, float, float, float, float]:
    """From point a to point b: (n₁ + n₂) and (n₂ − n₁), along the way; how far directions turn,
    and the way, both squared; n₁ · n₂."""
    across, along, turn, apart, same = 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(3):
        across += (n[a, e] + n[b, e]) * (c[b, e] - c[a, e])
        along += (n[b, e] - n[a, e]) * (c[b, e] - c[a, e])
        turn += (n[b, e] - n[a, e]) ** 2
        apart += (c[b, e] - c[a, e]) ** 2
        same += n[a, e] * n[b, e]
    return across, along, turn, apart, same


@inner_kernel
def _on_an_edge(c: FloatArray, n: FloatArray, m: int) -> bool:
    """Whether the point lies on another's plane, too, though that is turned differently."""
    for o in range(8):
        off, turn = 0.0, 0.0
        for e in range(3):
            off += n[o, e] * (c[m, e] - c[o, e])
            turn += (n[m, e] - n[o, e]) ** 2
        if abs(off) <= SAME_POINT_PITCHES and turn > SAME_TURN + SAME_POINT_PITCHES:
            return True
    return False


@inner_kernel
def _joined(
    c: FloatArray, n: FloatArray, sheet: NDArray[np.int64], lead: NDArray[np.int64],
    height: FloatArray, meets: NDArray[np.int64],
) -> float:
    """The distance the sheets give together; nan where it is unknown how they meet.

    meets (8, 8) : scratch; 1 where a pair meets in a ridge, −1 in a groove, 0 where the points
        of either lie on the other too, as those of an edge do
    """
    ridges, grooves = 0, 0
    sheets = 0
    for m in range(8):
        sheets = max(sheets, sheet[m] + 1)
    for s in range(sheets):
        for t in range(s):
            low, high = 0.0, 0.0
            for m in range(8):
                if sheet[m] != s and sheet[m] != t:
                    continue
                other = lead[t] if sheet[m] == s else lead[s]
                off = 0.0
                for a in range(3):
                    off += n[other, a] * (c[m, a] - c[other, a])
                low, high = min(low, off), max(high, off)
            if high > SAME_POINT_PITCHES and low < -SAME_POINT_PITCHES:
                return np.nan
            meets[s, t] = meets[t, s] = (
                1 if high > SAME_POINT_PITCHES else (-1 if low < -SAME_POINT_PITCHES else 0)
            )
            ridges += meets[s, t] == 1
            grooves += meets[s, t] == -1
    least, most = height[0], height[0]
    for s in range(1, sheets):
        least, most = min(least, height[s]), max(most, height[s])
    if grooves == 0:
        return float(least)
    if ridges == 0:
        return float(most)
    if sheets != 3:
        return np.nan
    # Of three sheets the pair that meets unlike the other two is joined first.
    a = 0 if meets[0, 1] == meets[0, 2] else (1 if meets[1, 0] == meets[1, 2] else 2)
    b, d = (a + 1) % 3, (a + 2) % 3
    if meets[b, d] > 0:
        return float(max(height[a], min(height[b], height[d])))
    return float(min(height[a], max(height[b], height[d])))
