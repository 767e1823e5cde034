"""What the lines of a layer add up to, between any two program times: path, beam time, energy.

The plan of a layer is the sum over all of its lines; what has been executed is the sum up to the
place that the controller reports.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import NamedTuple

import numpy as np

from lmctl.array_types import FloatArray


class Totals(NamedTuple):
    """From the start of a layer to a program time in it.

    path_mm, beam_s, energy_J : of the lines with the beam on, as programmed; beam_s at a feed
        override of 100 %
    """

    path_mm: float
    beam_s: float
    energy_J: float


class LayerTotals:
    """Sums over the lines of one layer.

    beam_from_s : program time at which its first line with the beam on starts; its end without one
    start_s, end_s, length_mm : (n,) of each line
    energy_J_mm : (n,) its beam power over its programmed speed, 0 where the beam is off. Under M4
        the controller scales power with speed, so a line gets that much per millimetre also while
        it accelerates.
    """

    def __init__(
        self, start_s: FloatArray, end_s: FloatArray, length_mm: FloatArray,
        energy_J_mm: FloatArray,
    ) -> None:
        lasting_s = end_s - start_s
        is_on = energy_J_mm > 0.0
        first = int(np.argmax(is_on)) if is_on.any() else -1
        self.beam_from_s = float(start_s[first] if first >= 0 else end_s[-1])
        self._starts_s: list[float] = start_s.tolist()
        self._ends_s: list[float] = end_s.tolist()
        self._path_mm = _sums(np.where(is_on, length_mm, 0.0))
        self._beam_s = _sums(np.where(is_on, lasting_s, 0.0))
        self._energy_J = _sums(np.where(is_on, energy_J_mm * length_mm, 0.0))

    @property
    def all_lines(self) -> Totals:
        """Of all lines."""
        return Totals(self._path_mm[-1], self._beam_s[-1], self._energy_J[-1])

    def up_to_program_time(self, s: float) -> Totals:
        """Up to program time s. Within a line all sums grow in proportion to its length."""
        row = min(bisect_left(self._ends_s, s), len(self._ends_s) - 1)
        start_s, end_s = self._starts_s[row], self._ends_s[row]
        share = (s - start_s) / (end_s - start_s) if end_s > start_s else 1.0
        share = min(max(share, 0.0), 1.0)
        return Totals(*(
            sums[row] + share * (sums[row + 1] - sums[row])
            for sums in (self._path_mm, self._beam_s, self._energy_J)
        ))


def _sums(values: FloatArray) -> list[float]:
    """0, and the sum up to each line's end."""
    found: list[float] = np.concatenate([[0.0], np.cumsum(values)]).tolist()
    return found
