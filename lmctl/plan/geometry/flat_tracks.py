"""Tracks of a slice before they have mixtures, in flat arrays: closed ones first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray, IndexArray
from lmctl.plan.geometry.toolpath import Toolpath

#: A track of less extent may, on the program's raster, hold no motion that a controller can make.
_LEAST_EXTENT_MM = 0.042


@dataclass(frozen=True, eq=False)
class FlatTracks:
    """table : (n, 3) float64, x, y and strip width [mm] of all points, one track after the other
    starts : (m + 1,) rows where tracks begin; is_closed, island : (m,)
    """

    table: FloatArray
    starts: IndexArray
    is_closed: BoolArray
    island: IndexArray

    @property
    def n_closed(self) -> int:
        """These are the first ones."""
        return int(np.count_nonzero(self.is_closed))


def flat_tracks(
    tracks: Sequence[Toolpath], island: IndexArray, spacing_mm: float
) -> FlatTracks:
    """Tracks with points at most so far apart; without those that a controller cannot move along.

    island : of each track, negative ones count as 0
    """
    kept = [(track.densified(spacing_mm), max(int(owner), 0))
            for track, owner in zip(tracks, island, strict=True)
            if np.ptp(track.points_mm, axis=0).max() >= _LEAST_EXTENT_MM]
    kept.sort(key=lambda found: not found[0].is_closed)
    size = [len(track.points_mm) for track, _ in kept]
    table = np.empty((sum(size), 3))
    starts = np.cumsum([0, *size])
    for (track, _), begin, end in zip(kept, starts[:-1], starts[1:], strict=True):
        table[begin:end, :2] = track.points_mm
        table[begin:end, 2] = track.strip_width_mm
    return FlatTracks(
        table, starts, np.array([track.is_closed for track, _ in kept], dtype=np.bool_),
        np.array([owner for _, owner in kept], dtype=np.intp))
