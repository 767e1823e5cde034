"""The share of volume that gets its mixture: beads laid side by side on the cells of a layer.

Across a bead its volume is spread as a parabola of the bead's width, and beads that overlap mix
where they do. Every cell is compared with the part's own composition at three heights of the layer.
A bead has one mixture across: beads a pitch p apart, of width b, are unmixed up to p − b/2 beside
their middle, so a gradient across the tracks of more than tolerance / (p − b/2) is beyond them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.field.kernel import kernel
from lmctl.plan.sequence.bead_pieces import BeadPieces

#: Cells across a bead, where the layer's extent allows: memory.
_CELLS_PER_BEAD = 8
_MOST_CELLS = 2_000_000
#: So many cells of a layer are compared with the design at most, evenly chosen, each at so many
#: heights: a composition may cost more than all else here.
_MOST_COMPARED = 4_000
_HEIGHTS = 3
#: A cell that holds less than this share of a full one is at the edge of the deposit.
_LEAST_FILLED = 0.05
_ROUNDING = 1e-9


def resolvable_per_mm(bead_mm: float, pitch_mm: float, tolerance: float) -> float:
    """The steepest gradient across tracks that beads carry to within a tolerance [1/mm]; infinite
    where neighbours meet in the middle of each other.

    >>> round(resolvable_per_mm(2.0, 1.334, 0.03), 3)
    0.09
    """
    unmixed_mm = pitch_mm - bead_mm / 2.0
    return tolerance / unmixed_mm if unmixed_mm > 1e-9 else np.inf


@dataclass(frozen=True)
class WorstPlace:
    """Where beads are farthest from the design. place_mm : (3,) in the part's own coordinates;
    layer : index in the job; error : of a volume fraction"""

    layer: int
    place_mm: FloatArray
    error: float


class LayerVolume:
    """One layer's cells.

    pieces : of its beads; strip_ratio : of strip width over bead width
    composition : the part's, at points (n, 3)
    """

    def __init__(
        self, pieces: BeadPieces, strip_ratio: float, layer_height_mm: float,
        composition: Callable[[FloatArray], FloatArray],
    ) -> None:
        self._pieces = pieces
        self._strip_ratio = strip_ratio
        margin_mm = float(pieces.width_mm.max())
        low = pieces.place_mm.min(axis=0) - margin_mm
        size = pieces.place_mm.max(axis=0) + margin_mm - low
        self._cell_mm = max(float(np.median(pieces.width_mm)) / _CELLS_PER_BEAD,
                            (float(size.prod()) / _MOST_CELLS) ** 0.5)
        self._low_mm = low
        self._shape = np.ceil(size / self._cell_mm).astype(np.int64) + 1
        amount = pieces.length_mm * pieces.width_mm * strip_ratio
        volume, in_strip = self._laid(pieces.designed * amount[:, None])
        total = volume.sum(axis=1)
        cells = np.flatnonzero(in_strip & (total > _LEAST_FILLED * self._cell_mm**2))
        chosen = np.linspace(0, len(cells) - 1, min(len(cells), _MOST_COMPARED))
        self._cells = cells[chosen.astype(np.intp)]
        row, column = np.divmod(self._cells, self._shape[1])
        place = low + (np.column_stack([row, column]) + 0.5) * self._cell_mm
        heights = pieces.z_mm + ((np.arange(_HEIGHTS) + 0.5) / _HEIGHTS - 0.5) * layer_height_mm
        self._place_mm = np.column_stack([
            np.tile(place, (_HEIGHTS, 1)), np.repeat(heights, len(place))])
        self._designed = np.zeros((len(self._place_mm), pieces.designed.shape[1]))
        found = composition(self._place_mm)  # of a foreign substrate there is to be nothing
        self._designed[:, : found.shape[1]] = found

    @property
    def columns(self) -> int:
        """Materials that are compared, a foreign substrate included where there is one."""
        return int(self._designed.shape[1])

    def errors(self, volume_mm3: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far cells are from the design, (c,) greatest difference of a fraction, and the
        volume of each, (c,).

        volume_mm3 : (q, columns of the pieces' design) that each piece lays
        """
        laid, _ = self._laid(volume_mm3)
        laid = laid[self._cells]
        total = laid.sum(axis=1)
        fractions = laid / np.maximum(total, 1e-12)[:, None]
        error = np.abs(np.tile(fractions, (_HEIGHTS, 1)) - self._designed).max(axis=1)
        return error, np.tile(total / _HEIGHTS, _HEIGHTS)

    def as_designed(self) -> FloatArray:
        """(q, materials) what each piece lays where each has its own mixture exactly."""
        pieces = self._pieces
        return np.asarray(pieces.designed * (pieces.length_mm * pieces.width_mm)[:, None])

    def worst_place(self, errors: FloatArray) -> WorstPlace:
        """The cell that is farthest from the design."""
        worst = int(errors.argmax())
        return WorstPlace(self._pieces.layer, self._place_mm[worst], float(errors[worst]))

    def _laid(self, volume_mm3: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Volume in every cell, (cells, materials), and which cells lie in a strip."""
        pieces = self._pieces
        cells = np.zeros((int(self._shape.prod()), volume_mm3.shape[1]))
        in_strip = np.zeros(len(cells), dtype=np.bool_)
        _lay(pieces.place_mm - self._low_mm, pieces.direction, pieces.length_mm, pieces.width_mm,
             np.ascontiguousarray(volume_mm3), self._strip_ratio, self._cell_mm,
             int(self._shape[1]), cells, in_strip)
        return cells, in_strip


@kernel
def _lay(
    place: FloatArray, direction: FloatArray, length: FloatArray, width: FloatArray,
    volume: FloatArray, strip_ratio: float, cell: float, columns: int, cells: FloatArray,
    in_strip: BoolArray,
) -> None:
    """Spread pieces over cells, half a cell apart along and across them."""
    for i in range(len(place)):
        steps = max(1, int(np.ceil(2.0 * length[i] / cell)))
        across = max(4, int(np.ceil(2.0 * width[i] / cell)))
        whole = 0.0
        for j in range(across):
            u = 2.0 * (j + 0.5) / across - 1.0
            whole += 1.0 - u * u
        for s in range(steps):
            along = ((s + 0.5) / steps - 0.5) * length[i]
            x = place[i, 0] + along * direction[i, 0]
            y = place[i, 1] + along * direction[i, 1]
            for j in range(across):
                u = 2.0 * (j + 0.5) / across - 1.0
                beside = 0.5 * u * width[i]
                a = int((x - beside * direction[i, 1]) / cell)
                b = int((y + beside * direction[i, 0]) / cell)
                k = a * columns + b
                share = (1.0 - u * u) / (whole * steps)
                for m in range(volume.shape[1]):
                    cells[k, m] += share * volume[i, m]
                if abs(u) <= strip_ratio:
                    in_strip[k] = True
