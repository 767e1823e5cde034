"""Islands that hold a single track: as long as its strip needs to deposit the island's area."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.bead_count import BeadCount
from lmctl.plan.geometry.islands import Islands, deepest_nodes
from lmctl.plan.geometry.medial_axis import MedialAxis, climbed_to_peak
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.geometry.track_ends import prolonged_track, trimmed_track
from lmctl.plan.polyline import arc_lengths

_POINTS = 9
#: The middle of an island is that of the points so deep, as a part of the deepest.
_NEARLY = 0.98


def with_pins(
    tracks: list[Toolpath], owner: NDArray[np.intp], islands: Islands, axis: MedialAxis,
    beads: BeadCount, raster: SectionRaster, least_width_mm: float,
    limits_mm: tuple[float, float],
) -> tuple[list[Toolpath], NDArray[np.intp]]:
    """Tracks and the island of each, with a short track in every island that has none.

    least_width_mm : what is narrower stays without
    """
    home = islands.island_at(axis.points_mm, raster)
    most = np.zeros(len(islands), dtype=np.int64)
    inside = home >= 0
    np.maximum.at(most, home[inside], beads.track_count[inside])
    tracks, owners = list(tracks), owner.tolist()
    of_island: dict[int, list[int]] = defaultdict(list)
    for number, island in enumerate(owners):
        of_island[island].append(number)
    deepest = deepest_nodes(raster.depth_mm, islands.label, len(islands))
    for island in range(len(islands)):
        mine = of_island[island]
        if not mine:
            middle, width = _deepest(int(deepest[island]), raster, least_width_mm)
            deep = (home == island) & (2 * axis.depth_mm >= _NEARLY * width)
            if deep.any():
                middle = axis.points_mm[deep].mean(axis=0)
            if width >= least_width_mm * (1 - 1e-6):
                tracks.append(_stroke(islands.outer[island], middle,
                                      float(islands.area_mm2[island]),
                                      float(np.clip(width, *limits_mm))))
                owners.append(island)
        elif len(mine) == 1 and most[island] == 1 and not tracks[mine[0]].is_closed:
            tracks[mine[0]] = _fitted(
                tracks[mine[0]], float(islands.area_mm2[island]), raster)
    return tracks, np.array(owners, dtype=np.intp)


def _deepest(
    start: int, raster: SectionRaster, least_width_mm: float
) -> tuple[FloatArray, float]:
    """The deepest place of an island from its deepest node, and its width there [mm].

    0 where it holds no node, or cannot be as wide as `least_width_mm`.
    """
    node = raster.grid.pitch_mm
    nearest = float(raster.depth_mm.flat[start]) if start >= 0 else -np.inf
    if 2 * (nearest + node) < least_width_mm:  # no place is farther than that from a node
        return np.zeros(2), 0.0
    j, i = np.unravel_index(start, raster.grid.shape)
    x, y, depth = climbed_to_peak(raster.segments, float(i) * node, float(j) * node, node / 2)
    return np.array([x, y]) + np.array(raster.grid.origin_mm), 2 * depth


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
    track = Toolpath(track.points_mm, strip, False)
    for _ in range(2):  # at one end, then at the other
        if more < 0:
            track = trimmed_track(track, min(-more, along[-1] / 3))
        else:
            track = prolonged_track(track, more, core, raster)
        track = track.reversed()
    return track
