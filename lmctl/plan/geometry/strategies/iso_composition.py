"""Iso-composition tracks: along lines of equal mixture, a pitch apart in the plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.plan.geometry.link_lines import LinkableTrack
from lmctl.plan.geometry.planar_region import loops_of, pieces_of, region_of
from lmctl.plan.geometry.strategies.mixture_bands import mixture_bands
from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.regions import tracks_by_region
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks

#: Tracks shorter than this, in beads, are not worth their starts.
_SHORT_BEADS = 2.0
#: A piece of a slice with a greater share of them, by length, gets offset tracks.
_MOST_SHORT = 0.5


def iso_composition_tracks(task: SliceTask) -> StrategyTracks:
    """Tracks within bands between lines of equal mixture; offset tracks where the field is flat.

    Offset tracks also where lines of equal mixture are mostly shorter than two beads, as across a
    wall that is graded along its length.
    """
    pieces = pieces_of(region_of(task.loops))
    if len(pieces) < 2:
        return _tracks_of_piece(task)
    return tracks_by_region(
        task, [replace(task, loops=loops_of(piece)) for piece in pieces], _tracks_of_piece)


def _tracks_of_piece(task: SliceTask) -> StrategyTracks:
    field = task.mixture_map
    if field is None:
        return offset_tracks(task)
    bands = mixture_bands(
        region_of(task.loops), field, task.pitch_mm, task.process.fraction_step,
        is_odd_layer=task.is_odd_layer)
    if len(bands) == 1:
        return offset_tracks(task)
    found = tracks_by_region(task, [replace(task, loops=loops_of(band)) for band in bands])
    return offset_tracks(task) if _mostly_short(found.tracks, task.bead_mm) else found


def _mostly_short(tracks: list[LinkableTrack], bead_mm: float) -> bool:
    """Whether most of the length of tracks is in such that are shorter than two beads."""
    length = np.array([np.linalg.norm(np.diff(track.table[:, :2], axis=0), axis=1).sum()
                       for track in tracks])
    short = length[length < _SHORT_BEADS * bead_mm].sum()
    return bool(short > _MOST_SHORT * length.sum())
