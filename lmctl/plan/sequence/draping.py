"""Lay the moves of a flat layer over a substrate: a height at each place, pace along the slope.

The horizontal pace stays as planned, so times and powder do too. A layer as thick as the layer
height takes as much volume for a horizontal millimetre on a slope as on the level, and one that
is thicker or thinner has it in its strips (`geometry.stage`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.job.schema import LineKind
from lmctl.part.substrate import LayerStack
from lmctl.plan.sequence.moves import Moves, split_moves

#: A line leaves the surface between its ends by no more than this [mm],
_CHORD_MM = 0.02
#: looked for at so many places between them, with so many halvings of its pieces.
_LOOKED_AT, _HALVINGS = 7, 8


@dataclass(frozen=True)
class LayerDrape:
    """The top of one layer, in program coordinates.

    level_mm : its u in the stack; offset_mm : (3,) program coordinates of the part's origin
    """

    stack: LayerStack
    level_mm: float
    offset_mm: FloatArray

    def height_mm(self, places_mm: FloatArray) -> FloatArray:
        """z at places (n, 2) -> (n,)."""
        own_mm = self.stack.height_mm(places_mm - self.offset_mm[:2], self.level_mm)
        return np.asarray(own_mm + self.offset_mm[2])

    def stretch(self, points_mm: FloatArray) -> FloatArray:
        """Its thickness over the layer height at points (n, 2) of the part -> (n,)."""
        return self.stack.stretch(points_mm, self.level_mm)

    def highest_mm(self) -> float:
        """Highest z under the part."""
        return self.stack.highest_mm(self.level_mm) + float(self.offset_mm[2])

    def highest_around_mm(self) -> float:
        """Highest z under the part, or of the surface around it."""
        return self.stack.highest_around_mm(self.level_mm) + float(self.offset_mm[2])

    def steepest_slope(self) -> float:
        """Steepest rise over run under the part."""
        return self.stack.steepest_slope(self.level_mm)


def draped_moves(
    moves: Moves, start_mm: FloatArray, flat_z_mm: float, drape: LayerDrape, clearance_mm: float
) -> Moves:
    """Moves of `travel.layer_moves` at one height, on the top of their layer.

    start_mm : (3,) where the nozzle is; flat_z_mm : the height of the flat layer. Moves above it
        are travels with the beam off: they go up to the clearance over all of the layer
    """
    on_layer = moves.target_mm[:, 2] <= flat_z_mm + 1e-9
    before = np.concatenate([[False], on_layer[:-1]])
    along = np.flatnonzero(on_layer & before & moves.is_motion())
    places = np.vstack([start_mm[:2], moves.target_mm[:-1, :2]])
    pieces = np.ones(len(moves), dtype=np.intp)
    pieces[along] = _pieces(places[along], moves.target_mm[along, :2], drape)
    line = np.repeat(np.arange(len(moves)), pieces)
    moves = split_moves(moves, start_mm, pieces)
    on_layer, target = on_layer[line], moves.target_mm.copy()
    target[on_layer, 2] = drape.height_mm(target[on_layer, :2])
    lift_mm = drape.highest_around_mm() + clearance_mm
    target[~on_layer, 2] = lift_mm
    first = int(np.argmax(on_layer)) if on_layer.any() else len(target)
    target[:first, 2] = max(lift_mm, float(start_mm[2]))
    target[0] = start_mm  # the rest at the layer's beginning
    steps = np.diff(np.vstack([start_mm, target]), axis=0)
    level_mm = np.hypot(steps[:, 0], steps[:, 1])
    paced = np.isin(moves.kind, (LineKind.BEAD, LineKind.LEAD)) & (level_mm > 0)
    longer = np.ones(len(target))
    longer[paced] = np.linalg.norm(steps[paced], axis=1) / level_mm[paced]
    return replace(moves, target_mm=target, feed_mm_s=moves.feed_mm_s * longer)


def _pieces(start: FloatArray, end: FloatArray, drape: LayerDrape) -> NDArray[np.intp]:
    """Into how many equal pieces each line (n, 2) to (n, 2) is cut to stay near the surface."""
    pieces = np.ones(len(start), dtype=np.intp)
    waiting = np.arange(len(start))
    for _ in range(_HALVINGS):
        if len(waiting) == 0:
            break
        count = int(pieces[waiting[0]])
        share = np.arange(count * (_LOOKED_AT + 1) + 1) / (count * (_LOOKED_AT + 1))
        way = (end - start)[waiting]
        places = start[waiting][:, None] + share[None, :, None] * way[:, None]
        z = drape.height_mm(places.reshape(-1, 2)).reshape(len(waiting), -1)
        knots = np.arange(count + 1) * (_LOOKED_AT + 1)
        chord = np.stack([np.interp(share, share[knots], row) for row in z[:, knots]])
        waiting = waiting[np.abs(chord - z).max(axis=1) > _CHORD_MM]
        pieces[waiting] *= 2
    return pieces
