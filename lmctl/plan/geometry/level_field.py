"""A field over the section whose levels ½, 1½, 2½ … are where the tracks run.

Outside the core, tracks lie exactly a pitch apart, except for the strip of the second one. That is
wider in every other layer and narrower in those between, so that tracks farther in do not lie upon
each other. The core is the innermost few tracks. They share the remaining width, so that strips
fill it: `count` strips of `strip` each. Width and count at a node are those found where the ray
from the nearest point of the outline through the node meets the medial axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.bead_count import BeadCount
from lmctl.plan.geometry.level_steps import (
    NO_CORE_TRACK_COUNT,
    smooth_steps,
    smoothing_bell,
)
from lmctl.plan.geometry.medial_axis import MedialAxis, closest_point_on_segment
from lmctl.plan.geometry.section_raster import SectionRaster

#: Tracks that share what width is left over: the innermost of an odd and of an even number, and of
#: rings around a point.
CORE_ODD, CORE_EVEN, CORE_POINT = 5, 6, 10
#: Strips of the core that leave the outermost tracks where they belong, in pitches.
_LEAST_INNER, _WIDEST_INNER = 0.74, 1.3
#: How far below its own distance from the outline the depth may be before the axis is passed, in
#: nodes: more than the raster errs by.
_PAST_AXIS = 0.1
#: How closely the end of a ray is found, in nodes.
_FOUND = 0.15
#: A point of the axis is where a ray meets it, if it lies beside the ray by less [nodes].
_BESIDE_RAY = 0.5
#: Along the axis, the point where a ray meets it is looked for in so many steps at most.
_MOST_STEPS = 8
#: From so many tracks outside the core on, the second one's strip may differ from the pitch.
SHIFTED_FROM = 3
#: A node from which no way uphill was followed yet.
_UNKNOWN = -2


@dataclass(frozen=True)
class LevelField:
    """level : (ny, nx) float32, negative outside
    strip_mm, outer_track_count : (ny, nx) float32 and int32, strip width of the core's tracks, and
    how many
        tracks a pitch wide lie between the core and the outline
    track_count : (ny, nx) int32, tracks across; 0 where there is none
    wave : (ny, nx) float32, zero where a track runs along the outline: a triangle wave of the level
    """

    level: NDArray[np.float32]
    strip_mm: NDArray[np.float32]
    outer_track_count: NDArray[np.int32]
    track_count: NDArray[np.int32]
    wave: NDArray[np.float32]


def level_field(
    raster: SectionRaster, axis: MedialAxis, beads: BeadCount, pitch_mm: float, second_mm: float
) -> LevelField:
    """Levels at the nodes of a section.

    second_mm : strip width of the second track from the outline, where `SHIFTED_FROM` and more lie
        outside the core
    """
    shape = raster.grid.shape
    level, strip_mm = np.empty(shape, np.float32), np.empty(shape, np.float32)
    outer, count = np.empty(shape, np.int32), np.empty(shape, np.int32)
    wave = np.empty(shape, np.float32)
    _level_kernel(
        raster.depth_mm, raster.segments, raster.nearest, raster.grid.pitch_mm,
        axis.points_mm - np.array(raster.grid.origin_mm), axis.depth_mm, axis.slope,
        axis.is_central, axis.links, axis.at_edge, beads.track_count, beads.depth_mm, beads.owner,
        beads.is_point, pitch_mm, second_mm, float(raster.depth_mm.max()), level, strip_mm, outer,
        count, smoothing_bell(), wave)
    return LevelField(level, strip_mm, outer, count, wave)


@kernel
def core_track_count(
    count: NDArray[np.int64], is_point: NDArray[np.bool_], half_mm: FloatArray, pitch_mm: float
) -> NDArray[np.int64]:
    """How many of `count` tracks across share the width left over, (v,). half_mm : half of it"""
    core = np.empty(len(count), np.int64)
    for k in range(len(count)):
        core[k] = _core(count[k], is_point[k], half_mm[k], pitch_mm)
    return core


@inner_kernel
def _core(count: int, is_point: bool, half: float, pitch: float) -> int:
    """Where strips allow, the outermost tracks are left out: exactly half a pitch inside."""
    most = CORE_ODD if count % 2 == 1 else CORE_POINT if is_point else CORE_EVEN
    if count > most:
        return most
    if count >= 4:
        strip = 2 * (half - pitch) / (count - 2)
        if _LEAST_INNER * pitch <= strip <= _WIDEST_INNER * pitch:
            return count - 2
    return count


@inner_kernel
def _outer_depth(count: int, pitch: float, second: float) -> float:
    """How deep the strips of the outermost `count` tracks reach."""
    return (count - 1) * pitch + second if count >= SHIFTED_FROM else count * pitch


@inner_kernel
def _outer_level(depth: float, count: int, pitch: float, second: float) -> float:
    if count < SHIFTED_FROM or depth <= pitch:
        return depth / pitch
    if depth <= pitch + second:
        return 1 + (depth - pitch) / second
    return 2 + (depth - pitch - second) / pitch


@inner_kernel
def _depth_at(depth: NDArray[np.float32], u: float, v: float) -> float:
    ny, nx = depth.shape
    i, j = min(max(int(u), 0), nx - 2), min(max(int(v), 0), ny - 2)
    u, v = u - i, v - j
    low = (1 - u) * depth[j, i] + u * depth[j, i + 1]
    return float((1 - v) * low + v * ((1 - u) * depth[j + 1, i] + u * depth[j + 1, i + 1]))


@inner_kernel
def _ray_end(
    depth: NDArray[np.float32], fx: float, fy: float, ux: float, uy: float, low: float,
    high: float, guess: float, pitch: float
) -> float:
    """Up to what length a ray from the outline is nearest to where it began.

    low, high : a length at which it is and one at which it is not; guess : a likely one, or −1
    Beyond the axis the depth falls no faster than it rose: what is left of it at a length bounds
    the ray, closely where walls are opposite. So lengths just below that bound are tried in turn
    with those half-way.
    """
    found, tolerance = _FOUND * pitch, _PAST_AXIS * pitch
    t = min(high, guess + pitch) if guess > low else high
    below_bound = True
    while high - low > found:
        here = _depth_at(depth, (fx + t * ux) / pitch, (fy + t * uy) / pitch)
        if here >= t - tolerance:
            low = t
        else:
            high = min(t, 0.5 * (t + here + tolerance))
        t = max(high - 0.5 * found, low) if below_bound else 0.5 * (low + high)
        below_bound = not below_bound
    return low


@inner_kernel
def _along_and_beside(
    points: FloatArray, point: int, fx: float, fy: float, ux: float, uy: float
) -> tuple[float, float]:
    """How far along a ray a point of the axis lies, and how far beside it."""
    wx, wy = points[point, 0] - fx, points[point, 1] - fy
    return wx * ux + wy * uy, abs(wx * uy - wy * ux)


@inner_kernel
def _linked_points(links: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Where the points linked to each of `count` points begin, (count + 1,), and those points."""
    first = np.zeros(count + 1, np.int64)
    for k in range(len(links)):
        first[links[k, 0] + 1] += 1
        first[links[k, 1] + 1] += 1
    for point in range(count):
        first[point + 1] += first[point]
    place, onward = first[:-1].copy(), np.empty(2 * len(links), np.int64)
    for k in range(len(links)):
        for end in range(2):
            point = links[k, end]
            onward[place[point]] = links[k, 1 - end]
            place[point] += 1
    return first, onward


