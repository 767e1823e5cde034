"""Beam power of a layer that finds what is below it hot already."""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray


def following_power_factor(
    found_C: FloatArray, melting_C: float, plate_C: float, least: float
) -> float:
    """Factor on the recipe's beam power with which the molten pool stays as large as on the plate.

    Where conduction decides, the place at which a moving beam brings material to its melting point
    stays where it is if absorbed power goes with the rise from what it finds to that point
    (D. Rosenthal, Trans. ASME 68 (1946) 849-866): (melting - found) / (melting - plate).

    found_C : (n,) temperatures of a layer's places before its first bead; NaN where not known
    melting_C : of the layer's mixture; plate_C : of the plate at the start, for which the recipe is
    least : factor at which power stops falling
    Returns a factor from `least` to 1: power is never raised.
    """
    known_C = found_C[np.isfinite(found_C)]
    if not len(known_C):
        return 1.0
    return float(np.clip((melting_C - known_C.mean()) / (melting_C - plate_C), least, 1.0))
