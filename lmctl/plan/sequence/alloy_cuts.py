"""Cut tracks where their mixture would cross a forbidden region.

Between the two pieces the mixture changes with the beam off. The piece before the cut keeps the
mixture of its last vertex outside the region up to the cut, the piece after it begins with that of
its first. A piece shorter than half a bead takes the mixture of the piece beside it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.part.materials.laid_mixtures import LaidMixtures
from lmctl.plan.geometry.layer_geometry import LayerGeometry
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.sequence.flat_arrays import arc_lengths_mm
from lmctl.plan.sequence.track_order import TRACK_GAP_MM, OrderedTracks

#: The shortest piece that a cut leaves, in beads.
LEAST_PIECE_BEADS = 0.5
#: Cuts keep so far from vertices.
_BESIDE_MM = 1e-3
#: Changes of mixture smaller than this cross nothing.
_NO_CHANGE = 1e-6


@dataclass(frozen=True)
class CrossingCuts:
    """A layer with its tracks cut; how many cuts, and length that took another piece's mixture."""

    geometry: LayerGeometry
    cuts: int
    joined_mm: float


def cut_at_crossings(
    geometry: LayerGeometry, mixtures: LaidMixtures, bead_mm: float
) -> CrossingCuts:
    """The tracks of a layer, none of which crosses a forbidden region between two vertices."""
    found = _crossing_steps(geometry, mixtures)
    if len(found) == 0:
        return CrossingCuts(geometry, 0, 0.0)
    geometry, joined_mm = _with_short_pieces_joined(geometry, found, bead_mm)
    found = _crossing_steps(geometry, mixtures)
    return CrossingCuts(_cut_between(geometry, found) if len(found) else geometry, len(found),
                        joined_mm)


def cut_between_vertices(tracks: OrderedTracks, vertices: IndexArray) -> OrderedTracks:
    """Tracks cut half-way before vertices (k,), rising, none the first of a track; each piece
    keeps its own mixture up to the cut."""
    at_mm = (tracks.along_mm[vertices - 1] + tracks.along_mm[vertices]) / 2
    cut = cut_ordered_tracks(tracks, at_mm)
    end = vertices + 2 * np.arange(len(vertices))
    cut.fractions[end] = tracks.fractions[vertices - 1]
    cut.fractions[end + 1] = tracks.fractions[vertices]
    return cut


def cut_ordered_tracks(tracks: OrderedTracks, at_mm: FloatArray) -> OrderedTracks:
    """Tracks cut at lengths (k,), rising, each inside a track; the mixture there is that of both
    pieces."""
    nearest = np.abs(tracks.along_mm[None] - at_mm[:, None]).min(axis=1)
    at_mm = np.where(nearest < _BESIDE_MM, at_mm + _BESIDE_MM, at_mm)
    place = np.searchsorted(tracks.along_mm, at_mm)
    before = np.repeat(place, 2)

    def cut(columns: FloatArray) -> FloatArray:
        """Columns at the vertices, with two more at each cut."""
        table = columns.reshape(len(tracks.along_mm), -1)
        new = np.column_stack([np.interp(at_mm, tracks.along_mm, one) for one in table.T])
        return np.insert(table, before, np.repeat(new, 2, axis=0), axis=0).reshape(
            -1, *columns.shape[1:])

    new = place + 2 * np.arange(len(place)) + 1  # the first vertex of each second piece
    old = tracks.starts + 2 * np.searchsorted(place, tracks.starts, side="left")
    along = np.insert(tracks.along_mm, before, np.repeat(at_mm, 2))
    gaps = np.zeros(len(along))
    gaps[new] = TRACK_GAP_MM
    melted = tracks.melted
    return OrderedTracks(
        cut(tracks.points_mm), cut(tracks.strip_width_mm), cut(tracks.fractions),
        np.sort(np.concatenate([old, new])).astype(np.intp), along + np.cumsum(gaps),
        None if melted is None else MeltedBelow(
            cut(melted.designed), cut(melted.below), cut(melted.share)),
        None if tracks.designed is None else cut(tracks.designed))


