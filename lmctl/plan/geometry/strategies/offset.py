"""Offset tracks: along the outline, a pitch apart, with centrelines where the width is odd."""

from __future__ import annotations

from lmctl.plan.geometry.links import linked_tracks
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks


def offset_tracks(task: SliceTask) -> StrategyTracks:
    """Tracks parallel to the outline of the task, neighbours of equal mixture linked where the task
    has it so."""
    rules = task.link_rules()
    layout = task.outline.offset_layout(
        task.bead_mm, rules, task.least_width_mm, is_odd_layer=task.is_odd_layer)
    lines = task.mixtures_along(layout.tracks)
    if task.links:
        lines = linked_tracks(lines, task.raster, rules, layout.places)
    return StrategyTracks(lines, layout.narrow_mm2)
