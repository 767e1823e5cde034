"""Iso-composition tracks: along lines of equal mixture, a pitch apart in the plane."""

from __future__ import annotations

from dataclasses import replace

from lmctl.plan.geometry.planar_region import loops_of, region_of
from lmctl.plan.geometry.strategies.mixture_bands import mixture_bands
from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.regions import tracks_by_region
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks


def iso_composition_tracks(task: SliceTask) -> StrategyTracks:
    """Tracks within bands between lines of equal mixture; offset tracks where the field is flat."""
    field = task.mixture_map
    if field is None:
        return offset_tracks(task)
    bands = mixture_bands(
        region_of(task.loops), field, task.pitch_mm, task.process.fraction_step,
        downwards=task.is_odd_layer)
    if len(bands) == 1:
        return offset_tracks(task)
    return tracks_by_region(task, [replace(task, loops=loops_of(band)) for band in bands])
