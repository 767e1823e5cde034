"""The medial axis of a section: the ridge of the depth, read off the raster.

Between two neighbouring nodes whose nearest edges of the outline lie apart, the ridge crosses the
line that joins them where both edges are equally far. The crossings of a cell of the raster are
joined. Where the outline is seen under less than 20° from a crossing it is no ridge but the
polygon that approximates a curve. The middle of a disc then is a peak that no line of nodes need
cross: every peak of the raster has a point.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.section_raster import SectionRaster

NumberArray = TypeVar("NumberArray", FloatArray, IntArray)

#: Chord between the two nearest points of the outline over the depth: the least of a ridge, 20°
#: between the directions to both.
_LEAST_CHORD = 0.35
#: Largest slope of the depth along a ridge between opposite walls, each within 30° of parallel.
_OPPOSITE = 0.5
#: Two edges meet where their distances differ by no more than this [nodes]; tries at the most.
_MEETING, _MOST_TRIES = 1e-4, 12
#: Distances that differ by less, as a ratio, are equal.
_EQUALLY_FAR = 1e-3
#: How often the steps to a peak are halved.
_HALVINGS = 6


@dataclass(frozen=True)
class MedialAxis:
    """Points on the ridge of the depth, joined to a graph.

    points_mm : (v, 2) float64; depth_mm : (v,) float64, distance to the outline there
    slope : (v, 2) float64, gradient of the depth along the ridge, per mm
    is_central : (v,) bool, the walls lie opposite: within 30° of parallel, each
    links : (e, 2) int64, neighbouring points
    at_edge : (2, ny, nx) int32, the point on the raster's line from node (j, i) to (j, i + 1), or
        to (j + 1, i); −1 for none
    """

    points_mm: FloatArray
    depth_mm: FloatArray
    slope: FloatArray
    is_central: NDArray[np.bool_]
    links: IntArray
    at_edge: NDArray[np.int32]


def medial_axis(raster: SectionRaster) -> MedialAxis:
    """The medial axis within the outline, points in the part's coordinates."""
    ny, nx = raster.grid.shape
    at_edge = np.full((2, ny, nx), -1, dtype=np.int32)
    found = _crossings_kernel(
        raster.depth_mm, raster.segments, raster.ends, raster.nearest, raster.grid.pitch_mm,
        at_edge)
    joints, links = _links_kernel(
        found, at_edge, raster.segments, raster.nearest, raster.depth_mm, raster.grid.pitch_mm)
    peaks = _peaks(raster, at_edge, len(found) + len(joints))
    table = np.vstack([found, joints, peaks])
    return MedialAxis(
        points_mm=table[:, :2] + np.array(raster.grid.origin_mm), depth_mm=table[:, 2],
        slope=table[:, 3:5], is_central=np.hypot(table[:, 3], table[:, 4]) <= _OPPOSITE,
        links=links, at_edge=at_edge)


@inner_kernel
def closest_point_on_segment(segments: FloatArray, s: int, px: float,
                             py: float) -> tuple[float, float, float]:
    """Nearest point of a segment (x, y), and its distance."""
    ax, ay = segments[s, 0], segments[s, 1]
    ux, uy = segments[s, 2] - ax, segments[s, 3] - ay
    size = ux * ux + uy * uy
    t = 0.0
    if size > 0.0:
        t = min(1.0, max(0.0, ((px - ax) * ux + (py - ay) * uy) / size))
    x, y = ax + t * ux, ay + t * uy
    return x, y, np.sqrt((px - x) ** 2 + (py - y) ** 2)


@inner_kernel
def _resized(rows: NumberArray, count: int, size: int) -> NumberArray:
    """The first `count` rows in a table of another size."""
    table = np.empty((size, rows.shape[1]), rows.dtype)
    for k in range(count):
        for c in range(rows.shape[1]):
            table[k, c] = rows[k, c]
    return table


