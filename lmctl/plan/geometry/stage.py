"""The geometry stage: section, tracks, composition and figures of one layer.

A function of the part, where its layers are cut, and the layer's number; of nothing else.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from lmctl.plan.coverage import covered_area_mm2
from lmctl.plan.geometry.layer_geometry import FloatArray, LayerFigures, LayerGeometry
from lmctl.plan.tracks import Track, in_plane_tracks, iso_3d_tracks
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: A track of less extent may, on the program's raster, hold no motion that a controller can make.
_LEAST_EXTENT_MM = 0.042


def layer_geometry(part: Part, placement: Placement, layer: int) -> LayerGeometry:
    """The tracks of one layer and what they leave undone.

    layer : of `placement`, so that a placement without its lowest layers counts from the first
        that it keeps
    """
    process = part.process
    z_mm = placement.cut_mm(layer)
    section = part.section(z_mm)
    cut = in_plane_tracks if process.strategy == "in-plane" else iso_3d_tracks
    pitch_mm = process.bead_width_mm * (1 - process.overlap)
    tracks = [track for track in cut(section, process.bead_width_mm, pitch_mm)
              if np.ptp(track.points, axis=0).max() >= _LEAST_EXTENT_MM]
    points = np.vstack([np.empty((0, 2)), *(track.points for track in tracks)])
    starts = np.cumsum([0, *(len(track.points) for track in tracks)])
    fractions = part.composition(np.column_stack([points, np.full(len(points), z_mm)]))
    if process.strategy == "iso-3d":  # the paper: one composition a contour
        for first, last in pairwise(starts):
            fractions[first:last] = fractions[first:last].mean(axis=0)
    covered_mm2, slice_mm2 = covered_area_mm2(section, tracks, process.bead_width_mm)
    return LayerGeometry(
        layer=placement.skipped + layer, z_mm=z_mm, points_mm=points, starts=starts,
        strip_width_mm=np.concatenate([np.empty(0), *(track.share_mm for track in tracks)]),
        fractions=fractions,
        is_closed=np.array([track.closed for track in tracks], dtype=np.bool_),
        island=np.array([track.island for track in tracks], dtype=np.intp),
        outline_mm=np.vstack([np.empty((0, 2)), *section.loops]),
        outline_starts=np.cumsum([0, *(len(loop) for loop in section.loops)]),
        figures=LayerFigures(
            slice_mm2=slice_mm2, inside_mm2=covered_mm2, outside_mm2=0.0, double_mm2=0.0,
            strip_mm2=sum((_strip_mm2(track) for track in tracks), 0.0)))


def _strip_mm2(track: Track) -> float:
    length: FloatArray = np.linalg.norm(np.diff(track.points, axis=0), axis=1)
    return float(length @ (track.share_mm[1:] + track.share_mm[:-1]) / 2)
