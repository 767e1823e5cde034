"""When the temperature of a place counts as the one that the beam comes back to.

What is read is what is left of former heat, not the front of the molten pool that just arrives. So
a place is read at the last moment at which the beam was some bead widths away from it, or had been
off for a while.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray, IndexArray
from lmctl.field.kernel import kernel

#: Places are read when the beam is at least so many bead widths away,
CLEAR_BEADS = 3.0
#: or has been off for so long [s].
CLEAR_S = 1.0


@dataclass(frozen=True)
class ReadingMoments:
    """Places at which beads of a layer are deposited, and when each is read; r places.

    place_mm : (r, 2) float64; line : (r,) intp, bead line that it lies on
    owner : (r,) intp, the bead line during which it is read, or at whose start
    at_s : (r,) float64, time of reading
    """

    place_mm: FloatArray
    line: IndexArray
    owner: IndexArray
    at_s: FloatArray


def reading_moments(
    start_mm: FloatArray, end_mm: FloatArray, start_s: FloatArray, end_s: FloatArray,
    bead_mm: float,
) -> ReadingMoments:
    """Reading moments along the bead lines of one layer, half a bead width apart.

    start_mm, end_mm : (n, 2); start_s, end_s : (n,) rising; of the layer's bead lines
    However beads are divided into lines, and interrupted, the places are the same.
    """
    step_mm = end_mm - start_mm
    length_mm = np.sqrt((step_mm**2).sum(axis=1))
    ends_mm = np.cumsum(length_mm)
    # the first is not on a path's very end, which rounding would put on one line or another
    at_mm = np.arange(bead_mm / 4, ends_mm[-1], bead_mm / 2)
    line = np.minimum(np.searchsorted(ends_mm, at_mm), len(ends_mm) - 1)
    share = 1 - np.clip((ends_mm[line] - at_mm) / np.maximum(length_mm[line], 1e-9), 0, 1)
    place_mm = start_mm[line] + share[:, None] * step_mm[line]
    owner, at_s = _moments(
        start_mm, end_mm, start_s, end_s, line, share, place_mm, CLEAR_BEADS * bead_mm, CLEAR_S)
    return ReadingMoments(place_mm, line, np.asarray(owner), np.asarray(at_s))


@kernel
def _moments(
    start: FloatArray, end: FloatArray, start_s: FloatArray, end_s: FloatArray, line: IndexArray,
    share: FloatArray, place: FloatArray, clear_mm: float, clear_s: float,
) -> tuple[IndexArray, FloatArray]:
    owner = np.zeros(len(line), np.int64)
    at_s = np.empty(len(line))
    for r in range(len(line)):
        x, y = place[r, 0], place[r, 1]
        k = line[r]
        until = share[r]  # of its own line, only what lies before the place
        while True:
            before = np.hypot(start[k, 0] - x, start[k, 1] - y)
            if before >= clear_mm:
                after = np.hypot(start[k, 0] + until * (end[k, 0] - start[k, 0]) - x,
                                 start[k, 1] + until * (end[k, 1] - start[k, 1]) - y)
                part = min(max((before - clear_mm) / max(before - after, 1e-9), 0.0), 1.0)
                at_s[r] = start_s[k] + part * until * (end_s[k] - start_s[k])
                break
            if k == 0 or start_s[k] - end_s[k - 1] >= clear_s:
                at_s[r] = start_s[k]
                break
            k -= 1
            until = 1.0
        owner[r] = k
    return owner, at_s
