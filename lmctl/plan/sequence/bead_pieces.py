"""A layer's beads in pieces so short that time, place and mixture are even along each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import LineKind
from lmctl.plan.melted_below import MeltedBelow
from lmctl.plan.sequence.flat_arrays import indices_within_stretches
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.track_order import OrderedTracks

#: Pieces last at most so long [s].
_EVERY_S = 0.05


@dataclass(frozen=True)
class BeadPieces:
    """q pieces of the beads of one layer, in the order in which they are deposited.

    layer : index in the job; z_mm : at which the layer's composition is taken
    at_s, duration_s : (q,) program time at the middle, and how long it lasts
    place_mm : (q, 2) of the middle, in the part's own coordinates
    direction : (q, 2) unit vectors; length_mm, width_mm : (q,) of the bead
    fed, planned, designed : (q, materials) volume fractions as the program feeds them, as beads are
        planned to be, and as the part file has them
    melted : what beads melt of what lies below; None where dilution is not compensated. With it,
        planned and designed have a last column for a substrate that is none of the materials
    """

    layer: int
    z_mm: float
    at_s: FloatArray
    duration_s: FloatArray
    place_mm: FloatArray
    direction: FloatArray
    length_mm: FloatArray
    width_mm: FloatArray
    fed: FloatArray
    planned: FloatArray
    designed: FloatArray
    melted: MeltedBelow | None = None

    def laid(self, fed: FloatArray) -> FloatArray:
        """What beads are of that are fed with mixtures (q, materials)."""
        return fed if self.melted is None else self.melted.laid(fed)

    def __len__(self) -> int:
        return len(self.at_s)


def bead_pieces(
    layer: int, z_mm: float, tracks: OrderedTracks, moves: Moves, start_mm: FloatArray,
    start_s: float, end_s: FloatArray, offset_mm: FloatArray,
) -> BeadPieces:
    """The pieces of one layer's beads.

    moves : lines that end at `end_s` (n,), the first of them starting at `start_mm`, `start_s`
    offset_mm : (3,) program coordinates of the part's own origin
    The part's own mixture is that at the tracks' vertices, linear in between, and so is what beads
    melt of the layer below.
    """
    bead = np.flatnonzero(moves.kind == LineKind.BEAD)
    begin_s = np.concatenate([[start_s], end_s[:-1]])[bead]
    lasting_s = end_s[bead] - begin_s
    before = np.vstack([moves.fractions[:1], moves.fractions[:-1]])[bead]
    from_mm = np.vstack([start_mm, moves.target_mm[:-1]])[bead, :2]
    way_mm = moves.target_mm[bead, :2] - from_mm
    length_mm = np.sqrt((way_mm**2).sum(axis=1))
    pieces = np.maximum(1, np.ceil(lasting_s / _EVERY_S).astype(np.intp))
    line = np.repeat(np.arange(len(bead)), pieces)
    share = (indices_within_stretches(pieces) + 0.5) / pieces[line]
    along = moves.along_mm[bead]
    at = along[line, 0] + share * (along[:, 1] - along[:, 0])[line]
    fed = before[line] + share[:, None] * (moves.fractions[bead] - before)[line]
    melted = None if tracks.melted is None else tracks.melted.at_lengths(tracks.along_mm, at)
    own = tracks.fractions if tracks.designed is None else tracks.designed
    designed = np.column_stack([np.interp(at, tracks.along_mm, column) for column in own.T])
    if melted is not None:
        designed = melted.designed if tracks.designed is None else np.column_stack(
            [designed, np.zeros(len(designed))])
    return BeadPieces(
        layer, z_mm,
        at_s=begin_s[line] + share * lasting_s[line],
        duration_s=lasting_s[line] / pieces[line],
        place_mm=from_mm[line] + share[:, None] * way_mm[line] - offset_mm[:2],
        direction=(way_mm / np.maximum(length_mm, 1e-12)[:, None])[line],
        length_mm=length_mm[line] / pieces[line],
        width_mm=moves.bead_width_mm[bead][line],
        fed=fed, planned=fed if melted is None else melted.laid(fed),
        designed=designed,
        melted=melted)
