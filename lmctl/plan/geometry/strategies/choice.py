"""The tracks of a slice by the strategy that the process names, cut where its material jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lmctl.plan.geometry.iso_3d import iso_3d_tracks
from lmctl.plan.geometry.planar_region import loops_of, region_of, true_pieces
from lmctl.plan.geometry.strategies.hatch import hatch_tracks
from lmctl.plan.geometry.strategies.iso_composition import iso_composition_tracks
from lmctl.plan.geometry.strategies.jump_regions import (
    jump_regions,
    region_loops,
    region_mixture,
    tracks_cross_jump,
)
from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.regions import tracks_by_region
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks
from lmctl.plan.geometry.strategies.spiral import spiral_tracks


def tracks_of_slice(task: SliceTask) -> StrategyTracks:
    """All tracks of a slice, each with the island it lies on."""
    if task.bodies:
        return _by_body(task)
    if task.process.strategy == "iso-3d":
        tracks = iso_3d_tracks(task.section, task.bead_mm, task.pitch_mm)
        middles = np.array([track.points_mm[0] for track in tracks]).reshape(-1, 2)
        return StrategyTracks(
            task.with_mixtures(tracks, task.islands.island_at(middles, task.raster)))
    if task.process.strategy == "iso-composition":
        return iso_composition_tracks(task)
    lines = {"hatch": hatch_tracks, "spiral": spiral_tracks}
    return _between_jumps(task, lines.get(task.process.strategy, offset_tracks))


def _by_body(task: SliceTask) -> StrategyTracks:
    """Each body that has a strategy of its own filled by that, and what is left by the task's."""
    left, parts = region_of(task.loops), []
    for outline, strategy in task.bodies:
        own = region_of(outline)
        pieces = true_pieces(left ^ own, task.pitch_mm)
        parts += [task.with_strategy(strategy, loops_of(piece)) for piece in pieces]
        left = left - own
    parts += [replace(task, loops=loops_of(piece), bodies=())
              for piece in true_pieces(left, task.pitch_mm)]
    return tracks_by_region(task, parts, tracks_of_slice)


def _between_jumps(
    task: SliceTask, strategy: Callable[[SliceTask], StrategyTracks]
) -> StrategyTracks:
    """The tracks of a strategy, or where one of them crosses a jump, those of each region."""
    tracks = strategy(task)
    if not tracks_cross_jump(tracks.tracks) or task.mixture_map is None:
        return tracks
    regions = jump_regions(task.mixture_map, task.pitch_mm)
    if regions is None:
        return tracks
    step_mm = task.pitch_mm / 2 if task.process.material_seam == "stepped" else 0.0
    loops = region_loops(regions, task.loops, step_mm, from_highest=task.is_odd_layer)
    return tracks_by_region(task, [
        replace(task, loops=own, fractions_at=region_mixture(regions, number))
        for number, own in enumerate(loops) if own], strategy)
