"""Tracks along the outline: the levels ½, 1½, 2½ … of a section's level field."""

from __future__ import annotations

import contourpy
import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.field.plane import PlaneGrid
from lmctl.plan.geometry.corners import contour_with_sharp_corners
from lmctl.plan.geometry.level_field import SHIFTED_FROM, LevelField
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.plane_values import interpolate_bilinear

#: The shortest closed track, in pitches: its neighbours fill anything shorter.
_LEAST_ROUND = 2.0


def contour_tracks(
    field: LevelField, raster: SectionRaster, axis: MedialAxis, pitch_mm: float,
    second_mm: float, most_strip_mm: float,
) -> list[Toolpath]:
    """All closed tracks of a section, each with the width of its strip, the outermost first."""
    grid = raster.grid
    generator = contourpy.contour_generator(
        grid.x_mm, grid.y_mm, _zero_at_halves(field.level), name="serial",
        line_type=contourpy.LineType.Separate)
    tracks = []
    for line in generator.lines(0.0):
        points = _without_repeats(np.asarray(line))
        if len(points) < 4 or _length_mm(points) < _LEAST_ROUND * pitch_mm:
            continue
        number = round(float(np.median(interpolate_bilinear(field.level, grid, points))) - 0.5)
        points = contour_with_sharp_corners(points, raster, axis)
        strip = strip_widths_mm(points, number, field, grid, pitch_mm, second_mm)
        tracks.append((number, Toolpath(points, np.minimum(strip, most_strip_mm), True)))
    return [track for _, track in sorted(tracks, key=lambda numbered: numbered[0])]


def _zero_at_halves(level: NDArray[np.float32]) -> NDArray[np.float32]:
    """A triangle wave of the level, zero at ½, 1½, 2½ …: one contour of it is all of them at once.

    It is as steep as the level itself, so that its contours lie where the level's would.
    """
    level = np.maximum(level, np.float32(0))
    whole = np.floor(level)
    rest = level - whole - np.float32(0.5)
    return np.where(whole % 2 == 0, rest, -rest)


def strip_widths_mm(
    points_mm: FloatArray, number: int, field: LevelField, grid: PlaneGrid, pitch_mm: float,
    second_mm: float,
) -> FloatArray:
    """Widths of the strips of track `number`, counted from the outline, at its points. (k,)"""
    at = (points_mm - np.array(grid.origin_mm)) / grid.pitch_mm
    i, j = np.floor(at).astype(np.intp).T
    u, v = (at - np.floor(at)).T
    total, weight = np.zeros(len(at)), np.zeros(len(at))
    for dj, di, share in ((0, 0, (1 - u) * (1 - v)), (0, 1, u * (1 - v)), (1, 0, (1 - u) * v),
                          (1, 1, u * v)):
        inside = field.level[j + dj, i + di] > 0
        outer = field.outer_track_count[j + dj, i + di]
        plain = np.where((number == 1) & (outer >= SHIFTED_FROM), second_mm, pitch_mm)
        strip = np.where(number < outer, plain, field.strip_mm[j + dj, i + di])
        total += np.where(inside, share * strip, 0.0)
        weight += np.where(inside, share, 0.0)
    return np.where(weight > 0, total / np.maximum(weight, 1e-12), pitch_mm)


def _without_repeats(points: FloatArray) -> FloatArray:
    keep = np.ones(len(points), dtype=bool)
    keep[1:] = np.any(points[1:] != points[:-1], axis=1)
    return np.asarray(points[keep])


def _length_mm(points: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
