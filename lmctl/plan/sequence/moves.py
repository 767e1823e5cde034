"""The lines of a program as a table, before they are text."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import BoolArray, FloatArray, IndexArray
from lmctl.field.kernel import kernel
from lmctl.job.schema import LineKind
from lmctl.plan.sequence.flat_arrays import indices_within_stretches

#: Program coordinates carry three decimals, feeds one.
POSITION_STEP_MM = 0.001
FEED_STEP_MM_MIN = 0.1

#: A motion shorter than a motor step makes no block in the firmware, so it would neither run nor
#: be counted; the steps of common axes are 0.002 to 0.0125 mm long.
MIN_MOTION_MM = 0.02


@dataclass(frozen=True)
class Moves:
    """n program lines in order.

    target_mm : (n, 3) float64, position at each line's end
    feed_mm_s : (n,) float64, programmed speed; 0 for lines without motion
    power_W : (n,) float64, 0 except on beads
    kind : (n,) uint8, a LineKind
    path : (n,) int32, path number counted from 0 within the layer, −1 for none
    fractions : (n, n_materials) float64, volume fractions at the line's end
    dwell_s : (n,) float64, time of a DWELL line, else 0
    bead_width_mm : (n,) float64, width of the bead on BEAD lines, else 0
    along_mm : (n, 2) float64, place on the layer's `OrderedTracks` at a BEAD line's start and end
    """

    target_mm: FloatArray
    feed_mm_s: FloatArray
    power_W: FloatArray
    kind: NDArray[np.uint8]
    path: NDArray[np.int32]
    fractions: FloatArray
    dwell_s: FloatArray
    bead_width_mm: FloatArray
    along_mm: FloatArray

    def __len__(self) -> int:
        return len(self.kind)

    def select(self, keep: BoolArray | IndexArray) -> Moves:
        """The lines a mask or an index selects."""
        return Moves(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def is_motion(self) -> BoolArray:
        return np.asarray((self.kind != LineKind.SETUP) & (self.kind != LineKind.DWELL))

    def lengths_mm(self, start_mm: FloatArray) -> FloatArray:
        """Length of each line, (n,), from the end of the one before."""
        return np.asarray(_lengths(self.target_mm, np.asarray(start_mm, dtype=np.float64)))

    def motion_bounds_mm(self) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest coordinates that motion ends at, (3,) each; inf and −inf for none."""
        low, high = _bounds(self.target_mm, self.is_motion())
        return np.asarray(low), np.asarray(high)


def join_moves(parts: list[Moves]) -> Moves:
    """Tables one after the other."""
    return Moves(*(
        np.concatenate([getattr(part, name) for part in parts])
        for name in Moves.__dataclass_fields__
    ))


def moves_of_kind(
    target_mm: FloatArray, *, feed_mm_s: FloatArray | float, kind: LineKind,
    fractions: FloatArray, power_W: FloatArray | float = 0.0, path: int = -1,
    dwell_s: FloatArray | float = 0.0, bead_width_mm: FloatArray | float = 0.0,
) -> Moves:
    """Lines of one kind off the tracks; scalars and single mixtures hold for all of them."""
    target_mm = np.atleast_2d(np.asarray(target_mm, dtype=np.float64))
    n = len(target_mm)
    fractions = np.atleast_2d(fractions)

    def column(value: FloatArray | float) -> FloatArray:
        return np.broadcast_to(np.asarray(value, np.float64), n).copy()

    return Moves(
        target_mm=target_mm, feed_mm_s=column(feed_mm_s), power_W=column(power_W),
        kind=np.full(n, kind, np.uint8), path=np.full(n, path, np.int32),
        fractions=np.broadcast_to(fractions, (n, fractions.shape[1])).copy(),
        dwell_s=column(dwell_s), bead_width_mm=column(bead_width_mm), along_mm=np.zeros((n, 2)),
    )


