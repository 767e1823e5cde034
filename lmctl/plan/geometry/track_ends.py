"""Extend the ends of open tracks straight, or trim them."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.plane_values import interpolate_bilinear
from lmctl.plan.polyline import arc_lengths, points_at_lengths

#: The outline is looked for so many times a node.
_STEPS_PER_NODE = 4


def trimmed_track(track: Toolpath, by_mm: float) -> Toolpath:
    """An open track without its last `by_mm`; a point where that is all of it."""
    along = arc_lengths(track.points_mm)
    left = along[-1] - by_mm
    if left <= 0:
        return Toolpath(track.points_mm[:1], track.strip_width_mm[:1], False)
    return resampled_track(track, np.append(along[along < left - 1e-9], left))


def prolonged_track(
    track: Toolpath, by_mm: float, over_mm: float, raster: SectionRaster
) -> Toolpath:
    """An open track straight on at its end by up to so much, not beyond the outline.

    over_mm : length at its end from which its direction is taken
    """
    points = track.points_mm
    along = arc_lengths(points)
    behind = points_at_lengths(points, np.array([max(0.0, along[-1] - over_mm)]))[0]
    way = points[-1] - behind
    size = float(np.hypot(*way))
    if size <= 0 or by_mm <= 0:
        return track
    count = max(2, int(np.ceil(by_mm / raster.grid.pitch_mm * _STEPS_PER_NODE)) + 1)
    tried = points[-1] + np.linspace(0, by_mm, count)[:, None] * way / size
    outside = np.flatnonzero(interpolate_bilinear(raster.depth_mm, raster.grid, tried) < 0)
    last = int(outside[0]) - 1 if len(outside) else count - 1
    if last <= 0:
        return track
    return Toolpath(np.vstack([points, tried[last]]),
                    np.append(track.strip_width_mm, track.strip_width_mm[-1]), False)


def resampled_track(track: Toolpath, at_mm: FloatArray) -> Toolpath:
    """An open track with these lengths along it as its points."""
    along = arc_lengths(track.points_mm)
    return Toolpath(points_at_lengths(track.points_mm, at_mm),
                    np.interp(at_mm, along, track.strip_width_mm), False)
