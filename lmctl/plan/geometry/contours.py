"""Tracks along the outline: the levels ½, 1½, 2½ … of a section's level field."""

from __future__ import annotations

import contourpy
import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.corners import contour_with_sharp_corners
from lmctl.plan.geometry.level_field import SHIFTED_FROM, LevelField
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.plane_values import interpolate_bilinear
from lmctl.plan.polyline import arc_lengths, resampled_polyline

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
    origin = np.array(grid.origin_mm)
    generator = contourpy.contour_generator(
        z=field.wave, name="serial", line_type=contourpy.LineType.Separate)
    tracks = []
    for line in generator.lines(0.0):
        points = _without_repeats(np.asarray(line)) * grid.pitch_mm + origin
        if len(points) < 4 or arc_lengths(points)[-1] < _LEAST_ROUND * pitch_mm:
            continue
        some = points[:: len(points) // _LOOKED_AT + 1]
        number = round(float(np.median(interpolate_bilinear(field.level, grid, some))) - 0.5)
        points = contour_with_sharp_corners(points, raster, axis)
        points = resampled_polyline(points, spacing_mm * _WITHIN, _DEVIATION_NODES * grid.pitch_mm)
        strip = _strips_kernel(
            (points - origin) / grid.pitch_mm, number, field.level, field.strip_mm,
            field.outer_track_count, pitch_mm, second_mm, most_strip_mm)
        tracks.append((number, Toolpath(points, strip, True)))
    return [track for _, track in sorted(tracks, key=lambda numbered: numbered[0])]


@kernel
def _strips_kernel(
    at: FloatArray, number: int, level: NDArray[np.float32], strip_mm: NDArray[np.float32],
    outer_count: NDArray[np.int32], pitch_mm: float, second_mm: float, most_mm: float,
) -> FloatArray:
    """Widths of the strips of track `number`, counted from the outline, at points in nodes. (k,)"""
    found = np.empty(len(at))
    for k in range(len(at)):
        i, j = int(np.floor(at[k, 0])), int(np.floor(at[k, 1]))
        u, v = at[k, 0] - i, at[k, 1] - j
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
        found[k] = min(most_mm, total / max(weight, 1e-12) if weight > 0 else pitch_mm)
    return found


def _without_repeats(points: FloatArray) -> FloatArray:
    keep = np.ones(len(points), dtype=np.bool_)
    keep[1:] = (points[1:, 0] != points[:-1, 0]) | (points[1:, 1] != points[:-1, 1])
    return np.asarray(points[keep])