@inner_kernel
def _meeting(
    segments: FloatArray, a: int, b: int, i: int, j: int, ib: int, jb: int, pitch: float
) -> float:
    """Part of the way from node (j, i), nearest to edge a, to (jb, ib), nearest to b, where both
    are equally far: by false position, halving the value of an end that stays (Illinois)."""
    low, high = 0.0, 1.0
    at_low = _farther(segments, a, b, i * pitch, j * pitch)
    at_high = _farther(segments, a, b, ib * pitch, jb * pitch)
    if at_low >= 0.0 or at_high <= 0.0:
        return 0.0 if at_low >= 0.0 else 1.0
    t, moved = 0.5, 0
    for _ in range(_MOST_TRIES):
        t = (low * at_high - high * at_low) / (at_high - at_low)
        found = _farther(segments, a, b, (i + t * (ib - i)) * pitch, (j + t * (jb - j)) * pitch)
        if abs(found) <= _MEETING * pitch:
            break
        if found < 0.0:
            low, at_low = t, found
            at_high = at_high / 2 if moved == 1 else at_high
            moved = 1
        else:
            high, at_high = t, found
            at_low = at_low / 2 if moved == 2 else at_low
            moved = 2
    return t


@inner_kernel
def _farther(segments: FloatArray, a: int, b: int, x: float, y: float) -> float:
    """By how much edge a is farther from a place than edge b."""
    return (closest_point_on_segment(segments, a, x, y)[2]
            - closest_point_on_segment(segments, b, x, y)[2])


@inner_kernel
def _along(segments: FloatArray, ends: IntArray, s: int, px: float, py: float) -> int:
    """The edge of the same loop where the distance is least, walking from edge s."""
    best, least = s, closest_point_on_segment(segments, s, px, py)[2]
    first, last = ends[s, 0], ends[s, 1]
    for step in (-1, 1):
        at = s
        while True:
            at += step
            at = last if at < first else (first if at > last else at)
            away = closest_point_on_segment(segments, at, px, py)[2]
            if away >= (1 - _EQUALLY_FAR) * least:
                break
            best, least = at, away
    return best


@kernel
def _crossings_kernel(
    depth: NDArray[np.float32], segments: FloatArray, ends: IntArray, nearest: NDArray[np.int32],
    pitch: float, at_edge: NDArray[np.int32],
) -> FloatArray:
    """(v, 5): x, y, depth, gradient of the depth (x, y); fills `at_edge`."""
    ny, nx = depth.shape
    table = np.empty((256, 5))
    count = 0
    for j in range(ny):
        for i in range(nx):
            if depth[j, i] <= 0:
                continue
            for side in range(2):
                jb, ib = j + side, i + 1 - side
                if jb >= ny or ib >= nx or depth[jb, ib] <= 0:
                    continue
                a, b = nearest[j, i], nearest[jb, ib]
                if a == b:
                    continue
                ax, ay, _ = closest_point_on_segment(segments, a, i * pitch, j * pitch)
                bx, by, _ = closest_point_on_segment(segments, b, ib * pitch, jb * pitch)
                least = min(depth[j, i], depth[jb, ib])
                if (ax - bx) ** 2 + (ay - by) ** 2 < (0.5 * _LEAST_CHORD * least) ** 2:
                    continue
                t = _meeting(segments, a, b, i, j, ib, jb, pitch)
                x, y = (i + t * (ib - i)) * pitch, (j + t * (jb - j)) * pitch
                # Of a curve drawn with many edges, others may be the nearest at the crossing.
                at_a, at_b = _along(segments, ends, a, x, y), _along(segments, ends, b, x, y)
                if at_a == at_b:  # no ridge, only neighbours on one curve
                    continue
                if at_a != a or at_b != b:
                    a, b = at_a, at_b
                    t = _meeting(segments, a, b, i, j, ib, jb, pitch)
                    x, y = (i + t * (ib - i)) * pitch, (j + t * (jb - j)) * pitch
                ax, ay, away = closest_point_on_segment(segments, a, x, y)
                bx, by, other = closest_point_on_segment(segments, b, x, y)
                away = 0.5 * (away + other)
                if away <= 0.0:
                    continue
                chord = np.sqrt((ax - bx) ** 2 + (ay - by) ** 2) / away
                if chord < _LEAST_CHORD:
                    continue
                if count == len(table):
                    table = _resized(table, count, 2 * count)
                table[count, 0], table[count, 1], table[count, 2] = x, y, away
                table[count, 3] = (x - 0.5 * (ax + bx)) / away
                table[count, 4] = (y - 0.5 * (ay + by)) / away
                at_edge[side, j, i] = count
                count += 1
    return _resized(table, count, count)


def _peaks(raster: SectionRaster, at_edge: NDArray[np.int32], count: int) -> FloatArray:
    """Rows like those of the crossings for peaks without a point near, entered in `at_edge` from
    number `count` on."""
    nodes = _lone_peaks_kernel(raster.depth_mm, at_edge)
    pitch = raster.grid.pitch_mm
    rows = np.empty((len(nodes), 5))
    for n, (j, i) in enumerate(zip(*np.divmod(nodes, raster.grid.shape[1]), strict=True)):
        rows[n] = *climbed_to_peak(raster.segments, i * pitch, j * pitch, pitch / 2), 1.0, 0.0
        at_edge[0, j, i] = count + n
    return rows


