"""Hatch tracks: straight lines at an angle that turns from layer to layer, inside an outline."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.link_lines import LinkableTrack
from lmctl.plan.geometry.planar_region import (
    grown,
    joined,
    loops_of,
    opened,
    region_of,
    true_pieces,
)
from lmctl.plan.geometry.strategies.hatch_lines import hatch_lines
from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.slice_task import SliceTask, StrategyTracks
from lmctl.plan.geometry.toolpath import Toolpath

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: What is narrower than this is filled along its outline instead, in pitches beside the outline
#: tracks: three lines fit.
_LEAST_HATCHED_PITCHES = 3.0
#: What a circle does not reach of a corner, in square pitches, is hatched all the same.
_CORNER_PITCHES_SQ = 2.0


def hatch_tracks(task: SliceTask) -> StrategyTracks:
    """Outline tracks, lines within them, and offset tracks where the slice is too narrow."""
    whole = region_of(task.loops)
    wide = _wide(whole, task)
    found: list[LinkableTrack] = []
    narrow_mm2 = 0.0
    if not wide.is_empty():
        found += _outlined(wide, task)
    for piece in true_pieces(whole - wide, task.pitch_mm):
        rest = offset_tracks(replace(task, loops=loops_of(piece)))
        found += rest.tracks
        narrow_mm2 += rest.narrow_mm2
    return StrategyTracks(_on_islands(found, task), narrow_mm2)


def hatch_angle_deg(task: SliceTask) -> float:
    """Direction of the lines in this layer, from x, in [0, 180)."""
    process = task.process
    return float((process.hatch_angle_deg + task.layer * process.hatch_turn_deg) % 180.0)


def _wide(whole: CrossSection, task: SliceTask) -> CrossSection:
    """What of a slice is wide enough for lines between its outline tracks, corners included."""
    radius = (task.process.outline_tracks + _LEAST_HATCHED_PITCHES / 2) * task.pitch_mm
    wide = opened(whole, radius)
    if wide.is_empty():
        return wide
    corners = [piece for piece in true_pieces(whole - wide, task.pitch_mm)
               if piece.area() < _CORNER_PITCHES_SQ * task.pitch_mm**2]
    return joined(wide, corners, task.pitch_mm) ^ whole


def _outlined(region: CrossSection, task: SliceTask) -> list[LinkableTrack]:
    pitch = task.pitch_mm
    outline: list[Toolpath] = []
    for number in range(task.process.outline_tracks):
        for loop in loops_of(grown(region, -(number + 0.5) * pitch)):
            outline.append(Toolpath(loop, np.full(len(loop), pitch), True))
    lines: list[Toolpath] = []
    inner = grown(region, -task.process.outline_tracks * pitch)
    for block, angle_deg in _blocks(inner, task):
        lines += hatch_lines(
            block, pitch, np.radians(angle_deg), zigzag=task.process.hatch == "zigzag")
    one_way = task.process.hatch == "one-way"
    every = [*outline, *lines]
    found = task.with_mixtures(every, np.zeros(len(every), np.intp))
    return [replace(track, is_directed=one_way and not track.is_closed) for track in found]


def _blocks(inner: CrossSection, task: SliceTask) -> list[tuple[CrossSection, float]]:
    """Pieces that are hatched one after the other, and the direction of lines in each [degrees]."""
    angle, size = hatch_angle_deg(task), task.process.hatch_block_mm
    if task.process.hatch_blocks == "none" or inner.is_empty():
        return [(inner, angle)]
    from manifold3d import CrossSection

    turned = inner.rotate(-angle)
    x0, y0, x1, y1 = turned.bounds()
    islands = task.process.hatch_blocks == "islands"
    shift = size / 2 * (task.layer % 2)  # joints between blocks do not lie upon each other
    found = []
    for column, x in enumerate(np.arange(x0 - shift, x1, size)):
        for row, y in enumerate(np.arange(y0 - shift, y1, size) if islands else [y0]):
            tall = size if islands else y1 - y0
            block = turned ^ CrossSection.square((size, tall)).translate((x, y))
            across = islands and (column + row) % 2 == 1
            # lines of a stripe run across it, so that each is as long as the stripe is wide
            found.append((block.rotate(angle), angle + (90.0 if across else 0.0)))
    return [(block, at) for block, at in found if not block.is_empty()]


def _on_islands(tracks: list[LinkableTrack], task: SliceTask) -> list[LinkableTrack]:
    middles: FloatArray = np.array(
        [track.table[len(track.table) // 2, :2] for track in tracks]).reshape(-1, 2)
    island = np.maximum(task.islands.island_at(middles, task.raster), 0)
    return [replace(track, island=int(owner)) for track, owner in zip(tracks, island, strict=True)]
