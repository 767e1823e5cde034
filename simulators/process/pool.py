"""Width of the bead and dilution, from beam power and speed."""

from __future__ import annotations

import numpy as np

from simulators.array_types import FloatArray
from simulators.process.config import MAX_DILUTION, ProcessConfig

#: A pool is neither narrower nor wider than so many times the bead of the reference.
_WIDTH_RANGE = (0.25, 4.0)


def bead_width_mm(config: ProcessConfig, power_W: FloatArray, speed_mm_s: FloatArray) -> FloatArray:
    """Width at each power and speed, (n,) each, both above 0."""
    factor = (power_W / config.power_W) ** config.width_power_exponent * (
        config.speed_mm_s / speed_mm_s) ** config.width_speed_exponent
    return np.asarray(config.bead_width_mm * np.clip(factor, *_WIDTH_RANGE))


def dilution(config: ProcessConfig, power_W: FloatArray, speed_mm_s: FloatArray) -> FloatArray:
    """Share of the pool that is melted from below, (n,), at each power and speed."""
    energy_J_mm = power_W / speed_mm_s
    over_J_mm = energy_J_mm - config.power_W / config.speed_mm_s
    found = config.dilution + config.dilution_per_J_mm * over_J_mm
    return np.asarray(np.clip(found, 0.0, MAX_DILUTION))
