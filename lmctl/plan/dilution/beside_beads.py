"""What beads melt of the beads beside them, in place of what lies below.

Beads overlap. Where one lies upon the side of another of its layer it melts that, not the layer
below, and it needs no more powder there than the part asks for. So the mixture to feed follows from
what a bead melts in all: where one lies beside two others that is less of the substrate than where
it lies alone, and its deposit would otherwise be too rich of what the substrate lacks.

How much of a bead lies upon others follows from pouring the layer's beads in their order, each a
parabola across its width, raised where less lies below than that needs (as in
`margins.poured_beads`). What it melts in a column is δ / (1 − δ) of what it adds there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel
from lmctl.plan.dilution.fed_mixtures import mixture_to_feed
from lmctl.plan.fill_level import fill_level
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.track_order import OrderedTracks

#: Cells across a bead, where the layer's extent allows: memory.
_CELLS_PER_BEAD = 16
_MOST_CELLS = 4_000_000
#: Most points across a bead, and strips of a bead in a cell.
_MOST_ACROSS, _STRIPS_PER_CELL = 32, 1
#: Where what lies below differs from the part by no more than this, times δ, all is as well.
_LEAST_FRACTION = 0.004
#: All of a bead gives way to what it melts of its neighbours by no more than this volume fraction,
#: a third of the tolerance of a volume: more would put right its sides, where it is too rich, at
#: the price of its middle.
_MOST_GIVEN = 0.01
#: A bead does not lie upon itself: what it meets is what was there before it came by, until it has
#: gone on by so many bead widths.
_PASS_WIDTHS = 0.5


def fed_beside_beads(tracks: OrderedTracks, recipe: Recipe) -> OrderedTracks:
    """Tracks whose dilution is compensated, with what they melt of each other taken into account.

    The others, and those over a layer as good as their own, come back as they are.
    """
    melted = tracks.melted
    if melted is None or tracks.n_tracks == 0:
        return tracks
    apart = np.abs(melted.designed - melted.below).max(axis=1) * melted.share
    if apart.max(initial=0.0) <= _LEAST_FRACTION:
        return tracks
    share = share_upon_beads(
        tracks, melted.share, recipe.bead_mm, recipe.pitch_mm, recipe.layer_height_mm)[:, None]
    change = share * (melted.designed - melted.below)
    off = np.abs(change).max(axis=1) * melted.share
    change *= np.minimum(1.0, _MOST_GIVEN / np.maximum(off, 1e-12))[:, None]
    below = melted.below + change
    fed = mixture_to_feed(melted.designed, below, melted.share)
    return replace(tracks, fractions=fed, melted=replace(melted, below=below))


def share_upon_beads(
    tracks: OrderedTracks, dilution: FloatArray, bead_mm: float, pitch_mm: float,
    layer_height_mm: float,
) -> FloatArray:
    """What share of what a bead melts belongs to other beads of its layer, (n,) at its vertices.

    dilution : (n,) δ
    """
    low = tracks.points_mm.min(axis=0) - 2.0 * bead_mm
    size = tracks.points_mm.max(axis=0) + 2.0 * bead_mm - low
    cell_mm = max(bead_mm / _CELLS_PER_BEAD, float(size.prod() / _MOST_CELLS) ** 0.5)
    rows, columns = (int(n) + 1 for n in np.ceil(size / cell_mm))
    width = tracks.strip_width_mm * (bead_mm / pitch_mm)
    return np.asarray(_share_upon(
        np.ascontiguousarray(tracks.points_mm - low), tracks.starts, width,
        tracks.strip_width_mm * layer_height_mm, dilution / (1.0 - dilution), cell_mm, rows,
        columns))


@kernel
def _share_upon(
    points: FloatArray, starts: IndexArray, width: FloatArray, section_mm2: FloatArray,
    ratio: FloatArray, cell: float, rows: int, columns: int,
) -> FloatArray:
    """Of each vertex: over the segments beside it, what is melted of beads over all that is melted.
    """
    top, base = np.zeros(rows * columns), np.zeros(rows * columns)
    seen = np.full(rows * columns, -1e300)
    need, at = np.empty(_MOST_ACROSS), np.empty(_MOST_ACROSS, np.int64)
    upon, total = np.zeros(len(points)), np.zeros(len(points))
    way = 0.0
    for track in range(len(starts) - 1):
        way += 1e6
        for v in range(starts[track] + 1, starts[track + 1]):
            dx, dy = points[v, 0] - points[v - 1, 0], points[v, 1] - points[v - 1, 1]
            length = np.sqrt(dx * dx + dy * dy)
            if length <= 0.0:
                continue
            wide = 0.5 * (width[v] + width[v - 1])
            section = 0.5 * (section_mm2[v] + section_mm2[v - 1])
            melts = 0.5 * (ratio[v] + ratio[v - 1])
            across = min(_MOST_ACROSS, max(4, int(np.ceil(_STRIPS_PER_CELL * wide / cell))))
            steps = max(1, int(np.ceil(_STRIPS_PER_CELL * length / cell)))
            patch = wide / across * length / steps
            rise = section / wide
            for s in range(steps):
                way += length / steps
                x = points[v - 1, 0] + (s + 0.5) / steps * dx
                y = points[v - 1, 1] + (s + 0.5) / steps * dy
                for j in range(across):
                    u = 2.0 * (j + 0.5) / across - 1.0
                    beside = 0.5 * u * wide
                    k = int((x - beside * dy / length) / cell) * columns + int(
                        (y + beside * dx / length) / cell)
                    at[j] = k
                    if way - seen[k] > _PASS_WIDTHS * wide:
                        base[k] = top[k]
                    seen[k] = way
                    need[j] = base[k] - 1.5 * rise * (1.0 - u * u)
                level = fill_level(need, across, section * length / steps / patch)
                for j in range(across):
                    gained = level - need[j]
                    if gained <= 0.0:
                        continue
                    k = at[j]
                    top[k] += gained * patch / (cell * cell)
                    deep = gained * melts
                    for end in (v - 1, v):
                        upon[end] += min(deep, base[k]) * patch
                        total[end] += deep * patch
    for v in range(len(points)):
        if total[v] > 0.0:
            upon[v] /= total[v]
    return upon
