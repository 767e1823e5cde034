"""A layer's beads in pieces so short that time, place and mixture are even along each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.field.kernel import kernel
from lmctl.job.schema import LineKind
from lmctl.plan.melted_below import MeltedBelow
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
    own = tracks.fractions if tracks.designed is None else tracks.designed
    at_s, at_mm, numbers, fed, designed = _pieces(
        moves.kind == LineKind.BEAD, moves.target_mm, np.asarray(start_mm, dtype=np.float64),
        start_s, end_s, moves.fractions, moves.along_mm, moves.bead_width_mm, tracks.along_mm,
        np.ascontiguousarray(own), _EVERY_S)
    melted = None if tracks.melted is None else tracks.melted.at_lengths(tracks.along_mm, at_mm)
    if melted is not None:
        designed = melted.designed if tracks.designed is None else np.column_stack(
            [designed, np.zeros(len(designed))])
    return BeadPieces(
        layer, z_mm, at_s=at_s, duration_s=numbers[0],
        place_mm=np.ascontiguousarray(numbers[1:3].T - offset_mm[:2]),
        direction=np.ascontiguousarray(numbers[3:5].T), length_mm=numbers[5], width_mm=numbers[6],
        fed=fed, planned=fed if melted is None else melted.laid(fed),
        designed=designed, melted=melted)


def designed_at_line_ends(tracks: OrderedTracks, moves: Moves) -> FloatArray:
    """Volume fractions (n, materials) of the part at the end of each bead line, else zeros."""
    own = tracks.fractions if tracks.designed is None else tracks.designed
    if tracks.melted is not None and tracks.designed is None:
        own = tracks.melted.designed[:, : own.shape[1]]
    designed = np.zeros((len(moves), own.shape[1]))
    bead = moves.kind == LineKind.BEAD
    for material in range(own.shape[1]):
        designed[bead, material] = np.interp(
            moves.along_mm[bead, 1], tracks.along_mm, own[:, material])
    return designed


@kernel
def _pieces(
    is_bead: BoolArray, target: FloatArray, start: FloatArray, start_s: float, end_s: FloatArray,
    fractions: FloatArray, along: FloatArray, width: FloatArray, track_along: FloatArray,
    field: FloatArray, every_s: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Middles of pieces of bead lines: program time and place on the tracks, (q,) each; duration,
    place, direction, length and width, rows of (7, q); mixtures fed and of the part (q, materials).

    is_bead, end_s, width : (n,) of lines; target : (n, 3); fractions : (n, materials)
    along : (n, 2) as in `Moves`; track_along : (v,) rising; field : (v, materials) mixture there
    """
    n, materials = fractions.shape
    pieces = np.zeros(n, np.int64)
    count = 0
    for line in range(n):
        if is_bead[line]:
            begin_s = end_s[line - 1] if line > 0 else start_s
            pieces[line] = max(1, int(np.ceil((end_s[line] - begin_s) / every_s)))
            count += pieces[line]
    at_s, at, numbers = np.empty(count), np.empty(count), np.empty((7, count))
    fed, designed = np.empty((count, materials)), np.empty((count, materials))
    q, v = 0, 1
    for line in range(n):
        if pieces[line] == 0:
            continue
        before = max(line - 1, 0)
        begin_s = end_s[line - 1] if line > 0 else start_s
        x, y = (target[line - 1, 0], target[line - 1, 1]) if line > 0 else (start[0], start[1])
        dx, dy = target[line, 0] - x, target[line, 1] - y
        length = np.sqrt(dx * dx + dy * dy)
        for piece in range(pieces[line]):
            share = (piece + 0.5) / pieces[line]
            at_s[q] = begin_s + share * (end_s[line] - begin_s)
            at[q] = along[line, 0] + share * (along[line, 1] - along[line, 0])
            numbers[0, q] = (end_s[line] - begin_s) / pieces[line]
            numbers[1, q], numbers[2, q] = x + share * dx, y + share * dy
            numbers[3, q], numbers[4, q] = dx / max(length, 1e-12), dy / max(length, 1e-12)
            numbers[5, q], numbers[6, q] = length / pieces[line], width[line]
            while v < len(track_along) - 1 and track_along[v] < at[q]:
                v += 1
            while v > 1 and track_along[v - 1] > at[q]:
                v -= 1
            into = (at[q] - track_along[v - 1]) / (track_along[v] - track_along[v - 1])
            into = min(max(into, 0.0), 1.0)
            for m in range(materials):
                fed[q, m] = fractions[before, m] + share * (
                    fractions[line, m] - fractions[before, m])
                designed[q, m] = field[v - 1, m] + into * (field[v, m] - field[v - 1, m])
            q += 1
    return at_s, at, numbers, fed, designed
