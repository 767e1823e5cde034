"""The geometry stage: section, tracks, composition and figures of one layer.

A function of the part, where its layers are cut, and the layer's number; of nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.config.part_file import ProcessSettings
from lmctl.plan.geometry.deposit import deposit_on
from lmctl.plan.geometry.in_plane import InPlaneLayout, in_plane_layout
from lmctl.plan.geometry.intended_slice import intended_loops, pitch_mm
from lmctl.plan.geometry.islands import Islands, islands_of
from lmctl.plan.geometry.iso_3d import iso_3d_tracks
from lmctl.plan.geometry.layer_geometry import LayerFigures, LayerGeometry, OverhangPlace
from lmctl.plan.geometry.losses import losses, lost_layer
from lmctl.plan.geometry.overhang import overhang_places
from lmctl.plan.geometry.section_raster import SectionRaster, raster_pitch_mm, section_raster
from lmctl.plan.geometry.toolpath import Toolpath
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

FloatArray = NDArray[np.float64]

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
    loops = intended_loops(section.loops, process)
    number = placement.skipped + layer
    if not loops:
        return _geometry(part, number, z_mm, [], np.empty(0, np.intp), [],
                         LayerFigures(0.0, 0.0, 0.0, 0.0, 0.0))
    node_mm = raster_pitch_mm(process.bead_width_mm, pitch_mm(process))
    raster = section_raster(loops, node_mm)
    islands = islands_of(loops, raster)
    tracks, owner, narrow_mm2 = _tracks(part, z_mm, raster, islands)
    below = intended_loops(part.section(placement.cut_mm(layer - 1)).loops, process) if (
        number > 0) else None
    overhang = () if below is None else overhang_places(
        loops, below, raster, islands, placement.layer_height_mm, process.bead_width_mm,
        process.max_overhang_deg)
    figures = _figures(loops, raster, islands, tracks, owner, narrow_mm2, overhang, process)
    return _geometry(part, number, z_mm, tracks, owner, loops, figures)


def _tracks(
    part: Part, z_mm: float, raster: SectionRaster, islands: Islands
) -> tuple[list[Toolpath], NDArray[np.intp], float]:
    """Tracks of a slice, the island of each, and the area of those in narrow places [mm²]."""
    process = part.process
    bead = process.bead_width_mm
    narrow_mm2 = 0.0
    if process.strategy == "in-plane":
        least = bead if process.narrow_features == "omit" else bead / 2
        layout = in_plane_layout(raster, islands, bead, pitch_mm(process), least)
        tracks, owner = layout.tracks, layout.island
        narrow_mm2 = _narrow_area_mm2(layout, bead)
    else:
        tracks = iso_3d_tracks(part.section(z_mm), bead, pitch_mm(process))
        middles = np.array([track.points_mm[0] for track in tracks]).reshape(-1, 2)
        owner = islands.at(middles, raster)
    movable = [np.ptp(track.points_mm, axis=0).max() >= _LEAST_EXTENT_MM for track in tracks]
    return ([track for track, moves in zip(tracks, movable, strict=True) if moves],
            np.maximum(owner[np.array(movable, dtype=np.bool_)], 0), narrow_mm2)


def _narrow_area_mm2(layout: InPlaneLayout, bead_mm: float) -> float:
    """Strips of single tracks where the material is narrower than a bead [mm²]."""
    single = layout.beads.has_centreline & (layout.beads.count == 1)
    narrow = single & (2 * layout.axis.depth_mm < bead_mm * (1 - 1e-6))
    links = layout.axis.links[narrow[layout.axis.links].all(axis=1)]
    length = np.linalg.norm(np.diff(layout.axis.points_mm[links], axis=1)[:, 0], axis=1)
    return float((length * 2 * layout.axis.depth_mm[links].mean(axis=1)).sum())


def _figures(
    loops: list[FloatArray], raster: SectionRaster, islands: Islands, tracks: list[Toolpath],
    owner: NDArray[np.intp], narrow_mm2: float, overhang: tuple[OverhangPlace, ...],
    process: ProcessSettings,
) -> LayerFigures:
    slice_mm2 = float(islands.area_mm2.sum())
    if not tracks:
        return LayerFigures(slice_mm2, 0.0, 0.0, 0.0, 0.0, overhang=overhang,
                            lost=(lost_layer(loops, islands, process),))
    points, starts, strip = _flat(tracks)
    deposit = deposit_on(raster, points, starts, strip, process.bead_width_mm)
    return LayerFigures(
        slice_mm2=slice_mm2, inside_mm2=deposit.inside() * slice_mm2,
        double_mm2=deposit.double() * slice_mm2, outside_mm2=deposit.outside() * slice_mm2,
        strip_mm2=sum((track.strip_area_mm2() for track in tracks), 0.0), narrow_mm2=narrow_mm2,
        lost=losses(loops, islands, owner, points, deposit, raster, process), overhang=overhang)


def _flat(tracks: list[Toolpath]) -> tuple[FloatArray, NDArray[np.intp], FloatArray]:
    """Points, starts and strip widths of all tracks, one after the other."""
    points = np.vstack([np.empty((0, 2)), *(track.points_mm for track in tracks)])
    starts = np.cumsum([0, *(len(track.points_mm) for track in tracks)])
    strip = np.concatenate([np.empty(0), *(track.strip_width_mm for track in tracks)])
    return points, starts, strip


def _geometry(
    part: Part, layer: int, z_mm: float, tracks: list[Toolpath], owner: NDArray[np.intp],
    loops: list[FloatArray], figures: LayerFigures,
) -> LayerGeometry:
    points, starts, strip = _flat(tracks)
    fractions = part.composition(np.column_stack([points, np.full(len(points), z_mm)]))
    return LayerGeometry(
        layer=layer, z_mm=z_mm, points_mm=points, starts=starts, strip_width_mm=strip,
        fractions=fractions,
        is_closed=np.array([track.is_closed for track in tracks], dtype=np.bool_), island=owner,
        outline_mm=np.vstack([np.empty((0, 2)), *loops]),
        outline_starts=np.cumsum([0, *(len(loop) for loop in loops)]), figures=figures)
