"""A stretch of program as a table, before it is text."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lmctl.job.schema import LineKind

FloatArray = NDArray[np.float64]

#: Program coordinates carry three decimals, feeds one.
POSITION_STEP_MM = 0.001
FEED_STEP_MM_MIN = 0.1

#: A motion shorter than a motor step makes no block in the firmware, so it would neither run nor
#: be counted; the steps of common axes are 0.002 to 0.0125 mm long.
LEAST_MOTION_MM = 0.02


@dataclass(frozen=True)
class Moves:
    """n program lines in order.

    target_mm : (n, 3) float64, position at each line's end, on the program's 0.001 mm raster
    feed_mm_s : (n,) float64, programmed speed; 0 for lines without motion
    power_W : (n,) float64, 0 except on beads
    kind : (n,) uint8, a LineKind
    path : (n,) int32, path number counted from 0 within the layer, −1 for none
    fractions : (n, n_materials) float64, volume fractions at the line's end
    dwell_s : (n,) float64, time of a DWELL line, else 0
    """

    target_mm: FloatArray
    feed_mm_s: FloatArray
    power_W: FloatArray
    kind: NDArray[np.uint8]
    path: NDArray[np.int32]
    fractions: FloatArray
    dwell_s: FloatArray

    def __len__(self) -> int:
        return len(self.kind)

    def take(self, keep: NDArray[np.bool_] | NDArray[np.intp]) -> Moves:
        """The lines a mask or an index selects."""
        return Moves(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def is_motion(self) -> NDArray[np.bool_]:
        return np.asarray((self.kind != LineKind.SETUP) & (self.kind != LineKind.DWELL))


def join(parts: list[Moves]) -> Moves:
    """Tables one after the other."""
    return Moves(*(
        np.concatenate([getattr(part, name) for part in parts])
        for name in Moves.__dataclass_fields__
    ))


def lines(
    target_mm: FloatArray, *, feed_mm_s: FloatArray | float, kind: LineKind,
    fractions: FloatArray, power_W: FloatArray | float = 0.0, path: int = -1, dwell_s: float = 0.0,
) -> Moves:
    """Lines of one kind; scalars and single mixtures hold for all of them."""
    target_mm = np.atleast_2d(np.asarray(target_mm, dtype=np.float64))
    n = len(target_mm)
    fractions = np.atleast_2d(fractions)
    return Moves(
        target_mm=target_mm,
        feed_mm_s=np.broadcast_to(np.asarray(feed_mm_s, np.float64), n).copy(),
        power_W=np.broadcast_to(np.asarray(power_W, np.float64), n).copy(),
        kind=np.full(n, kind, np.uint8),
        path=np.full(n, path, np.int32),
        fractions=np.broadcast_to(fractions, (n, fractions.shape[1])).copy(),
        dwell_s=np.full(n, dwell_s),
    )


def on_raster(moves: Moves, start_mm: FloatArray) -> Moves:
    """Round to what the program text can say, and drop motions too short to be made.

    The firmware makes no block of a motion shorter than a motor step, so none may be counted on.
    What is dropped ends within LEAST_MOTION_MM of the last motion kept; the next starts there.
    """
    target = np.round(moves.target_mm / POSITION_STEP_MM) * POSITION_STEP_MM + 0.0
    feed = np.maximum(np.round(moves.feed_mm_s * 60 / FEED_STEP_MM_MIN), 1) * FEED_STEP_MM_MIN / 60
    moving = moves.is_motion()
    rounded = replace(moves, target_mm=target, feed_mm_s=np.where(moving, feed, 0.0))
    before = np.vstack([start_mm, target[:-1]])
    short = moving & (np.linalg.norm(target - before, axis=1) < LEAST_MOTION_MM)
    if not short.any():
        return rounded
    keep = np.ones(len(moves), dtype=bool)
    at = np.asarray(start_mm, dtype=np.float64)
    for i in np.flatnonzero(moving):
        keep[i] = np.linalg.norm(target[i] - at) >= LEAST_MOTION_MM
        if keep[i]:
            at = target[i]
    return rounded.take(keep)