@inner_kernel
def _nearest_axis_point(
    at_edge: NDArray[np.int32], points: FloatArray, x: float, y: float, pitch: float, reach: int
) -> int:
    ny, nx = at_edge.shape[1], at_edge.shape[2]
    i, j = int(x / pitch), int(y / pitch)
    best, least = -1, np.inf
    for jn in range(max(0, j - reach), min(ny, j + reach + 2)):
        for im in range(max(0, i - reach), min(nx, i + reach + 2)):
            for side in range(2):
                point = at_edge[side, jn, im]
                if point >= 0:
                    d2 = (points[point, 0] - x) ** 2 + (points[point, 1] - y) ** 2
                    if d2 < least:
                        best, least = point, d2
    return best


@inner_kernel
def _axis_point_uphill(
    depth: NDArray[np.float32], at_edge: NDArray[np.int32], points: FloatArray, x: float, y: float,
    pitch: float, known: NDArray[np.int32],
) -> int:
    """The first point of the axis on the steepest way uphill from a place, −1 if there is none.

    known : (ny, nx) what was found from each node, filled on the way
    """
    ny, nx = depth.shape
    i, j = min(int(x / pitch + 0.5), nx - 1), min(int(y / pitch + 0.5), ny - 1)
    first_i, first_j, found = i, j, _UNKNOWN
    while found == _UNKNOWN:
        found = known[j, i]
        if found == _UNKNOWN:
            point = _nearest_axis_point(at_edge, points, i * pitch, j * pitch, pitch, 1)
            found = point if point >= 0 else _UNKNOWN
        if found == _UNKNOWN:
            up_i, up_j = _steepest(depth, i, j)
            if up_i == i and up_j == j:
                found = -1
            i, j = up_i, up_j
    i, j = first_i, first_j
    while known[j, i] == _UNKNOWN:
        known[j, i] = found
        i, j = _steepest(depth, i, j)
    return found