def _crossing_steps(geometry: LayerGeometry, mixtures: LaidMixtures) -> IndexArray:
    """Vertices whose mixture lies across a forbidden region from that of the vertex before."""
    changes = np.abs(np.diff(geometry.fractions, axis=0)).max(axis=1) > _NO_CHANGE
    changes[geometry.starts[1:-1] - 1] = False
    step = np.flatnonzero(changes)
    crossed = mixtures.crosses_region(geometry.fractions[step], geometry.fractions[step + 1])
    return np.asarray(step[crossed] + 1)


def _with_short_pieces_joined(
    geometry: LayerGeometry, cuts: IndexArray, bead_mm: float
) -> tuple[LayerGeometry, float]:
    """The layer with the mixture of its short pieces as beside them, and their length."""
    along = arc_lengths_mm(geometry.points_mm, geometry.starts)
    fractions = geometry.fractions.copy()
    track = np.searchsorted(geometry.starts, cuts, side="right") - 1
    joined_mm = 0.0
    for number in np.unique(track).tolist():
        first, end = int(geometry.starts[number]), int(geometry.starts[number + 1])
        edges = [first, *cuts[track == number].tolist(), end]
        ring = bool(geometry.is_closed[number])
        for k in range(len(edges) - 1):
            a, b = edges[k], edges[k + 1]
            length = along[b - 1] - along[a]
            if length >= LEAST_PIECE_BEADS * bead_mm or (
                    ring and k in (0, len(edges) - 2)):  # they are one piece, across the seam
                continue
            fractions[a:b] = fractions[a - 1] if k else fractions[b]
            joined_mm += float(length)
    return replace(geometry, fractions=fractions), joined_mm


def _cut_between(geometry: LayerGeometry, cuts: IndexArray) -> LayerGeometry:
    """The layer with each track cut before vertices `cuts` (k,), rising, between them and the
    vertices before."""
    track = np.searchsorted(geometry.starts, cuts, side="right") - 1
    parts: list[tuple[int, list[int], int, int]] = []  # track, vertices, cut at either end or −1
    for number in range(geometry.n_tracks):
        first, end = int(geometry.starts[number]), int(geometry.starts[number + 1])
        own = cuts[track == number].tolist()
        if own and geometry.is_closed[number]:  # from the last cut, through the seam, to the first
            seam = [*range(own[-1], end), *range(first + 1, own[0])]
            parts.append((number, seam, own[-1], own[0]))
            parts += [(number, list(range(a, b)), a, b)
                      for a, b in pairwise(own)]
        else:
            edges = [first, *own, end]
            parts += [(number, list(range(a, b)), a if a != first else -1, b if b != end else -1)
                      for a, b in pairwise(edges)]
    vertex = np.concatenate([
        [*([vertices[0]] if begin >= 0 else []), *vertices, *([vertices[-1]] if end >= 0 else [])]
        for _, vertices, begin, end in parts]).astype(np.intp)
    size = [len(vertices) + (begin >= 0) + (end >= 0) for _, vertices, begin, end in parts]
    starts = np.concatenate([[0], np.cumsum(size)]).astype(np.intp)
    points = geometry.points_mm[vertex]
    for k, (_, _, begin, end) in enumerate(parts):
        if begin >= 0:
            points[starts[k]] = geometry.points_mm[begin - 1 : begin + 1].mean(axis=0)
        if end >= 0:
            points[starts[k + 1] - 1] = geometry.points_mm[end - 1 : end + 1].mean(axis=0)
    tracks = np.array([number for number, *_ in parts], dtype=np.intp)
    is_cut = np.array([max(begin, end) >= 0 for _, _, begin, end in parts], dtype=np.bool_)
    directed, designed = geometry.is_directed, geometry.designed
    below, across = geometry.fractions_below, geometry.fractions_across
    return replace(
        geometry, points_mm=points, strip_width_mm=geometry.strip_width_mm[vertex],
        fractions=geometry.fractions[vertex],
        starts=starts, is_closed=geometry.is_closed[tracks] & ~is_cut,
        island=geometry.island[tracks],
        copy=None if geometry.copy is None else geometry.copy[tracks],
        rounds=None if geometry.rounds is None else geometry.rounds[tracks],
        is_directed=None if directed is None else directed[tracks],
        designed=None if designed is None else designed[vertex],
        fractions_below=None if below is None else below[vertex],
        fractions_across=None if across is None else across[vertex])