@kernel
def _lone_peaks_kernel(depth: NDArray[np.float32], at_edge: NDArray[np.int32]) -> IntArray:
    """Flat indices of nodes deeper than those around them, without a point of the axis near."""
    ny, nx = depth.shape
    found = np.empty(ny * nx // 4 + 1, np.int64)  # no two are neighbours
    n = 0
    for j in range(1, ny - 1):
        for i in range(1, nx - 1):
            if depth[j, i] <= 0:
                continue
            is_peak = True
            for k in range(9):
                v, u = j + k // 3 - 1, i + k % 3 - 1
                higher = depth[v, u] > depth[j, i] if k < 4 else depth[v, u] >= depth[j, i]
                if k != 4 and higher:
                    is_peak = False
                    break
            if is_peak and not _has_point_near(at_edge, j, i):
                found[n] = j * nx + i
                n += 1
    return found[:n]


@inner_kernel
def _has_point_near(at_edge: NDArray[np.int32], j: int, i: int) -> bool:
    """Whether a line of the cells within two of a node is crossed."""
    ny, nx = at_edge.shape[1], at_edge.shape[2]
    for v in range(max(0, j - 2), min(ny, j + 3)):
        for u in range(max(0, i - 2), min(nx, i + 3)):
            if at_edge[0, v, u] >= 0 or at_edge[1, v, u] >= 0:
                return True
    return False


@kernel
def climbed_to_peak(
    segments: FloatArray, x: float, y: float, step: float
) -> tuple[float, float, float]:
    """Uphill over the depth from a place, by ever smaller steps: place and depth of the peak."""
    best = np.inf
    for s in range(len(segments)):
        best = min(best, closest_point_on_segment(segments, s, x, y)[2])
    least_step = step / 2**_HALVINGS
    while step > least_step:
        before = best
        step = min(step, 0.7 * best)  # diagonally too, no step leaves the outline
        for way in range(9):
            u, v = x + step * (way % 3 - 1), y + step * (way // 3 - 1)
            depth = np.inf
            for s in range(len(segments)):
                depth = min(depth, closest_point_on_segment(segments, s, u, v)[2])
                if depth <= best:
                    break
            if depth > best:
                x, y, best = u, v, depth
        if best <= before * (1 + 1e-9):
            step /= 2
    return x, y, best


@kernel
def _links_kernel(
    found: FloatArray, at_edge: NDArray[np.int32], segments: FloatArray, nearest: NDArray[np.int32],
    depth: NDArray[np.float32], pitch: float,
) -> tuple[FloatArray, IntArray]:
    """Joints of cells that the ridge crosses more than twice, as rows of `found`; and links."""
    ny, nx = depth.shape
    joints, n_joints = np.empty((64, 5)), 0
    links, n_links = np.empty((256, 2), np.int64), 0
    around = np.empty(4, np.int64)
    for j in range(ny - 1):
        for i in range(nx - 1):
            n = 0
            for k in range(4):
                point = (at_edge[0, j, i] if k == 0 else at_edge[0, j + 1, i] if k == 1
                         else at_edge[1, j, i] if k == 2 else at_edge[1, j, i + 1])
                if point >= 0:
                    around[n] = point
                    n += 1
            if n < 2:
                continue
            if n_links + 4 > len(links):
                links = _resized(links, n_links, 2 * len(links))
            if n == 2:
                links[n_links, 0], links[n_links, 1] = around[0], around[1]
                n_links += 1
                continue
            if n_joints == len(joints):
                joints = _resized(joints, n_joints, 2 * n_joints)
            row = joints[n_joints]
            for c in range(5):
                row[c] = 0.0
                for k in range(n):
                    row[c] += found[around[k], c] / n
            away = np.inf
            for corner in range(4):
                s = nearest[j + corner // 2, i + corner % 2]
                away = min(away, closest_point_on_segment(segments, s, row[0], row[1])[2])
            row[2] = away
            for k in range(n):
                links[n_links, 0], links[n_links, 1] = around[k], len(found) + n_joints
                n_links += 1
            n_joints += 1
    return _resized(joints, n_joints, n_joints), _resized(links, n_links, n_links)