@inner_kernel
def _steepest(depth: NDArray[np.float32], i: int, j: int) -> tuple[int, int]:
    """The deepest of a node and its eight neighbours."""
    ny, nx = depth.shape
    up_i, up_j = i, j
    for v in range(max(0, j - 1), min(ny, j + 2)):
        for u in range(max(0, i - 1), min(nx, i + 2)):
            if depth[v, u] > depth[up_j, up_i]:
                up_i, up_j = u, v
    return up_i, up_j


@kernel
def _level_kernel(
    depth: NDArray[np.float32], segments: FloatArray, nearest: NDArray[np.int32], pitch: float,
    points: FloatArray, axis_depth: FloatArray, slope: FloatArray, is_central: NDArray[np.bool_],
    links: IntArray, at_edge: NDArray[np.int32], count: NDArray[np.int64], width: FloatArray,
    owner: NDArray[np.int64], is_point: NDArray[np.bool_], track_pitch: float, second: float,
    deepest: float,
    level: NDArray[np.float32], strip: NDArray[np.float32], outer: NDArray[np.int32],
    across: NDArray[np.int32], bell: FloatArray, wave: NDArray[np.float32],
) -> None:
    ny, nx = depth.shape
    uphill = np.full((ny, nx), _UNKNOWN, np.int32)
    first, onward = _linked_points(links, len(points))
    tolerance = _PAST_AXIS * pitch
    above = np.full(nx, -1, np.int64)  # where the rays through the row before met the axis
    for j in range(ny):
        left = -1
        for i in range(nx):
            d = float(depth[j, i])
            level[j, i] = _outer_level(d, NO_CORE_TRACK_COUNT, track_pitch, second)
            strip[j, i] = track_pitch
            outer[j, i], across[j, i] = NO_CORE_TRACK_COUNT, 0
            if d <= 0:
                continue
            fx, fy, away = closest_point_on_segment(segments, nearest[j, i], i * pitch, j * pitch)
            if away <= 1e-9:
                continue
            ux, uy = (i * pitch - fx) / away, (j * pitch - fy) / away
            # Neighbouring rays end nearby: at the same point, or at one a few links along the axis.
            point, low, guess = -1, d, -1.0
            for k in range(2):
                met = int(left if k == 0 else above[i])
                if met < 0 or point >= 0:
                    continue
                t, off = _along_and_beside(points, met, fx, fy, ux, uy)
                for _ in range(_MOST_STEPS):
                    nearer = -1
                    for e in range(first[met], first[met + 1]):
                        t_next, off_next = _along_and_beside(points, onward[e], fx, fy, ux, uy)
                        if off_next < off:
                            nearer, t, off = int(onward[e]), t_next, off_next
                    if nearer < 0:
                        break
                    met = nearer
                guess = max(t, d)
                if (off < _BESIDE_RAY * pitch and t >= d - tolerance
                        and abs(t - axis_depth[met]) <= tolerance):
                    point, low = met, t
            if point < 0:
                low = _ray_end(depth, fx, fy, ux, uy, low, deepest + pitch, guess, pitch)
            x, y = fx + low * ux, fy + low * uy
            if point < 0:
                point = _nearest_axis_point(at_edge, points, x, y, pitch, 1)
            if point < 0:
                point = _nearest_axis_point(at_edge, points, x, y, pitch, 4)
            if point < 0:
                point = _axis_point_uphill(depth, at_edge, points, x, y, pitch, uphill)
            left = above[i] = point
            if point < 0:
                continue
            half = width[point]
            if owner[point] == point and is_central[point]:
                half += slope[point, 0] * (x - points[point, 0])
                half += slope[point, 1] * (y - points[point, 1])
            half = max(half, d)
            n = count[point]
            across[j, i] = n
            if n == 0:
                outer[j, i] = 0
                continue
            core = _core(n, is_point[point], half, track_pitch)
            fixed = (n - core) // 2
            begin = _outer_depth(fixed, track_pitch, second)
            outer[j, i] = fixed
            level[j, i] = _outer_level(d, fixed, track_pitch, second)
            strip[j, i] = 2 * (half - begin) / core
            if d > begin:
                level[j, i] = fixed + (d - begin) / strip[j, i]
    smooth_steps(level, strip, across, outer, depth, track_pitch, bell, wave)
