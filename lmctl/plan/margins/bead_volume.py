"""The share of volume that gets its mixture: beads poured side by side on the cells of a layer.

Every cell is compared with the part's own composition at three heights of the layer. A bead has one
mixture across: beads a pitch p apart, of width b, are alone up to p − b/2 beside their middle, so a
gradient across the tracks of more than tolerance / (p − b/2) is beyond them in any case.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.margins.poured_beads import HEIGHTS, poured_beads
from lmctl.plan.sequence.bead_pieces import BeadPieces

#: Cells across a bead, where the layer's extent allows: memory.
_CELLS_PER_BEAD = 8
_MOST_CELLS = 2_000_000
#: So many cells of a layer are compared with the design at most, evenly chosen, each at so many
#: heights: a composition may cost more than all else here.
_MOST_COMPARED = 4_000
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
        margin_mm = float(pieces.width_mm.max())
        low = pieces.place_mm.min(axis=0) - margin_mm
        size = pieces.place_mm.max(axis=0) + margin_mm - low
        cell_mm = max(float(np.median(pieces.width_mm)) / _CELLS_PER_BEAD,
                      (float(size.prod()) / _MOST_CELLS) ** 0.5)
        rows, columns = (int(n) + 1 for n in np.ceil(size / cell_mm))
        self._planned_mm3 = pieces.length_mm * pieces.width_mm * strip_ratio * layer_height_mm
        poured, in_strip = poured_beads(pieces, self._planned_mm3, strip_ratio, layer_height_mm,
                                        low, cell_mm, (rows, columns))
        filled = poured.volume_mm3(self._planned_mm3[:, None]).reshape(-1, HEIGHTS)
        full_mm3 = cell_mm**2 * layer_height_mm
        cells = np.flatnonzero(in_strip & (filled.sum(axis=1) > _LEAST_FILLED * full_mm3))
        chosen = np.linspace(0, len(cells) - 1, min(len(cells), _MOST_COMPARED)).astype(np.intp)
        voxels = (cells[chosen][:, None] * HEIGHTS + np.arange(HEIGHTS)).ravel()
        voxels = voxels[filled.ravel()[voxels] > _LEAST_FILLED * full_mm3 / HEIGHTS]
        self._poured = poured.of_voxels(voxels)
        row, column = np.divmod(voxels // HEIGHTS, columns)
        height = ((voxels % HEIGHTS + 0.5) / HEIGHTS - 0.5) * layer_height_mm
        self._place_mm = np.column_stack([
            low + (np.column_stack([row, column]) + 0.5) * cell_mm, pieces.z_mm + height])
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
        laid = self._poured.volume_mm3(volume_mm3)
        total = laid.sum(axis=1)
        laid /= np.maximum(total, 1e-12)[:, None]
        return np.abs(laid - self._designed).max(axis=1), total

    def as_designed(self) -> FloatArray:
        """(q, materials) what each piece lays where each has its own mixture exactly."""
        return np.asarray(self._pieces.designed * self._planned_mm3[:, None])

    def worst_place(self, errors: FloatArray) -> WorstPlace:
        """The cell that is farthest from the design."""
        worst = int(errors.argmax())
        return WorstPlace(self._pieces.layer, self._place_mm[worst], float(errors[worst]))
