"""Tracks of a slice that is filled region by region, none crossing from one into another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks


def tracks_by_region(
    task: SliceTask, regions: Sequence[SliceTask],
    strategy: Callable[[SliceTask], StrategyTracks] = offset_tracks,
) -> StrategyTracks:
    """Tracks of a strategy within each region of a slice, with the islands of the whole slice."""
    found = [strategy(region) for region in regions]
    tracks = [track for one in found for track in one.tracks]
    middles = np.array([track.table[len(track.table) // 2, :2] for track in tracks])
    island = np.maximum(task.islands.island_at(middles.reshape(-1, 2), task.raster), 0)
    return StrategyTracks(
        [replace(track, island=int(owner)) for track, owner in zip(tracks, island, strict=True)],
        sum(one.narrow_mm2 for one in found))
