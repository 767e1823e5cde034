"""A layer's beads poured in their order over columns that remember what lies on top.

Each bead is a parabola across its width, raised where less lies below than that needs (as in
`margins.poured_beads`). What it melts in a column is δ / (1 − δ) of what it adds there: first of
the beads of its own layer, if it lies upon them, then of what lies below. A pass over a column
mixes evenly with what it melts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import inner_kernel, kernel
from lmctl.plan.fill_level import fill_level

#: Cells across a bead, where the layer's extent allows: memory.
_CELLS_PER_BEAD = 16
_MOST_CELLS = 1_000_000
#: Most strips across a bead.
_MOST_ACROSS = 32
#: A bead does not lie upon itself: what it meets is what was there before it came by, until it has
#: gone on by so many bead widths.
_PASS_WIDTHS = 0.5
#: Tolerance of a volume, as a share of volume fraction, that the most of a bead is to be within.
_TOLERANCE_FRACTION = 0.03
#: The most of a bead is sought within so many tolerances, in so many turns each.
_WIDENINGS, _TURNS = np.array([4.0, 2.0, 1.3, 1.0]), 4


@dataclass(frozen=True)
class LaidColumns:
    """What lies on top after a layer, on a grid of square columns.

    low_mm : (2,) corner of the grid; shape : columns along x and y
    mixture : (columns, materials + 1), NaN where nothing is known
    """

    low_mm: FloatArray
    cell_mm: float
    shape: tuple[int, int]
    mixture: FloatArray

    def at_grid(self, low_mm: FloatArray, cell_mm: float, shape: tuple[int, int]) -> FloatArray:
        """The mixture in the columns of another grid, (columns, materials + 1)."""
        own = [np.floor((low_mm[axis] + (np.arange(shape[axis]) + 0.5) * cell_mm
                         - self.low_mm[axis]) / self.cell_mm).astype(np.intp) for axis in (0, 1)]
        row, column = np.meshgrid(*own, indexing="ij")
        inside = ((row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1]))
        found = np.full((shape[0] * shape[1], self.mixture.shape[1]), np.nan)
        found[inside.reshape(-1)] = self.mixture[(row * self.shape[1] + column)[inside]]
        return found


@dataclass(frozen=True)
class PouredLayer:
    """fed : (n, materials) that put the most of each bead within the tolerance, at its vertices
    even : (n, materials) that make up for what a bead melts in the mean; melted : that
    laid : what then lies on top
    """

    fed: FloatArray
    even: FloatArray
    melted: FloatArray
    laid: LaidColumns


def pour(
    points_mm: FloatArray, starts: IndexArray, bead_mm: float, section_mm2: FloatArray,
    dilution: FloatArray, below: FloatArray, fed: FloatArray, designed_across: FloatArray | None,
    before: LaidColumns | None,
) -> PouredLayer:
    """Pour beads along polylines, one after the other.

    points_mm : (n, 2); starts : (m + 1,); section_mm2 : (n,) of the beads; dilution : (n,) δ
    below : (n, materials + 1), what lies below where `before` does not say
    fed : (n, materials); designed_across : (n, places, materials) the part's composition across
        each bead: then mixtures are sought, and `fed` counts where a bead adds nothing
    """
    low = points_mm.min(axis=0) - 2.0 * bead_mm
    size = points_mm.max(axis=0) + 2.0 * bead_mm - low
    cell_mm = max(bead_mm / _CELLS_PER_BEAD, float(size.prod() / _MOST_CELLS) ** 0.5)
    shape = (int(np.ceil(size[0] / cell_mm)) + 1, int(np.ceil(size[1] / cell_mm)) + 1)
    columns, kinds = shape[0] * shape[1], below.shape[1]
    under = np.full((columns, kinds), np.nan) if before is None else before.at_grid(
        low, cell_mm, shape)
    mixture = np.full((columns, kinds), np.nan)
    across = np.empty((0, 0, 0)) if designed_across is None else designed_across
    found, even, melted = fed.copy(), fed.copy(), below.copy()
    _pour(
        np.ascontiguousarray(points_mm - low), starts, bead_mm, section_mm2,
        dilution / (1.0 - dilution), np.ascontiguousarray(below), np.ascontiguousarray(fed),
        np.ascontiguousarray(across), cell_mm, shape[1], under, mixture, found, even, melted)
    return PouredLayer(found, even, melted, LaidColumns(low, cell_mm, shape, mixture))


@kernel
def _pour(
    points: FloatArray, starts: IndexArray, wide: float, section_mm2: FloatArray,
    ratio: FloatArray, below: FloatArray, fed: FloatArray, across: FloatArray, cell: float,
    columns: int, under: FloatArray, mixture: FloatArray, found: FloatArray, even: FloatArray,
    melted: FloatArray,
) -> None:
    kinds, materials = below.shape[1], fed.shape[1]
    cells = len(mixture)
    top, base, thick = np.zeros(cells), np.zeros(cells), np.zeros(cells)
    seen = np.full(cells, -1e300)
    fresh, deep = np.zeros((cells, kinds)), np.zeros(cells)
    strips = min(_MOST_ACROSS, max(4, int(np.ceil(wide / cell))))
    most = 1
    for v in range(1, len(points)):
        length = np.hypot(points[v, 0] - points[v - 1, 0], points[v, 1] - points[v - 1, 1])
        most = max(most, int(np.ceil(length / cell)))
    need, at = np.empty(strips), np.empty(strips, np.int64)
    cell_of, gain, part = np.empty(most * strips, np.int64), np.empty(most * strips), np.empty(
        most * strips)
    wanted, meets = np.empty((most * strips, materials)), np.empty(kinds)
    best = np.empty(materials)
    way = 0.0
    for track in range(len(starts) - 1):
        way += 1e6
        for v in range(starts[track] + 1, starts[track + 1]):
            dx, dy = points[v, 0] - points[v - 1, 0], points[v, 1] - points[v - 1, 1]
            length = np.hypot(dx, dy)
            if length <= 0.0:
                found[v], even[v], melted[v] = found[v - 1], even[v - 1], melted[v - 1]
                continue
            section = 0.5 * (section_mm2[v] + section_mm2[v - 1])
            melts = 0.5 * (ratio[v] + ratio[v - 1])
            share = melts / (1.0 + melts)
            steps = max(1, int(np.ceil(length / cell)))
            patch, rise = wide / strips * length / steps, section / wide
            events, total = 0, 0.0
            for s in range(steps):
                way += length / steps
                x = points[v - 1, 0] + (s + 0.5) / steps * dx
                y = points[v - 1, 1] + (s + 0.5) / steps * dy
                for j in range(strips):
                    u = 2.0 * (j + 0.5) / strips - 1.0
                    beside = 0.5 * u * wide
                    k = int((x - beside * dy / length) / cell) * columns + int(
                        (y + beside * dx / length) / cell)
                    at[j] = k
                    if way - seen[k] > _PASS_WIDTHS * wide:
                        _mix(k, fresh, deep, thick, mixture, under)
                        base[k] = top[k]
                    seen[k] = way
                    need[j] = base[k] - 1.5 * rise * (1.0 - u * u)
                level = fill_level(need, strips, section * length / steps / patch)
                for j in range(strips):
                    if level <= need[j]:
                        continue
                    k = at[j]
                    gained = (level - need[j]) * patch / (cell * cell)
                    top[k] += gained
                    if np.isnan(under[k, 0]):
                        under[k] = below[v]
                    cell_of[events], gain[events] = k, gained
                    part[events] = (s + 0.5) / steps
                    # of what it melts here: so much is of beads of this layer
                    own = min(1.0, thick[k] / max((level - need[j]) * melts, 1e-12))
                    for m in range(kinds):
                        meets[m] = under[k, m] if own <= 0.0 else (
                            own * mixture[k, m] + (1.0 - own) * under[k, m])
                        if events == 0:
                            melted[v, m] = 0.0
                        melted[v, m] += gained * meets[m]
                    if len(across):
                        place = 0.5 * (2.0 * (j + 0.5) / strips) * (across.shape[1] - 1)
                        left = min(int(place), across.shape[1] - 2)
                        for m in range(materials):
                            designed = across[v, left, m] + (place - left) * (
                                across[v, left + 1, m] - across[v, left, m])
                            wanted[events, m] = (designed - share * meets[m]) / (1.0 - share)
                    total += gained
                    events += 1
            if events == 0:
                continue
            for m in range(kinds):
                melted[v, m] /= total
            if len(across):
                _most_of(wanted, gain, events, _TOLERANCE_FRACTION / (1.0 - share), even[v], best)
                for m in range(materials):
                    found[v, m] = best[m]
            for e in range(events):
                k = cell_of[e]
                for m in range(materials):
                    one = found[v, m] if len(across) else (
                        fed[v - 1, m] + part[e] * (fed[v, m] - fed[v - 1, m]))
                    fresh[k, m] += gain[e] * one
                deep[k] += gain[e] * melts
        first = starts[track]
        if starts[track + 1] - first > 1:
            found[first], even[first], melted[first] = (
                found[first + 1], even[first + 1], melted[first + 1])
    for k in range(cells):
        _mix(k, fresh, deep, thick, mixture, under)


@inner_kernel
def _mix(
    k: int, fresh: FloatArray, deep: FloatArray, thick: FloatArray, mixture: FloatArray,
    under: FloatArray,
) -> None:
    """End a pass over a column: what it added mixes with what it melted."""
    added = 0.0
    for m in range(fresh.shape[1]):
        added += fresh[k, m]
    if added <= 0.0:
        return
    own = min(deep[k], thick[k])
    total = added + deep[k]
    for m in range(fresh.shape[1]):
        taken = (deep[k] - own) * under[k, m]
        if own > 0.0:
            taken += own * mixture[k, m]
        if thick[k] > own:
            under[k, m] = mixture[k, m]
        mixture[k, m] = (fresh[k, m] + taken) / total
        fresh[k, m] = 0.0
    thick[k] = total
    deep[k] = 0.0


@inner_kernel
def _most_of(
    wanted: FloatArray, weight: FloatArray, n: int, reach: float, mean: FloatArray,
    best: FloatArray,
) -> None:
    """The mixture nearest to the most of those wanted: their mean shift within a narrowing reach
    (Comaniciu and Meer 2002, doi:10.1109/34.1000236). mean : becomes that of all of them"""
    materials = wanted.shape[1]
    total = 0.0
    for m in range(materials):
        mean[m] = 0.0
    for e in range(n):
        total += weight[e]
        for m in range(materials):
            mean[m] += weight[e] * wanted[e, m]
    for m in range(materials):
        mean[m] /= total
        best[m] = mean[m]
    moved = np.empty(materials)
    for widening in _WIDENINGS:
        for _ in range(_TURNS):
            total = 0.0
            for m in range(materials):
                moved[m] = 0.0
            for e in range(n):
                off = 0.0
                for m in range(materials):
                    off = max(off, abs(wanted[e, m] - best[m]))
                if off > widening * reach:
                    continue
                total += weight[e]
                for m in range(materials):
                    moved[m] += weight[e] * wanted[e, m]
            if total <= 0.0:
                break
            for m in range(materials):
                best[m] = moved[m] / total
