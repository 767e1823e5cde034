"""Tracks along the medial axis: where an odd number lies across, the one in the middle."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.field.kernel import kernel
from lmctl.plan.geometry.bead_count import BeadCount
from lmctl.plan.geometry.level_field import SHIFTED_FROM, core_track_count
from lmctl.plan.geometry.medial_axis import MedialAxis
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.plan.geometry.track_ends import prolonged_track, resampled_track, trimmed_track
from lmctl.plan.polyline import arc_lengths

#: A track that ends before a wall goes on by this part of its strip; what lies beyond its end,
#: half a strip in all, its last stretch of one strip carries by a wider strip.
_BEYOND = 0.25
#: Into a tip too narrow for a track one goes on until it has deposited the tip's area, but no
#: farther than this, in pitches.
_LONGEST_TIP = 2.5
#: The shortest centreline beside other tracks, in pitches.
_LEAST_BESIDE = 1.0


def centreline_tracks(
    axis: MedialAxis, beads: BeadCount, raster: SectionRaster, pitch_mm: float,
    second_mm: float, limits_mm: tuple[float, float],
) -> list[Toolpath]:
    """Open tracks, and closed ones around rings, along the axis.

    limits_mm : least and widest strip
    """
    chosen = beads.has_centreline & (beads.track_count % 2 == 1)
    strip = strip_on_axis(axis, beads, pitch_mm, second_mm, limits_mm)
    links = axis.links[chosen[axis.links].all(axis=1)]
    links = links[beads.track_count[links[:, 0]] == beads.track_count[links[:, 1]]]
    degree = np.bincount(links.ravel(), minlength=len(chosen))
    larger = _has_neighbour(axis.links, beads, larger=True)
    smaller = _has_neighbour(axis.links, beads, larger=False)
    tips = _ends_in_tip(axis, beads)
    tip_area = _tip_area_mm2(axis)
    tracks = []
    for chain in through_junctions(chains(links), axis.points_mm):
        closed = bool(chain[0] == chain[-1])
        track = Toolpath(axis.points_mm[chain], strip[chain], closed)
        if closed:
            tracks.append(track)
            continue
        for _ in (0, 1):  # at one end, then at the other
            point = int(chain[-1])
            width = float(track.strip_width_mm[-1])
            if degree[point] > 2:
                track = trimmed_track(track, width / 2)
            elif larger[point]:  # the strip of those, n + 1 across, begins half of it before them
                count = int(beads.track_count[point])
                track = trimmed_track(track, width / 2 * count / (count + 1))
            elif tips[point]:
                track = prolonged_track(track, min(
                    tip_area[point] / width, _LONGEST_TIP * pitch_mm), width, raster)
            elif not smaller[point]:
                track = _extended(track, width, limits_mm[1], raster)
            track, chain = track.reversed(), chain[::-1]
        if len(track.points_mm) > 1 and track.length_mm >= _LEAST_BESIDE * pitch_mm:
            tracks.append(track)
    return tracks


def strip_on_axis(
    axis: MedialAxis, beads: BeadCount, pitch_mm: float, second_mm: float,
    limits_mm: tuple[float, float],
) -> FloatArray:
    """Width of the strip of a track along the axis, (v,) [mm]."""
    count = np.maximum(beads.track_count, 1)
    half = np.where(count == 1, axis.depth_mm, beads.depth_mm)
    core = np.asarray(core_track_count(count, beads.is_point, half, pitch_mm))
    outer = (count - core) // 2
    left = half - np.where(
        outer >= SHIFTED_FROM, (outer - 1) * pitch_mm + second_mm, outer * pitch_mm)
    return np.asarray(np.clip(2 * left / core, *limits_mm))


def chains(links: IntArray) -> list[IntArray]:
    """Links joined into chains of points between ends and junctions; each link is used once.

    A ring repeats its first point last.
    """
    if len(links) == 0:
        return []
    points, ends = _chains_kernel(np.ascontiguousarray(links), int(links.max()) + 1)
    return np.split(points, ends[:-1])


@kernel
def _chains_kernel(links: IntArray, n_points: int) -> tuple[IntArray, IntArray]:
    """Points of all chains one after the other, and where each ends."""
    first = np.zeros(n_points + 1, np.int64)
    for e in range(len(links)):
        first[links[e, 0] + 1] += 1
        first[links[e, 1] + 1] += 1
    for k in range(n_points):
        first[k + 1] += first[k]
    place = first.copy()
    other, twin = np.empty(2 * len(links), np.int64), np.empty(2 * len(links), np.int64)
    for e in range(len(links)):
        a, b = place[links[e, 0]], place[links[e, 1]]
        place[links[e, 0]] += 1
        if a == b:
            b += 1
        place[links[e, 1]] += 1
        other[a], other[b] = links[e, 1], links[e, 0]
        twin[a], twin[b] = b, a
    used = np.zeros(2 * len(links), np.bool_)
    points, ends = np.empty(2 * len(links), np.int64), np.empty(len(links), np.int64)
    count, n_chains = 0, 0
    for turn in range(2):  # what has no end is a ring
        for start in range(n_points):
            degree = first[start + 1] - first[start]
            if degree == 0 or (turn == 0 and degree == 2):
                continue
            for entry in range(first[start], first[start + 1]):
                if used[entry]:
                    continue
                points[count], count = start, count + 1
                at = entry
                while True:
                    used[at] = used[twin[at]] = True
                    here = other[at]
                    points[count], count = here, count + 1
                    if here == start or first[here + 1] - first[here] != 2:
                        break
                    back = twin[at]
                    at = first[here] + 1 if back == first[here] else first[here]
                    if used[at]:
                        break
                ends[n_chains], n_chains = count, n_chains + 1
    return points[:count].copy(), ends[:n_chains].copy()


def through_junctions(found: list[IntArray], points_mm: FloatArray) -> list[IntArray]:
    """Chains joined two by two where they meet, the straightest first."""
    at_point: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for number, chain in enumerate(found):
        if chain[0] != chain[-1]:
            at_point[int(chain[0])].append((number, 0))
            at_point[int(chain[-1])].append((number, -1))
    partner: dict[tuple[int, int], tuple[int, int]] = {}
    for meeting in at_point.values():
        if len(meeting) < 2:
            continue
        way = {end: _outward(found[end[0]], end[1], points_mm) for end in meeting}
        pairs = sorted(
            ((float(way[a] @ way[b]), a, b) for n, a in enumerate(meeting)
             for b in meeting[n + 1 :]))
        for _, a, b in pairs:
            if a not in partner and b not in partner and a[0] != b[0]:
                partner[a], partner[b] = b, a
    joined, done = [], set()
    starts = [(n, e) for n in range(len(found)) for e in (0, -1) if (n, e) not in partner]
    for number, end in [*starts, *((n, 0) for n in range(len(found)))]:
        if number in done:
            continue
        done.add(number)
        walk = found[number] if end == 0 else found[number][::-1]
        out = (number, -1 if end == 0 else 0)
        while out in partner and partner[out][0] not in done:
            number, end = partner[out]
            done.add(number)
            more = found[number] if end == 0 else found[number][::-1]
            walk = np.concatenate([walk, more[1:]])
            out = (number, -1 if end == 0 else 0)
        joined.append(walk)
    return joined


def _outward(chain: IntArray, end: int, points_mm: FloatArray) -> FloatArray:
    """Direction in which a chain leaves the point it ends at, (2,)."""
    line = points_mm[chain if end == 0 else chain[::-1]]
    way = line[min(8, len(line) - 1)] - line[0]
    return np.asarray(way / max(float(np.hypot(*way)), 1e-12))


def _has_neighbour(links: IntArray, beads: BeadCount, *, larger: bool) -> NDArray[np.bool_]:
    """Whether the axis goes on, along the middle, with more or with fewer tracks. (v,)"""
    found = np.zeros(len(beads.track_count), dtype=np.bool_)
    for a, b in (links.T, links.T[::-1]):
        differs = (beads.track_count[b] > beads.track_count[a] if larger
                   else (beads.track_count[b] < beads.track_count[a]) & (beads.track_count[b] > 0))
        found[a[differs & beads.has_centreline[b]]] = True
    return found


def _ends_in_tip(axis: MedialAxis, beads: BeadCount) -> NDArray[np.bool_]:
    """Where the axis goes on, between opposite walls, too narrow for a track. (v,)"""
    found = np.zeros(len(beads.track_count), dtype=np.bool_)
    for a, b in (axis.links.T, axis.links.T[::-1]):
        found[a[(beads.track_count[b] == 0) & axis.is_central[b]]] = True
    return found


def _tip_area_mm2(axis: MedialAxis) -> FloatArray:
    """Area of the wedge that narrows from each point of the axis on, (v,) [mm²]."""
    steepness = np.clip(np.hypot(axis.slope[:, 0], axis.slope[:, 1]), 1e-3, 0.99)
    return np.asarray(axis.depth_mm**2 * np.sqrt(1 - steepness**2) / steepness)


def _extended(
    track: Toolpath, width_mm: float, most_mm: float, raster: SectionRaster
) -> Toolpath:
    """The track a little farther, so that it deposits what lies beyond: half a strip in length.

    Half of that by being longer, half by a wider strip in its last stretch, if that may be wider.
    """
    wider = min(1.5 - _BEYOND, max(1.0, most_mm / width_mm))
    track = prolonged_track(track, (1.5 - wider) * width_mm, width_mm, raster)
    along = arc_lengths(track.points_mm)
    first = max(0.0, along[-1] - width_mm)
    track = resampled_track(track, np.unique(np.append(along, first)))
    along = arc_lengths(track.points_mm)
    end = along >= first - 1e-9
    strip = np.where(end, track.strip_width_mm * wider, track.strip_width_mm)
    return Toolpath(track.points_mm, np.minimum(strip, most_mm), False)
