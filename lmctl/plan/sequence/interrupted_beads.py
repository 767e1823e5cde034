"""Interrupt beads: a path ends at a vertex, and another goes on from there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.plan.sequence.beads import Beads

#: Lengths nearer to each other than this are one vertex [mm].
_SAME_MM = 1e-6


@dataclass(frozen=True)
class HeatWaits:
    """Waits of one layer with the beam off.

    before_s : (m,) before each of its beads
    cut_along_mm : (c,) rising, places on the layer's tracks (`Beads.along_mm`) where a bead is
        interrupted; cut_s : (c,) the wait there
    """

    before_s: FloatArray
    cut_along_mm: FloatArray
    cut_s: FloatArray

    @property
    def total_s(self) -> float:
        """All of them."""
        return float(self.before_s.sum() + self.cut_s.sum())


def beads_with_waits(
    beads: Beads, waits_s: FloatArray, more: HeatWaits
) -> tuple[Beads, FloatArray]:
    """Beads interrupted where waits say so, and the wait before each of them, (m + c,).

    waits_s : (m,) those they have already
    """
    before_s = waits_s + more.before_s
    if len(more.cut_s) == 0:
        return beads, before_s
    beads = with_vertices(beads, more.cut_along_mm)
    vertices = np.searchsorted(beads.along_mm, more.cut_along_mm - _SAME_MM)
    order = np.argsort(np.concatenate([beads.first, vertices]), kind="stable")
    return split_beads(beads, vertices), np.concatenate([before_s, more.cut_s])[order]


def with_vertices(beads: Beads, along_mm: FloatArray) -> Beads:
    """The same beads with vertices at places within them (c,), rising, that have none there."""
    before = np.searchsorted(beads.along_mm, along_mm - _SAME_MM)
    new_mm = along_mm[beads.along_mm[before] - along_mm > _SAME_MM]
    if len(new_mm) == 0:
        return beads
    at = np.searchsorted(beads.along_mm, new_mm)

    def between(columns: FloatArray) -> FloatArray:
        values = np.column_stack([np.interp(new_mm, beads.along_mm, one) for one in columns.T])
        return np.insert(columns, at, values, axis=0)

    def of_segment(column: FloatArray) -> FloatArray:
        return np.insert(column, at, column[at])

    return replace(
        beads, points_mm=between(beads.points_mm), fractions=between(beads.fractions),
        along_mm=np.insert(beads.along_mm, at, new_mm),
        starts=beads.starts + np.searchsorted(at, beads.starts, side="left"),
        speed_mm_s=of_segment(beads.speed_mm_s), power_W=of_segment(beads.power_W),
        width_mm=of_segment(beads.width_mm))


def split_beads(beads: Beads, vertices: IndexArray) -> Beads:
    """The same beads, each interrupted at those of the inner vertices (c,), rising, that it has."""
    repeats = np.ones(len(beads.points_mm), np.intp)
    repeats[vertices] = 2
    index = np.repeat(np.arange(len(repeats)), repeats)
    moved = np.cumsum(repeats) - repeats  # where each vertex stands now, or its first copy
    starts = np.concatenate([moved[beads.first], moved[vertices] + 1, [len(index)]])
    piece_of = np.searchsorted(beads.starts, vertices, side="right") - 1
    factor = np.concatenate([beads.speed_factor, beads.speed_factor[piece_of]])
    order = np.argsort(starts[:-1], kind="stable")
    return replace(
        beads, points_mm=beads.points_mm[index], fractions=beads.fractions[index],
        along_mm=beads.along_mm[index], starts=np.sort(starts).astype(np.intp),
        speed_mm_s=beads.speed_mm_s[index], power_W=beads.power_W[index],
        width_mm=beads.width_mm[index], speed_factor=factor[order])


def waits_of_pieces(
    waits_s: FloatArray | None, whole: Beads, pieces: Beads
) -> FloatArray | None:
    """Waits before beads, (m,), for their pieces: before a bead's first piece, and no others."""
    if waits_s is None or pieces.count == whole.count:
        return waits_s
    begins_mm = pieces.along_mm[pieces.first]
    bead = np.searchsorted(whole.along_mm[whole.first], begins_mm + _SAME_MM) - 1
    is_first = begins_mm - whole.along_mm[whole.first][bead] < _SAME_MM
    return np.asarray(np.where(is_first, waits_s[bead], 0.0))
