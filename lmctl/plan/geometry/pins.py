"""Islands that hold a single track: as long as its strip needs to deposit the island's area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lmctl.plan.geometry.bead_count import BeadCount
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.plane_values import plane_values
from lmctl.plan.polyline import arc_lengths, at_lengths

FloatArray = NDArray[np.float64]

_POINTS = 9


def with_pins(
    tracks: list[Toolpath], owner: NDArray[np.intp], islands: Islands, axis: MedialAxis,
    beads: BeadCount, raster: SectionRaster, least_width_mm: float,
    limits_mm: tuple[float, float],
) -> tuple[list[Toolpath], NDArray[np.intp]]:
    """Tracks and the island of each, with a short track in every island that has none.

    least_width_mm : what is narrower stays without
    """
    home = islands.at(axis.points_mm, raster)
    widest = np.zeros(len(islands))
    most = np.zeros(len(islands), dtype=np.int64)
    inside = home >= 0
    np.maximum.at(widest, home[inside], 2 * axis.depth_mm[inside])
    np.maximum.at(most, home[inside], beads.count[inside])
    tracks, owners = list(tracks), owner.tolist()
    for island in range(len(islands)):
        mine = [n for n, other in enumerate(owners) if other == island]
        if not mine and widest[island] >= least_width_mm * (1 - 1e-6):
            width = float(np.clip(widest[island], *limits_mm))
            deepest = int(np.argmax(np.where(home == island, axis.depth_mm, -np.inf)))
            tracks.append(_stroke(islands.outer[island], axis.points_mm[deepest],
                                  float(islands.area_mm2[island]), width))
            owners.append(island)
        elif len(mine) == 1 and most[island] == 1 and not tracks[mine[0]].is_closed:
            tracks[mine[0]] = _fitted(
                tracks[mine[0]], float(islands.area_mm2[island]), raster)
    return tracks, np.array(owners, dtype=np.intp)


def _stroke(
    outline: FloatArray, middle_mm: FloatArray, area_mm2: float, width_mm: float
) -> Toolpath:
    """A straight track along an island's longer direction."""
    arms = outline[:-1] - outline[:-1].mean(axis=0)
    way = np.linalg.svd(arms, full_matrices=False)[2][0]
    half = area_mm2 / width_mm / 2
    points = middle_mm + np.linspace(-half, half, _POINTS)[:, None] * way
    return Toolpath(points, np.full(_POINTS, width_mm), False)


def _fitted(track: Toolpath, area_mm2: float, raster: SectionRaster) -> Toolpath:
    """An open track longer or shorter at both ends, so that it deposits the island's area.

    It never leaves the outline.
    """
    along = arc_lengths(track.points_mm)
    core = float(np.median(track.strip_width_mm))
    strip = np.minimum(track.strip_width_mm, core)
    missing_mm2 = area_mm2 - Toolpath(track.points_mm, strip, False).strip_area_mm2()
    more = missing_mm2 / core / 2
    if more < 0:
        more = max(more, -along[-1] / 3)
        at = np.concatenate([[-more], along[(along > -more) & (along < along[-1] + more)],
                             [along[-1] + more]])
        return Toolpath(at_lengths(track.points_mm, at), np.interp(at, along, strip), False)
    points = track.points_mm
    reach = np.array([0.0, min(core, along[-1])])
    ends = [_straight_on(at_lengths(points, at), more, raster)
            for at in (reach, along[-1] - reach)]
    return Toolpath(np.vstack([ends[0], points, ends[1]]),
                    np.concatenate([strip[:1], strip, strip[-1:]]), False)


def _straight_on(end: FloatArray, most_mm: float, raster: SectionRaster) -> FloatArray:
    """The point (1, 2) up to `most_mm` beyond end[0], coming from end[1], within the outline."""
    way = (end[0] - end[1]) / max(float(np.hypot(*(end[0] - end[1]))), 1e-12)
    steps = np.linspace(0, most_mm, max(2, int(np.ceil(most_mm / raster.grid.pitch_mm * 4)) + 1))
    points = end[0] + steps[:, None] * way
    outside = np.flatnonzero(plane_values(raster.depth_mm, raster.grid, points) < 0)
    last = max(0, int(outside[0]) - 1) if len(outside) else len(points) - 1
    return np.asarray(points[last : last + 1])
