"""From a section to tracks: the lines along which the nozzle lays beads.

In-plane strategy: iso-contours of the in-plane distance at a/2, a/2 + d, …; where the tracks of
opposite walls would run into each other, one centreline track replaces them; where they leave a
void, one is added (spacing.py); where the raster cannot part them, they are drawn around the
middle (hairpins.py). The strategy iso-3d is the paper's literal reading: iso-contours
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
from lmctl.plan.hairpins import around, ring
from lmctl.plan.medial import MedialAxis, medial_axis
from lmctl.plan.middles import pieces, replacing
from lmctl.plan.polyline import arc_lengths, densified
from lmctl.plan.spacing import Centrelines

FloatArray = NDArray[np.float64]

#: Nearer to their middle than a raster pitch, or than this part of a bead, contours are drawn
#: around it.
_NARROW = 0.125
#: The smallest ring that is laid, in bead widths.
_LEAST_RING = 0.02


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

    Every track lies at least 0.45 a inside the outline; contours shorter than a/2 are left out.
    """
    if not section.loops or section.distance.max() <= 0:
        return []
    labels, count = ndimage.label(section.distance > 0)
    axis = medial_axis(section.loops, section.distance, section.grid, bead_mm / 10)
    owner = _labels_at(axis.points[axis.edges].mean(axis=1), labels, section.grid)
    home = _labels_at(axis.centres, labels, section.grid)
    tracks: list[Track] = []
    boxes = ndimage.find_objects(labels)
    for island in range(1, count + 1):
        own, mine = home == island, owner == island
        deepest = float(axis.centre_radius_mm[own].max(initial=0.0))
        if deepest < spacing.LEAST_DEPTH * bead_mm:
            continue
        grid, values = _cut_out(section, labels, island, boxes[island - 1])
        pitch = spacing.fitting_pitch_mm(
            axis.edge_radius_mm()[mine], axis.edge_lengths_mm()[mine], deepest, bead_mm, pitch_mm)
        narrow = min(max(grid.pitch_mm, _NARROW * bead_mm), bead_mm / 2)
        found = _island_tracks(
            grid, values, axis, mine, deepest, narrow, bead_mm, pitch, island - 1)
        tracks += found + _pins(
            found, axis.centres[own], axis.centre_radius_mm[own], narrow, bead_mm, pitch,
            island - 1)
    return tracks


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


def _labels_at(
    points: FloatArray, labels: NDArray[np.int32], grid: PlaneGrid
) -> NDArray[np.int32]:
    """The label of the node nearest to each point (n, 2); 0 where that is outside. (n,)"""
    index = np.round((points - grid.origin_mm) / grid.pitch_mm).astype(np.intp)
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
    deepest_mm: float, narrow_mm: float, bead_mm: float, pitch_mm: float, island: int,
) -> list[Track]:
    """All tracks of one island: contours without the stretches others replace, and those others."""
    middle = spacing.centrelines(axis.radius_mm, bead_mm, pitch_mm, narrow_mm)
    laid = np.zeros(len(axis.points), dtype=np.bool_)
    tracks = []
    for chain in replacing(axis, mine, middle, bead_mm):
        laid[chain] = True
        for piece in pieces(chain, axis, middle, bead_mm / 2):
            tracks += _middle_tracks(piece, axis, middle, bead_mm, pitch_mm, island)
    own = np.zeros(len(axis.points), dtype=np.bool_)
    own[axis.edges[mine]] = True
    contours = []
    levels = np.arange(bead_mm / 2, deepest_mm, pitch_mm)
    if deepest_mm < bead_mm / 2 + narrow_mm:  # no more than the raster's blobs
        levels = levels[:0]
    for number, loops in enumerate(iso_loops(values, grid, levels)):
        way = axis.radius_mm - levels[number]
        near = own & (way >= 0) & (way < pitch_mm)
        meeting = _Meeting(
            axis.points[near], way[near], laid[near] & (middle.merges[near] == number))
        for loop in loops:
            contours += _contour_tracks(loop, meeting, bead_mm, pitch_mm, island)
    return [track for track in contours if track.length_mm >= bead_mm / 2] + tracks


def _middle_tracks(
    piece: tuple[NDArray[np.intp], bool], axis: MedialAxis, middle: Centrelines,
    bead_mm: float, pitch_mm: float, island: int,
) -> list[Track]:
    """The centreline along a piece of the medial axis, or the two tracks beside it."""
    chain, two = piece
    if two:
        loops = around(axis.points[chain], middle.way_mm[chain], bead_mm / 10)
        return [
            Track(loop[:, :2], pitch_mm / 2 + loop[:, 2], True, island)
            for loop in loops
        ]
    points = densified(np.column_stack([axis.points[chain], middle.share_mm[chain]]), bead_mm / 10)
    return [Track(points[:, :2], points[:, 2], bool(chain[0] == chain[-1]), island)]


def _pins(
    tracks: list[Track], centres: FloatArray, radius_mm: FloatArray, narrow_mm: float,
    bead_mm: float, pitch_mm: float, island: int,
) -> list[Track]:
    """Rings in places hardly wider than a bead, in any direction, that no track comes near.

    centres (c, 2), radius_mm (c,) : of circles in the outline, the largest of each place with them
    """
    inset_mm = spacing.INSET_TOLERANCE * bead_mm
    rest_mm = radius_mm - bead_mm / 2
    size_mm = np.minimum(np.maximum(rest_mm, inset_mm), rest_mm + inset_mm)
    slim = (size_mm >= _LEAST_RING * bead_mm) & (rest_mm < narrow_mm)
    centres, size_mm = centres[slim], size_mm[slim]
    if tracks and len(centres):
        laid = cKDTree(np.vstack([track.points for track in tracks]))
        far = laid.query(centres)[0] > bead_mm / 2
        centres, size_mm = centres[far], size_mm[far]
    rings: list[Track] = []
    while len(centres):
        deepest = int(np.argmax(size_mm))
        points = densified(ring(centres[deepest], float(size_mm[deepest])), bead_mm / 10)
        share = spacing.share_around_mm(float(size_mm[deepest]), pitch_mm)
        rings.append(Track(points, np.full(len(points), share), True, island))
        far = np.linalg.norm(centres - centres[deepest], axis=1) > bead_mm / 2
        centres, size_mm = centres[far], size_mm[far]
    return rings


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
