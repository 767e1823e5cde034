"""The level up to which something poured into wells side by side fills them."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.field.kernel import inner_kernel


@inner_kernel
def fill_level(floor: FloatArray, n: int, wanted: float) -> float:
    """The level to which wells with floors at floor[:n], of area 1, are filled by so much."""
    level, filled = np.inf, n + 1
    while True:
        held, below = 0.0, 0
        for j in range(n):
            if floor[j] <= level:
                held += floor[j]
                below += 1
        if below == 0 or below >= filled:
            return float(level)
        level, filled = (wanted + held) / below, below
