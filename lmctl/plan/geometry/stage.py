"""The geometry stage: section, tracks, composition and figures of one layer.

A function of the part, where its layers are cut, and the layer's number; of nothing else.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.part_file import ProcessSettings, RegionStrategy
from lmctl.plan.geometry.alternate_tracks import alternate_tracks, lies_on_other_alloy
from lmctl.plan.geometry.beside_tracks import fractions_across
from lmctl.plan.geometry.between_layers import flat_pieces
from lmctl.plan.geometry.deposit import Deposit, deposit_on
from lmctl.plan.geometry.intended_slice import intended_loops
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.layer_geometry import (
    IslandFigures,
    LayerFigures,
    LayerGeometry,
    OverhangPlace,
)
from lmctl.plan.geometry.link_lines import LinkableTrack
from lmctl.plan.geometry.losses import lost_features, lost_slice_features
from lmctl.plan.geometry.overhang import overhang_places
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.strategies import SliceTask, tracks_of_slice
from lmctl.plan.substrate_mixture import substrate_mixture
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part, PartSection
    from lmctl.part.substrate import LayerStack


def layer_geometry(part: Part, placement: Placement, layer: int) -> LayerGeometry:
    """The tracks of one layer and what they leave unfilled.

    layer : of `placement`, so that a placement without its lowest layers counts from the first
        that it keeps
    """
    process = part.process
    z_mm = placement.cut_height_mm(layer)
    section = part.section(z_mm)
    loops = intended_loops(section.loops, process)
    number = placement.skipped + layer
    if not loops:
        return _geometry(number, z_mm, [], len(part.materials), [], LayerFigures(
            0.0, 0.0, 0.0, 0.0, 0.0, lost=tuple(flat_pieces(part, placement, layer, loops))))
    task = _slice_task(part, section, loops, number)
    raster, islands = task.raster, task.islands
    on_other_alloy = False
    substrate = substrate_mixture(part) if number == 0 and process.dilution != "ignore" and (
        process.first_layer_order == "every-other") else None
    if substrate is not None:
        found = tracks_of_slice(replace(task, links=False))
        on_other_alloy = any(
            lies_on_other_alloy(line.table[:, 3:], substrate) for line in found.tracks)
    if not on_other_alloy:
        found = tracks_of_slice(task)
    lines = found.tracks
    below = intended_loops(part.section(placement.cut_height_mm(layer - 1)).loops, process) if (
        number > 0) else None
    overhang = () if below is None else overhang_places(
        loops, below, raster, islands, placement.layer_height_mm, process.bead_width_mm,
        process.max_overhang_deg)
    figures = _figures(loops, raster, islands, lines, found.narrow_mm2, overhang, process)
    flat = flat_pieces(part, placement, layer, loops)
    if flat:
        figures = replace(figures, lost=(*figures.lost, *flat))
    made = _geometry(number, z_mm, lines, len(part.materials), loops, figures)
    if on_other_alloy:
        made = alternate_tracks(made, process.bead_width_mm, task.pitch_mm)
    if part.layer_stack is not None and made.n_tracks:
        made = _with_thickness(made, part.layer_stack)
    if part.alloy_rules is not None:
        made = _under_alloy_rules(part, made)
    if process.dilution == "ignore" or not lines:
        return made
    if part.alloy_rules is None:
        made = replace(made, fractions_across=fractions_across(
            made, process.bead_width_mm, part.composition))
    if number == 0:
        return made
    points = made.points_mm
    below_mm = np.full(len(points), placement.cut_height_mm(layer - 1))
    return replace(made, fractions_below=part.composition(np.column_stack([points, below_mm])))


def _with_thickness(made: LayerGeometry, stack: LayerStack) -> LayerGeometry:
    """A layer over a substrate: where it is thicker than the layer height, strips take more."""
    stretched = made.strip_width_mm * stack.stretch(made.points_mm, made.z_mm)
    factor = float(stretched.sum() / made.strip_width_mm.sum())
    return replace(made, strip_width_mm=stretched, figures=made.figures.scaled(factor))


def _under_alloy_rules(part: Part, geometry: LayerGeometry) -> LayerGeometry:
    """A layer with mixtures that may be laid at every vertex, and the part file's own beside them.

    Strategies may interpolate the material field, so that rules are applied once more.
    """
    mixtures = part.laid_mixtures
    if mixtures is None or geometry.n_tracks == 0:
        return geometry
    points = np.column_stack([
        geometry.points_mm, np.full(len(geometry.points_mm), geometry.z_mm)])
    return replace(geometry, fractions=mixtures.laid(geometry.fractions)[0],
                   designed=part.designed_composition(points))


def _slice_task(
    part: Part, section: PartSection, loops: list[FloatArray], layer: int
) -> SliceTask:
    """A slice with the strategies that hold in this layer, everywhere or within bodies."""
    process = part.process
    bodies: list[tuple[list[FloatArray], RegionStrategy]] = []
    for region in process.region:
        if not region.holds_in(layer):
            continue
        if region.body is None:
            process, bodies = process.model_copy(update={"strategy": region.strategy}), []
        else:
            outline = part.strategy_bodies[region.body].outline_loops(section.z_mm, part.plane)
            bodies.insert(0, (outline, region.strategy))
    z_mm = section.z_mm
    return SliceTask(
        section, loops, process, layer, lambda points: part.composition(
            np.column_stack([points, np.full(len(points), z_mm)])),
        tuple((outline, strategy) for outline, strategy in bodies if outline))


def _figures(
    loops: list[FloatArray], raster: SectionRaster, islands: Islands, lines: list[LinkableTrack],
    narrow_mm2: float, overhang: tuple[OverhangPlace, ...], process: ProcessSettings,
) -> LayerFigures:
    slice_mm2 = float(islands.area_mm2.sum())
    if not lines:
        return LayerFigures(slice_mm2, 0.0, 0.0, 0.0, 0.0, overhang=overhang,
                            lost=lost_slice_features(loops, islands, process))
    table, starts = _flat(lines)
    points, strip = table[:, :2], table[:, 2]
    deposit = deposit_on(raster, points, starts, strip, process.bead_width_mm)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1) * (strip[1:] + strip[:-1]) / 2
    step[starts[1:-1] - 1] = 0.0  # from one track to the next nothing is deposited
    owner = np.array([line.island for line in lines], dtype=np.intp)
    return LayerFigures(
        slice_mm2=slice_mm2, inside_mm2=deposit.filled_slice_fraction() * slice_mm2,
        double_mm2=deposit.double_slice_fraction() * slice_mm2,
        outside_mm2=deposit.outside_slice_fraction() * slice_mm2,
        strip_mm2=float(step.sum()), narrow_mm2=narrow_mm2,
        islands=_islands(islands, owner, deposit),
        lost=lost_features(loops, islands, owner, points, deposit, raster, process),
        overhang=overhang)


def _islands(
    islands: Islands, owner: NDArray[np.intp], deposit: Deposit
) -> tuple[IslandFigures, ...]:
    inside = deposit.filled_fraction_of_pieces(islands.label, len(islands))
    found = []
    for number in np.unique(owner):
        outer, area = islands.outer[number], float(islands.area_mm2[number])
        middle = (outer.min(axis=0) + outer.max(axis=0)) / 2
        found.append(IslandFigures(
            (float(middle[0]), float(middle[1])), area, area * float(inside[number])))
    return tuple(found)


def _flat(lines: list[LinkableTrack]) -> tuple[FloatArray, NDArray[np.intp]]:
    """Tables of all lines one after the other, and where each begins."""
    return (np.vstack([line.table for line in lines]),
            np.cumsum([0, *(len(line.table) for line in lines)]))


def _geometry(
    layer: int, z_mm: float, lines: list[LinkableTrack], materials: int, loops: list[FloatArray],
    figures: LayerFigures,
) -> LayerGeometry:
    table, starts = _flat(lines) if lines else (np.empty((0, 3 + materials)), np.zeros(1, np.intp))
    return LayerGeometry(
        layer=layer, z_mm=z_mm, points_mm=np.ascontiguousarray(table[:, :2]), starts=starts,
        strip_width_mm=table[:, 2].copy(), fractions=np.ascontiguousarray(table[:, 3:]),
        is_closed=np.array([line.is_closed for line in lines], dtype=np.bool_),
        island=np.array([line.island for line in lines], dtype=np.intp),
        outline_mm=np.vstack([np.empty((0, 2)), *loops]),
        outline_starts=np.cumsum([0, *(len(loop) for loop in loops)]), figures=figures,
        is_directed=np.array([line.is_directed for line in lines], dtype=np.bool_))
