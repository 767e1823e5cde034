"""Every other track first, and those between into what these leave: on a plate of another alloy.

A bead that overlaps one of its own layer melts that one where it lies upon it, and the plate where
it does not. One mixture cannot make up for both: the stripe where two beads overlap becomes too
rich of what the plate lacks. So in a layer on another alloy than its own every other track is
deposited first, as wide as its bead: these lie on the plate alone. Those between fill the gaps and
lie upon their neighbours hardly at all. What one gains in strip width its neighbours lose.

Tracks are neighbours where they run side by side; the two rounds are the colours of a spanning
tree of neighbours, the longest shared stretches first (Kruskal 1956).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.geometry.beside_tracks import left_of_tracks
from lmctl.plan.geometry.layer_geometry import LayerGeometry

#: A layer on a plate whose alloy differs by more than this volume fraction lies on another one: at
#: a dilution of 20 % it is the tolerance of a mixture.
OTHER_ALLOY_FRACTION = 0.1
#: The strip of a neighbour begins so near to where it should be, in strip widths of this track.
_BESIDE_STRIPS = 0.55
#: A vertex of a neighbour lies at least so far to the side, in strip widths.
_LEAST_BESIDE_STRIPS = 0.3
#: Most that a track gains or loses on one side, as a share of the pitch, and that it loses of its
#: own strip: speeds follow strips, and are limited (`recipe.Recipe.strip_speed_factor`).
_MOST_GIVEN_PITCHES, _MOST_GIVEN_STRIPS = 0.25, 0.25


def lies_on_other_alloy(fractions: FloatArray, substrate: FloatArray) -> bool:
    """Whether mixtures (n, materials) differ from a substrate's (materials + 1,), of which the last
    is its share of none of the part's materials."""
    off = np.abs(fractions - substrate[:-1]).max(initial=0.0)
    return bool(max(off, substrate[-1]) > OTHER_ALLOY_FRACTION)


def alternate_tracks(geometry: LayerGeometry, bead_mm: float, pitch_mm: float) -> LayerGeometry:
    """The layer with each track's round, and the strips that belong to it.

    The volume of the layer stays. A layer whose tracks have no neighbours comes back as it is.
    """
    track = np.repeat(np.arange(geometry.n_tracks), np.diff(geometry.starts))
    sides = [_neighbours(geometry, track, side) for side in (1.0, -1.0)]
    length = _lengths_mm(geometry)
    rounds = _rounds(track, sides, length, geometry.n_tracks)
    if not rounds.any():
        return geometry
    own = geometry.strip_width_mm
    gained = np.zeros(len(own))
    for beside in sides:
        vertex = np.flatnonzero(beside >= 0)
        other = beside[vertex]
        differs = rounds[track[vertex]] != rounds[track[other]]
        vertex, other = vertex[differs], other[differs]
        is_first = rounds[track[vertex]] == 0
        first, second = np.where(is_first, vertex, other), np.where(is_first, other, vertex)
        given = np.minimum((bead_mm - own[first]) / 2, _MOST_GIVEN_STRIPS * own[second])
        given = np.clip(given, 0.0, _MOST_GIVEN_PITCHES * pitch_mm)
        gained[vertex] += np.where(is_first, given, -given)
    return replace(geometry, strip_width_mm=own + _balanced(gained, length), rounds=rounds)


def _balanced(gained: FloatArray, length: FloatArray) -> FloatArray:
    """Gains and losses whose volumes are equal: what is too much of one is left out."""
    volume = gained * length
    more, less = float(volume[volume > 0].sum()), -float(volume[volume < 0].sum())
    if min(more, less) <= 0.0:
        return np.zeros(len(gained))
    return np.where(gained > 0, gained * min(1.0, less / more), gained * min(1.0, more / less))


def _lengths_mm(geometry: LayerGeometry) -> FloatArray:
    """Length that belongs to each vertex, (n,): half of the segments beside it."""
    step = np.linalg.norm(np.diff(geometry.points_mm, axis=0), axis=1)
    step[geometry.starts[1:-1] - 1] = 0.0
    return np.asarray((np.append(step, 0.0) + np.append(0.0, step)) / 2)


def _neighbours(geometry: LayerGeometry, track: IndexArray, side: float) -> IndexArray:
    """The nearest vertex of another track beside each vertex, (n,); -1 where there is none.

    side : 1.0 to the left, -1.0 to the right
    """
    from scipy.spatial import cKDTree  # late: only first layers need it

    points, strip = geometry.points_mm, geometry.strip_width_mm
    left = left_of_tracks(geometry)
    _, found = cKDTree(points).query(
        points + side * left * strip[:, None],
        distance_upper_bound=_BESIDE_STRIPS * float(np.median(strip)))
    at = np.flatnonzero(found < len(points))
    at = at[track[found[at]] != track[at]]
    away = ((points[found[at]] - points[at]) * left[at]).sum(axis=1) * side
    at = at[away > _LEAST_BESIDE_STRIPS * strip[at]]
    beside = np.full(len(points), -1, dtype=np.intp)
    beside[at] = found[at]
    return beside


def _rounds(
    track: IndexArray, sides: list[IndexArray], length: FloatArray, tracks: int
) -> IndexArray:
    """The round of each track, (m,): 0 for the longer half of those that hang together."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    vertex = np.concatenate([np.flatnonzero(beside >= 0) for beside in sides])
    other = np.concatenate([beside[beside >= 0] for beside in sides])
    shared = coo_array((length[vertex], (track[vertex], track[other])), shape=(tracks, tracks))
    shared = (shared + shared.T).tocsr()
    tree = minimum_spanning_tree(-shared)
    tree = tree + tree.T
    own_mm = np.bincount(track, length, tracks)
    rounds = np.full(tracks, -1, dtype=np.intp)
    for root in range(tracks):
        if rounds[root] >= 0:
            continue
        order, before = breadth_first_order(tree, root, directed=False)
        rounds[root] = 0
        for one in order[1:]:
            rounds[one] = 1 - rounds[before[one]]
        if own_mm[order] @ (2 * rounds[order] - 1) > 0:
            rounds[order] = 1 - rounds[order]
    return rounds
