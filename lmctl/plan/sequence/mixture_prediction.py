"""Predict the deposited mixture along a layer's beads, and compare it with plan and part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.job.schema import LineKind
from lmctl.plan.recipe import Recipe
from lmctl.plan.sequence.flat_arrays import indices_within_stretches
from lmctl.plan.sequence.hose_model import HoseModel
from lmctl.plan.sequence.moves import Moves
from lmctl.plan.sequence.powder_flow import PowderFlow
from lmctl.plan.sequence.track_order import OrderedTracks

#: Predictions are made at points at most so far apart in time [s].
_EVERY_S = 0.05


@dataclass(frozen=True)
class MixturePrediction:
    """Volume fractions (q, materials) along so much bead each, (q,): as beads are predicted to be
    deposited, as planned, and as the part file has them; and as the program feeds them.

    Where dilution is compensated, predicted and planned are of the bead with what it melts from
    below, and all but `fed` have a last column for a substrate that is none of the materials.
    """

    length_mm: FloatArray
    predicted: FloatArray
    planned: FloatArray
    designed: FloatArray
    fed: FloatArray


def predict_mixture(
    tracks: OrderedTracks, moves: Moves, start_mm: FloatArray, start_s: float, end_s: FloatArray,
    flow: PowderFlow, hoses: HoseModel, recipe: Recipe,
) -> MixturePrediction:
    """One layer's prediction; `hoses` goes on by that layer.

    moves : lines that end at `end_s` (n,), the first of them starting at `start_mm`, `start_s`
    The part's own mixture is that at the tracks' vertices, linear in between, and so is what beads
    melt of the layer below.
    """
    bead = np.flatnonzero(moves.kind == LineKind.BEAD)
    begin_s = np.concatenate([[start_s], end_s[:-1]])[bead]
    lasting_s = end_s[bead] - begin_s
    before = np.vstack([moves.fractions[:1], moves.fractions[:-1]])[bead]
    pieces = np.maximum(1, np.ceil(lasting_s / _EVERY_S).astype(np.intp))
    line = np.repeat(np.arange(len(bead)), pieces)
    share = (indices_within_stretches(pieces) + 0.5) / pieces[line]
    predicted = recipe.deposited_fractions(
        hoses.advance(flow.times_s, flow.g_s, begin_s[line] + share * lasting_s[line]))
    along = moves.along_mm[bead]
    at = along[line, 0] + share * (along[:, 1] - along[:, 0])[line]
    length_mm = moves.lengths_mm(start_mm)[bead][line] / pieces[line]
    fed = before[line] + share[:, None] * (moves.fractions[bead] - before)[line]
    if tracks.melted is not None:
        melted = tracks.melted.at_lengths(tracks.along_mm, at)
        return MixturePrediction(length_mm, melted.laid(predicted), melted.laid(fed),
                                 melted.designed, fed)
    designed = np.column_stack([
        np.interp(at, tracks.along_mm, column) for column in tracks.fractions.T])
    return MixturePrediction(length_mm, predicted, fed, designed, fed)
