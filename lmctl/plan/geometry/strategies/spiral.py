"""Spiral tracks: one continuous track around each ring or disc of a slice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.geometry.in_plane import LEAST_STRIP, WIDEST_STRIP
from lmctl.plan.geometry.planar_region import loops_of, pieces_of, region_of
from lmctl.plan.geometry.strategies.offset import offset_tracks
from lmctl.plan.geometry.strategies.slice_task import GOLDEN_ANGLE, SliceTask, StrategyTracks
from lmctl.plan.geometry.toolpath import Toolpath

if TYPE_CHECKING:
    from manifold3d import CrossSection

#: Rays on which an outline is looked up.
_RAYS = 720
#: A spiral has at least so many turns; what is narrower gets offset tracks.
_LEAST_TURNS = 2
#: Within this of a ray's direction an outline runs along it, and is no ring around the centre.
_LEAST_SINE = 0.35
#: The first turn begins with this part of a strip and widens by one; the last one narrows from a
#: strip to this part of it.
_THIN, _LAST = 0.55, 0.4


@dataclass(frozen=True)
class _Ring:
    """Radii of the outer and inner outline around a centre, by angle, (_RAYS,) each [mm]."""

    centre: FloatArray
    outer: FloatArray
    inner: FloatArray


def spiral_tracks(task: SliceTask) -> StrategyTracks:
    """A spiral around each piece of a slice that is a ring or a disc; offset tracks elsewhere."""
    found, narrow_mm2 = [], 0.0
    for piece in pieces_of(region_of(task.loops)):
        own = replace(task, loops=loops_of(piece))
        ring = _ring(piece)
        track = None if ring is None else _spiral(ring, task)
        if track is None:
            rest = offset_tracks(own)
            found += rest.tracks
            narrow_mm2 += rest.narrow_mm2
        else:
            found += own.with_mixtures([track], np.zeros(1, np.intp))
    middles = np.array([track.table[0, :2] for track in found]).reshape(-1, 2)
    island = np.maximum(task.islands.island_at(middles, task.raster), 0)
    return StrategyTracks(
        [replace(track, island=int(owner)) for track, owner in zip(found, island, strict=True)],
        narrow_mm2)


def _ring(piece: CrossSection) -> _Ring | None:
    """The outlines by angle; None where a ray meets one of them twice, or runs along it."""
    loops = loops_of(piece)
    if len(loops) > 2:
        return None
    loops.sort(key=lambda loop: -float(np.ptp(loop, axis=0).max()))
    hole = loops[1] if len(loops) == 2 else None
    centre = _middle(loops[0] if hole is None else hole)
    outer = _radii(loops[0], centre)
    inner = np.zeros(_RAYS) if hole is None else _radii(hole, centre)
    if outer is None or inner is None or (outer <= inner).any():
        return None
    return _Ring(centre, outer, inner)


def _middle(loop: FloatArray) -> FloatArray:
    """Centre of area of a loop, (2,)."""
    p, q = loop[:-1], loop[1:]
    cross = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    return np.asarray(((p + q) * cross[:, None]).sum(axis=0) / (3 * cross.sum()))


def _radii(loop: FloatArray, centre: FloatArray) -> FloatArray | None:
    """Distance of a loop from a centre on each ray; None where that is no function of the angle."""
    arm = loop - centre
    angle = np.unwrap(np.arctan2(arm[:, 1], arm[:, 0]))
    if angle[-1] < angle[0]:
        arm, angle = arm[::-1], angle[::-1]
    step = np.diff(arm, axis=0)
    length = np.hypot(*step.T)
    away = np.hypot(*arm[:-1].T)
    sine = (arm[:-1, 0] * step[:, 1] - arm[:-1, 1] * step[:, 0]) / np.maximum(away * length, 1e-12)
    if abs(angle[-1] - angle[0] - 2 * np.pi) > 1e-6 or sine[length > 1e-9].min() < _LEAST_SINE:
        return None
    wanted = 2 * np.pi * np.arange(_RAYS) / _RAYS
    at = angle[0] + (wanted - angle[0]) % (2 * np.pi)
    k = np.clip(np.searchsorted(angle, at, side="right") - 1, 0, len(step) - 1)
    ray = np.column_stack([np.cos(at), np.sin(at)])
    # on the edge: arm + t·step, along the ray: cross products vanish
    across = ray[:, 0] * step[k, 1] - ray[:, 1] * step[k, 0]
    return np.asarray((arm[k, 0] * step[k, 1] - arm[k, 1] * step[k, 0]) / across)


def _spiral(ring: _Ring, task: SliceTask) -> Toolpath | None:
    """One track from the outer outline in; None where a strip would be too thin or too wide.

    Edges of strips are one line that winds inwards, turn by turn: what one turn leaves the next one
    begins with. So the strips of all turns are the whole ring.
    """
    width = ring.outer - ring.inner
    turns = round(float(width.mean()) / task.pitch_mm)
    if turns < _LEAST_TURNS:
        return None
    turn = np.arange(0.0, turns - _THIN + 1 - _LAST, 1 / _RAYS)
    inner_edge = np.minimum(turn + _THIN, turns)
    outer_edge = np.where(turn < 1, 0.0, turn + _THIN - 1)
    share = (outer_edge + inner_edge) / 2 / turns
    first = int(task.layer * GOLDEN_ANGLE / (2 * np.pi) * _RAYS)
    ray = (np.arange(len(turn)) + first) % _RAYS
    radius = ring.outer[ray] - share * width[ray]
    angle = 2 * np.pi * ray / _RAYS
    points = ring.centre + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    slope = np.abs(_slope(ring.outer)[ray] - share * _slope(width)[ray])
    strip = (inner_edge - outer_edge) / turns * width[ray] * radius / np.hypot(radius, slope)
    full = (turn >= 1) & (turn <= turns - _THIN)
    limits = LEAST_STRIP * task.pitch_mm, WIDEST_STRIP * task.pitch_mm
    if strip[full].min() < limits[0] or strip[full].max() > limits[1]:
        return None
    return Toolpath(points, np.minimum(strip, limits[1]), False)


def _slope(radius: FloatArray) -> FloatArray:
    """Change of a radius by angle, (_RAYS,) [mm per radian]; at a corner that of one side."""
    ahead = (np.roll(radius, -1) - radius) * _RAYS / (2 * np.pi)
    behind = np.roll(ahead, 1)
    return np.where(np.abs(ahead) > np.abs(behind), ahead, behind)
