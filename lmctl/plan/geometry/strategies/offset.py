"""Offset tracks: along the outline, a pitch apart, with centrelines where the width is odd."""

from __future__ import annotations

import numpy as np

from lmctl.plan.geometry.in_plane import InPlaneLayout, in_plane_layout
from lmctl.plan.geometry.links import linked_tracks
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks


def offset_tracks(task: SliceTask) -> StrategyTracks:
    """Tracks parallel to the outline of the task, neighbours of equal mixture linked."""
    layout = in_plane_layout(
        task.raster, task.islands, task.bead_mm, task.pitch_mm, task.least_width_mm,
        is_odd_layer=task.is_odd_layer)
    lines = task.with_mixtures(layout.tracks, layout.island)
    return StrategyTracks(linked_tracks(lines, task.raster, task.link_rules()),
                          _narrow_area_mm2(layout, task.bead_mm))


def _narrow_area_mm2(layout: InPlaneLayout, bead_mm: float) -> float:
    """Area that single tracks have to themselves where the material is narrower than a bead."""
    single = layout.beads.has_centreline & (layout.beads.track_count == 1)
    narrow = single & (2 * layout.axis.depth_mm < bead_mm * (1 - 1e-6))
    links = layout.axis.links[narrow[layout.axis.links].all(axis=1)]
    length = np.linalg.norm(np.diff(layout.axis.points_mm[links], axis=1)[:, 0], axis=1)
    return float((length * 2 * layout.axis.depth_mm[links].mean(axis=1)).sum())
