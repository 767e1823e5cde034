"""Tracks along the outline: the levels ½, 1½, 2½ … of a section's level field."""

from __future__ import annotations

from typing import Any

import contourpy
import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.geometry.corners import with_sharp_corners
from lmctl.plan.geometry.level_field import SHIFTED_FROM, LevelField
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.polyline import resampled_polyline

#: The shortest closed track, in pitches: its neighbours fill anything shorter.
_LEAST_ROUND = 2.0
#: The level of a contour is looked at so many of its points.
_LOOKED_AT = 50
#: Points are set anew a little nearer than they may be, and a contour moves by less than this.
_WITHIN, _DEVIATION_NODES = 0.99, 0.02


def contour_tracks(
    field: LevelField, raster: SectionRaster, axis: MedialAxis, pitch_mm: float,
    second_mm: float, most_strip_mm: float, spacing_mm: float,
) -> list[Toolpath]:
    """All closed tracks of a section, each with the width of its strip, the outermost first.

    spacing_mm : of their points at most
    """
    grid = raster.grid
    generator = contourpy.contour_generator(
        z=field.wave, name="serial", line_type=contourpy.LineType.ChunkCombinedOffset)
    found: Any = generator.lines(0.0)  # of its one chunk: points, and where each line begins
    (lines,), (offsets,) = found
    if lines is None:
        return []
    points, strip, starts, number = _contours_kernel(
        lines, offsets.astype(np.int64), field.level, field.strip_mm, field.outer_track_count,
        raster.segments, raster.nearest, axis.at_edge, axis.is_central, grid.pitch_mm, pitch_mm,
        second_mm, most_strip_mm, _LEAST_ROUND * pitch_mm, spacing_mm * _WITHIN,
        _DEVIATION_NODES * grid.pitch_mm)
    points += np.array(grid.origin_mm)
    return [Toolpath(points[starts[k] : starts[k + 1]], strip[starts[k] : starts[k + 1]], True)
            for k in np.argsort(number, kind="stable").tolist()]


@kernel
def _contours_kernel(
    lines: FloatArray, offsets: IntArray, level: NDArray[np.float32],
    strip_mm: NDArray[np.float32], outer_count: NDArray[np.int32], segments: FloatArray,
    nearest: NDArray[np.int32], at_edge: NDArray[np.int32], is_central: NDArray[np.bool_],
    node: float, pitch_mm: float, second_mm: float, most_mm: float, least_mm: float,
    spacing_mm: float, deviation_mm: float,
) -> tuple[FloatArray, FloatArray, IntArray, IntArray]:
    """Points from the raster's origin [mm] and strip widths of all contours, where each begins, and
    its number from the outline. lines : in nodes, one contour after the other"""
    points, strip = np.empty((2 * len(lines), 2)), np.empty(2 * len(lines))
    starts, number = np.zeros(len(offsets), np.int64), np.empty(len(offsets), np.int64)
    count, tracks = 0, 0
    for line in range(len(offsets) - 1):
        own = np.empty((offsets[line + 1] - offsets[line], 2))
        n, round_mm = 0, 0.0
        for k in range(offsets[line], offsets[line + 1]):
            x, y = lines[k, 0] * node, lines[k, 1] * node
            if n > 0 and x == own[n - 1, 0] and y == own[n - 1, 1]:
                continue
            own[n, 0], own[n, 1] = x, y
            if n > 0:
                round_mm += np.sqrt((x - own[n - 1, 0]) ** 2 + (y - own[n - 1, 1]) ** 2)
            n += 1
        if n < 4 or round_mm < least_mm:
            continue
        step = n // _LOOKED_AT + 1
        some = np.empty((n + step - 1) // step)
        for k in range(len(some)):
            some[k] = _between(level, own[k * step, 0] / node, own[k * step, 1] / node)
        number[tracks] = int(np.round(_median(some) - 0.5))
        found = resampled_polyline(
            with_sharp_corners(own[:n], segments, nearest, node, at_edge, is_central),
            spacing_mm, deviation_mm)
        if count + len(found) > len(points):
            more = np.empty((2 * (count + len(found)), 2))
            more_strip = np.empty(len(more))
            for k in range(count):
                more[k, 0], more[k, 1], more_strip[k] = points[k, 0], points[k, 1], strip[k]
            points, strip = more, more_strip
        for k in range(len(found)):
            points[count, 0], points[count, 1] = found[k, 0], found[k, 1]
            strip[count] = min(most_mm, _strip(
                found[k, 0] / node, found[k, 1] / node, number[tracks], level, strip_mm,
                outer_count, pitch_mm, second_mm))
            count += 1
        tracks += 1
        starts[tracks] = count
    return points[:count], strip[:count], starts[: tracks + 1], number[:tracks]


@inner_kernel
def _median(values: FloatArray) -> float:
    """The median of a few values, which are sorted in place; numpy's takes long to load."""
    for k in range(1, len(values)):
        value, at = values[k], k
        while at > 0 and values[at - 1] > value:
            values[at] = values[at - 1]
            at -= 1
        values[at] = value
    middle = len(values) // 2
    return float(values[middle] if len(values) % 2 else 0.5 * (
        values[middle - 1] + values[middle]))


@inner_kernel
def _between(values: NDArray[np.float32], u: float, v: float) -> float:
    """A value between nodes, bilinear."""
    i, j = min(int(u), values.shape[1] - 2), min(int(v), values.shape[0] - 2)
    u, v = u - i, v - j
    low = (1 - u) * values[j, i] + u * values[j, i + 1]
    return float((1 - v) * low + v * ((1 - u) * values[j + 1, i] + u * values[j + 1, i + 1]))


@inner_kernel
def _strip(
    u: float, v: float, number: int, level: NDArray[np.float32], strip_mm: NDArray[np.float32],
    outer_count: NDArray[np.int32], pitch_mm: float, second_mm: float,
) -> float:
    """Width of the strip of track `number`, counted from the outline, at a place in nodes."""
    i, j = int(np.floor(u)), int(np.floor(v))
    u, v = u - i, v - j
    total, weight = 0.0, 0.0
    for corner in range(4):
        jn, im = j + corner // 2, i + corner % 2
        if level[jn, im] <= 0:
            continue
        share = (u if corner % 2 else 1 - u) * (v if corner // 2 else 1 - v)
        strip = float(strip_mm[jn, im])
        if number < outer_count[jn, im]:
            strip = second_mm if (
                number == 1 and outer_count[jn, im] >= SHIFTED_FROM) else pitch_mm
        total += share * strip
        weight += share
    return total / max(weight, 1e-12) if weight > 0 else pitch_mm