def with_inserted_moves(moves: Moves, before: IndexArray, more: Moves) -> Moves:
    """Each line of `more` put in before line `before[i]` of the table; before : (k,) rising."""
    return Moves(*(
        np.insert(getattr(moves, name), before, getattr(more, name), axis=0)
        for name in Moves.__dataclass_fields__
    ))


def split_moves(moves: Moves, start_mm: FloatArray, pieces: IndexArray) -> Moves:
    """Each line in so many equal pieces; places and fractions linear between its ends."""
    index = np.repeat(np.arange(len(moves)), pieces)
    number = indices_within_stretches(pieces)
    begin, share = number / pieces[index], (number + 1) / pieces[index]
    before_mm = np.vstack([start_mm, moves.target_mm[:-1]])
    mixture_before = np.vstack([moves.fractions[:1], moves.fractions[:-1]])
    along_mm = moves.along_mm[index]
    result = moves.select(index)
    bead = result.kind == LineKind.BEAD
    part = share[:, None]
    return replace(
        result,
        target_mm=before_mm[index] + part * (moves.target_mm - before_mm)[index],
        fractions=np.where(
            bead[:, None],
            mixture_before[index] + part * (moves.fractions - mixture_before)[index],
            result.fractions),
        dwell_s=result.dwell_s / pieces[index],
        along_mm=along_mm[:, :1] + np.column_stack([begin, share]) * np.diff(along_mm, axis=1),
    )


def rounded_to_program_steps(moves: Moves, start_mm: FloatArray) -> Moves:
    """Round to the decimals of the program text, and drop motions too short to be made.

    The firmware makes no block of a motion shorter than a motor step, so the plan omits them.
    A dropped motion ends within LEAST_MOTION_MM of the last motion kept; the next starts there.
    """
    target, feed, keep = _rounded(
        moves.target_mm, moves.feed_mm_s, moves.is_motion(), np.asarray(start_mm, dtype=np.float64))
    rounded = replace(moves, target_mm=np.asarray(target), feed_mm_s=np.asarray(feed))
    return rounded if keep.all() else rounded.select(np.asarray(keep))


@kernel
def _rounded(
    target: FloatArray, feed: FloatArray, moving: BoolArray, start: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Targets (n, 3) and feeds (n,) in steps of the program, and which lines to keep, (n,)."""
    n = len(target)
    place, speed, keep = np.empty((n, 3)), np.zeros(n), np.ones(n, np.bool_)
    x, y, z = start[0], start[1], start[2]
    for i in range(n):
        for axis in range(3):
            place[i, axis] = np.rint(target[i, axis] / POSITION_STEP_MM) * POSITION_STEP_MM + 0.0
        if not moving[i]:
            continue
        speed[i] = max(np.rint(feed[i] * 60 / FEED_STEP_MM_MIN), 1.0) * FEED_STEP_MM_MIN / 60
        dx, dy, dz = place[i, 0] - x, place[i, 1] - y, place[i, 2] - z
        keep[i] = np.sqrt(dx * dx + dy * dy + dz * dz) >= MIN_MOTION_MM
        if keep[i]:
            x, y, z = place[i, 0], place[i, 1], place[i, 2]
    return place, speed, keep


@kernel
def _bounds(target: FloatArray, moving: BoolArray) -> tuple[FloatArray, FloatArray]:
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(len(target)):
        if moving[i]:
            for axis in range(3):
                low[axis] = min(low[axis], target[i, axis])
                high[axis] = max(high[axis], target[i, axis])
    return low, high


@kernel
def _lengths(target: FloatArray, start: FloatArray) -> FloatArray:
    length = np.empty(len(target))
    x, y, z = start[0], start[1], start[2]
    for i in range(len(target)):
        dx, dy, dz = target[i, 0] - x, target[i, 1] - y, target[i, 2] - z
        length[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
        x, y, z = target[i, 0], target[i, 1], target[i, 2]
    return length
