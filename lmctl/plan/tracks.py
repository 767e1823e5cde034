"""From a section to tracks: the lines along which the nozzle lays beads.

In-plane strategy: iso-contours of the in-plane distance at a/2, a/2 + d, …; where the tracks of
opposite walls would run into each other, one centreline track replaces them; where they leave a
void, one is added (spacing.py). The strategy iso-3d is the paper's literal reading: iso-contours
of the 3D distance, with nothing in between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from lmctl.field.plane import PlaneGrid, iso_loops
from lmctl.plan import spacing
from lmctl.plan.medial import MedialAxis, medial_axis
from lmctl.plan.polyline import arc_lengths, densified

FloatArray = NDArray[np.float64]


class Section(Protocol):
    """What tracks are cut from: `lmctl.part.Section`."""

    @property
    def grid(self) -> PlaneGrid: ...
    @property
    def loops(self) -> list[FloatArray]: ...
    @property
    def distance(self) -> NDArray[np.float32]: ...
    @property
    def volume_distance(self) -> NDArray[np.float32]: ...


@dataclass(frozen=True)
class Track:
    """One line to lay.

    points : (k, 2) float64 [mm], at most a/10 apart; a closed track repeats its first point last
    share_mm : (k,) float64, width of the strip it has to fill, from which its volume follows
    island : which connected piece of the slice it belongs to
    """

    points: FloatArray
    share_mm: FloatArray
    closed: bool
    island: int

    @property
    def length_mm(self) -> float:
        return float(arc_lengths(self.points)[-1])


def in_plane_tracks(section: Section, bead_mm: float, pitch_mm: float) -> list[Track]:
    """Tracks of a section by the in-plane distance, island by island.

    Every track lies at least 0.45 a inside the outline; pieces shorter than a/2 are left out.
    """
    if not section.loops or section.distance.max() <= 0:
        return []
    labels, count = ndimage.label(section.distance > 0)
    axis = medial_axis(section.loops, section.distance, section.grid, bead_mm / 10)
    owner = _island_of(axis, labels, section.grid)
    tracks: list[Track] = []
    boxes = ndimage.find_objects(labels)
    for island in range(1, count + 1):
        grid, values = _cut_out(section, labels, island, boxes[island - 1])
        deepest = float(values.max())
        if deepest < (0.5 - spacing.INSET_TOLERANCE) * bead_mm:
            continue
        mine = owner == island
        pitch = spacing.fitting_pitch_mm(
            axis.edge_radius_mm()[mine], axis.edge_lengths_mm()[mine], deepest, bead_mm, pitch_mm)
        tracks += _island_tracks(grid, values, axis, mine, bead_mm, pitch, island - 1)
    return [track for track in tracks if track.length_mm >= bead_mm / 2]


def iso_3d_tracks(section: Section, bead_mm: float, pitch_mm: float) -> list[Track]:
    """Iso-contours of the 3D distance in this plane, at a/2 and every pitch (method.md 3)."""
    deepest = float(section.volume_distance.max()) if section.volume_distance.size else 0.0
    levels = np.arange(bead_mm / 2, deepest, pitch_mm)
    loops = iso_loops(section.volume_distance, section.grid, levels)
    return [
        Track(fine, np.full(len(fine), pitch_mm), True, 0)
        for level in loops for loop in level
        if arc_lengths(fine := densified(loop, bead_mm / 10))[-1] >= bead_mm / 2
    ]


def _island_of(axis: MedialAxis, labels: NDArray[np.int32], grid: PlaneGrid) -> NDArray[np.int32]:
    """The label of the node nearest to each medial edge; 0 where that is outside. (e,)"""
    middle = axis.points[axis.edges].mean(axis=1) if len(axis.edges) else np.empty((0, 2))
    index = np.round((middle - grid.origin_mm) / grid.pitch_mm).astype(np.intp)
    j = np.clip(index[:, 1], 0, grid.shape[0] - 1)
    i = np.clip(index[:, 0], 0, grid.shape[1] - 1)
    return np.asarray(labels[j, i])


def _cut_out(
    section: Section, labels: NDArray[np.int32], island: int, box: tuple[slice, slice]
) -> tuple[PlaneGrid, NDArray[np.float32]]:
    """The distance of one island on its own small grid; other islands count as outside."""
    grid = section.grid
    rows = slice(max(0, box[0].start - 1), box[0].stop + 1)
    columns = slice(max(0, box[1].start - 1), box[1].stop + 1)
    mine = labels[rows, columns]
    values = section.distance[rows, columns]
    values = np.where((mine == island) | (values <= 0), values, -grid.pitch_mm).astype(np.float32)
    origin = (grid.origin_mm[0] + columns.start * grid.pitch_mm,
              grid.origin_mm[1] + rows.start * grid.pitch_mm)
    return PlaneGrid(origin, grid.pitch_mm, (values.shape[0], values.shape[1])), values


def _island_tracks(
    grid: PlaneGrid, values: NDArray[np.float32], axis: MedialAxis, mine: NDArray[np.bool_],
    bead_mm: float, pitch_mm: float, island: int,
) -> list[Track]:
    """All tracks of one island: contours without the stretches centrelines replace, centrelines."""
    middle = spacing.centrelines(axis.radius_mm, bead_mm, pitch_mm)
    both = middle.runs[axis.edges].all(axis=1)
    chains = [
        chain for chain in axis.chains(mine & both)
        if arc_lengths(axis.points[chain])[-1] >= bead_mm / 2
    ]
    laid = np.zeros(len(axis.points), dtype=np.bool_)
    for chain in chains:
        laid[chain] = True
    own = np.zeros(len(axis.points), dtype=np.bool_)
    own[axis.edges[mine]] = True
    tracks = []
    levels = np.arange(bead_mm / 2, float(values.max()), pitch_mm)
    for number, loops in enumerate(iso_loops(values, grid, levels)):
        way = axis.radius_mm - levels[number]
        near = own & (way >= 0) & (way < pitch_mm)
        meeting = _Meeting(
            axis.points[near], way[near], laid[near] & (middle.merges[near] == number))
        for loop in loops:
            tracks += _contour_tracks(loop, meeting, bead_mm, pitch_mm, island)
    for chain in chains:
        points = densified(
            np.column_stack([axis.points[chain], middle.share_mm[chain]]), bead_mm / 10)
        tracks.append(Track(
            points[:, :2], points[:, 2], bool(chain[0] == chain[-1]), island))
    return tracks


@dataclass(frozen=True)
class _Meeting:
    """Medial vertices within a pitch of a contour: where, how far, and whether it merges there."""

    points: FloatArray
    way_mm: FloatArray
    merges: NDArray[np.bool_]


def _contour_tracks(
    loop: FloatArray, meeting: _Meeting, bead_mm: float, pitch_mm: float, island: int
) -> list[Track]:
    """A contour less the stretches a centreline replaces; each vertex with its share."""
    step = bead_mm / 10
    fine = densified(loop, step)
    if len(meeting.points) == 0:
        return [Track(fine, np.full(len(fine), pitch_mm), True, island)]
    # No contour point is nearer to a medial vertex than that vertex's way; the one it faces is
    # just so near.
    gap, facing = cKDTree(meeting.points).query(fine)
    way = np.where(gap <= meeting.way_mm[facing] + 2 * step, meeting.way_mm[facing], np.inf)
    covered = np.isfinite(way) & meeting.merges[facing]
    share = spacing.share_beside_mm(way, bead_mm, pitch_mm)
    if not covered.any():
        return [Track(fine, share, True, island)]
    if covered.all():
        return []
    first = int(np.flatnonzero(covered)[0])
    order = np.concatenate([np.arange(first, len(fine) - 1), np.arange(first + 1)])
    edges = np.flatnonzero(np.diff(covered[order].astype(np.int8)))
    return [
        Track(fine[order[a + 1 : b + 1]], share[order[a + 1 : b + 1]], False, island)
        for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1
    ]
