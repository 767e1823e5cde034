"""Find the pieces of a slice that its tracks leave out: place, size, reason, remedy.

Islands are judged by their own outlines, and ribs by how far their outline lies from the tracks, so
that nothing is too thin to be found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray, IntArray
from lmctl.config.part_file import ProcessSettings
from lmctl.field.plane import loop_area_mm2
from lmctl.plan.geometry.deposit import Deposit
from lmctl.plan.geometry.islands import Islands
from lmctl.plan.geometry.layer_geometry import LostFeature, LostKind
from lmctl.plan.geometry.raster_pieces import connected_pieces, nodes_of_pieces
from lmctl.plan.geometry.section_raster import SectionRaster
from lmctl.plan.geometry.track_reach import reaches_missed
from lmctl.plan.polyline import densified_polyline

#: Smaller pieces are crumbs of the geometry, not features: a square of this part of a bead.
_CRUMB_BEADS = 0.02
#: An outline is covered where a track lies within the first of these, sharp corners included; a rib
#: is lost where its outline lies farther away than the second [beads].
_REACHES_BEADS = 0.9, 1.3
#: A place within the tracks is empty where less than this part of a tile is filled.
_EMPTY = 0.5


def lost_features(
    loops: Sequence[FloatArray], islands: Islands, owner: NDArray[np.intp],
    points_mm: FloatArray, deposit: Deposit | None, raster: SectionRaster, process: ProcessSettings,
) -> tuple[LostFeature, ...]:
    """Pieces of a slice that no track covers, the largest first.

    loops : of the intended slice; owner : the island of each track; points_mm : of all tracks
    deposit : of the tracks; None where there are none
    """
    bead = process.bead_width_mm
    found = []
    has_tracks = np.zeros(len(islands), dtype=np.bool_)
    has_tracks[owner[owner >= 0]] = True
    for number in np.flatnonzero(~has_tracks):
        area = float(islands.area_mm2[number])
        if area >= (_CRUMB_BEADS * bead) ** 2:
            found.append(_lost("island", islands.outer[number], area, process))
    if len(points_mm):
        fine = [densified_polyline(loop, raster.grid.pitch_mm)[:-1] for loop in loops]
        missed = reaches_missed(np.vstack(fine), points_mm, bead * np.array(_REACHES_BEADS))
        ends = np.cumsum([len(outline) for outline in fine])[:-1]
        for outline, along in zip(fine, np.split(missed, ends), strict=True):
            found += _uncovered_stretches(outline, along, process)
    if deposit is not None:
        found += _empty_places(deposit, raster, process)
    return tuple(sorted(found, key=lambda lost: -lost.area_mm2))


def lost_slice_features(
    loops: Sequence[FloatArray], islands: Islands, process: ProcessSettings
) -> tuple[LostFeature, ...]:
    """A whole slice without a track, by its islands, the largest first.

    loops : of the slice, one at least
    """
    large = np.flatnonzero(islands.area_mm2 >= (_CRUMB_BEADS * process.bead_width_mm) ** 2)
    if len(large) == 0:  # crumbs alone are one piece
        return (_lost("layer", np.vstack(loops), float(islands.area_mm2.sum()), process),)
    found = [_lost("layer", islands.outer[number], float(islands.area_mm2[number]), process)
             for number in large]
    return tuple(sorted(found, key=lambda lost: -lost.area_mm2))


def _uncovered_stretches(
    fine: FloatArray, missed: IntArray, process: ProcessSettings
) -> list[LostFeature]:
    """Ribs of an outline that no track comes near.

    fine : (k, 2) points along it [mm]; missed : (k,) how many of the reaches are too short there
    """
    bead = process.bead_width_mm
    far = missed > 0
    if not far.any() or far.all():  # far from all tracks: an island of its own, or its hole
        return []
    first = int(np.flatnonzero(~far)[0])
    fine = np.roll(fine, -first, axis=0)
    missed, far = np.roll(missed, -first), np.roll(far, -first)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], far.astype(np.int8), [0]])))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        piece = fine[begin:end]
        if missed[begin:end].max() < len(_REACHES_BEADS):
            continue
        area = abs(loop_area_mm2(np.vstack([piece, piece[:1]])))
        if area >= (_CRUMB_BEADS * bead) ** 2:
            found.append(_lost("rib", piece, area, process))
    return found


def _empty_places(
    deposit: Deposit, raster: SectionRaster, process: ProcessSettings
) -> list[LostFeature]:
    """Places among the tracks where less than half of a tile is filled."""
    deep = raster.depth_mm > process.bead_width_mm / 2
    empty = deep & (deposit.filled_fraction_by_cell < _EMPTY)
    label, peaks = connected_pieces(empty.astype(np.float32))
    found = []
    cell = raster.grid.pitch_mm**2
    for j, i in nodes_of_pieces(label, len(peaks)):
        if len(j) * cell >= (process.bead_width_mm / 2) ** 2:
            places = np.stack([raster.grid.x_mm[i], raster.grid.y_mm[j]], axis=1)
            found.append(_lost("void", places, len(j) * cell, process))
    return found


def lost_feature_of_outline(kind: LostKind, outline: FloatArray,
                            process: ProcessSettings) -> LostFeature:
    """A piece within an outline (k, 2) [mm], which need not be closed."""
    area = abs(loop_area_mm2(np.vstack([outline, outline[:1]])))
    return _lost(kind, outline, area, process)


def _lost(
    kind: LostKind, outline: FloatArray, area_mm2: float, process: ProcessSettings
) -> LostFeature:
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    length, width = _size_mm(outline, area_mm2)
    bead = process.bead_width_mm
    least = bead if process.narrow_features == "omit" else bead / 2
    if kind == "flat":
        why = f"it is flatter than a layer of {process.layer_height_mm:g} mm, and between two"
        remedy = "lower process.layer_height_mm, or build the part in another direction"
    elif kind == "void":
        why = "no track reaches it"
        remedy = "lower process.bead_width_mm"
    elif width >= least * 0.98:
        why = "no track fits into it"
        remedy = "lower process.bead_width_mm"
    elif process.narrow_features == "omit" and width >= bead / 2:
        why = f"it is narrower than a bead of {bead:g} mm, and process.narrow_features = \"omit\""
        remedy = 'set process.narrow_features = "deposit"'
    else:
        why = f"it is {width:.2g} mm wide, less than half a bead of {bead:g} mm"
        remedy = (f"lower process.bead_width_mm to {2 * width:.2g}, or build the part in another "
                  "direction")
    return LostFeature(
        kind=kind, at_mm=(float(middle[0]), float(middle[1])), size_mm=(length, width),
        area_mm2=area_mm2, reason=why, remedy=remedy)


def _size_mm(outline: FloatArray, area_mm2: float) -> tuple[float, float]:
    """Length and width: the longer side of the smaller box around it, and area over that.

    Boxes along its main direction and along x and y.
    """
    arms = outline - outline.mean(axis=0)
    turn = np.linalg.svd(arms, full_matrices=False)[2] if len(outline) > 1 else np.eye(2)
    boxes = np.ptp(arms @ turn.T, axis=0), np.ptp(arms, axis=0)
    length = float(max(min(boxes, key=np.prod).max(), np.sqrt(area_mm2)))
    return length, area_mm2 / length if length > 0 else 0.0
