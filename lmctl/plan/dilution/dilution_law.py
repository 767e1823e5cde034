"""Dilution δ of a mixture against its energy per length, with an interval.

Each powder has a straight line through its measurements, weighted by their intervals; it is not
carried on beyond the energies measured. A mixture's δ lies between those of its powders by volume
fraction; a powder without any takes the mean of the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import BoolArray, FloatArray
from lmctl.config.dilution import MAX_DILUTION, DilutionSettings

#: Half of a 95 % interval, in standard errors.
_HALF_WIDTH_ERRORS = 1.96
#: Weight of a statement without an interval, as a standard error [share].
_UNKNOWN_ERROR = 0.02
#: Energies nearer to each other than this, as a ratio, make no line.
_SAME_ENERGY = 0.02
#: Energies as far apart as this, as a ratio, say how dilution follows them.
_WIDE_ENERGIES = 2.0


@dataclass(frozen=True)
class DilutionAlong:
    """share, low, high : (n,) float64 in [0, MAX_DILUTION], the interval of 95 %; low and high are
        the share itself where no interval is known
    outside : (n,) bool, the energy is beyond those measured by more than a tenth
    """

    share: FloatArray
    low: FloatArray
    high: FloatArray
    outside: BoolArray


@dataclass(frozen=True)
class _PowderLine:
    """share = at + slope · (energy − middle_J_mm) within lowest_J_mm and highest_J_mm.

    at_error, slope_error : standard errors, independent of each other
    """

    middle_J_mm: float
    at: float
    slope: float
    at_error: float
    slope_error: float
    lowest_J_mm: float
    highest_J_mm: float


@dataclass(frozen=True)
class DilutionLaw:
    """lines : of each of the part's materials, in their order"""

    lines: tuple[_PowderLine, ...]

    @property
    def follows_energy(self) -> bool:
        """Whether it is known how dilution follows the energy per length, of every powder."""
        return all(line.highest_J_mm < np.inf and
                   line.highest_J_mm >= _WIDE_ENERGIES * line.lowest_J_mm for line in self.lines)

    def along(self, fractions: FloatArray, energy_J_mm: FloatArray) -> DilutionAlong:
        """The dilution of mixtures (n, materials) at energies per length (n,)."""
        share = np.zeros(len(energy_J_mm))
        half = np.zeros(len(energy_J_mm))
        outside: BoolArray = np.zeros(len(energy_J_mm), dtype=np.bool_)
        for line, part in zip(self.lines, fractions.T, strict=True):
            inside = np.clip(energy_J_mm, line.lowest_J_mm, line.highest_J_mm)
            off = inside - line.middle_J_mm
            share += part * (line.at + line.slope * off)
            # Errors of different powders add up: one analysis is behind all of them.
            half += part * _HALF_WIDTH_ERRORS * np.hypot(line.at_error, line.slope_error * off)
            outside |= np.abs(energy_J_mm - inside) > 0.1 * inside
        share = np.clip(share, 0.0, MAX_DILUTION)
        return DilutionAlong(share, np.clip(share - half, 0.0, None),
                             np.clip(share + half, None, MAX_DILUTION), outside)


def dilution_law(
    stated: Sequence[DilutionSettings], materials: Sequence[str]
) -> DilutionLaw | None:
    """The law of a part's materials; None where nothing is stated for any of them."""
    known: dict[str, _PowderLine] = {}
    for material in materials:
        own = [one for one in stated if one.material == material] or [
            one for one in stated if one.material is None]
        if own:
            known[material] = _line(own)
    if not known:
        return None
    mean = _mean(tuple(known.values()))
    return DilutionLaw(tuple(known.get(material, mean) for material in materials))


def _line(stated: Sequence[DilutionSettings]) -> _PowderLine:
    """Weighted least squares."""
    share = np.array([one.share for one in stated])
    error = np.array([one.half_width / _HALF_WIDTH_ERRORS for one in stated])
    is_known = error > 0
    weight = 1.0 / np.where(is_known, error, _UNKNOWN_ERROR) ** 2
    energies = [one.energy_J_mm for one in stated]
    if energies[0] is None:  # the only one, at any energy
        return _PowderLine(0.0, float(share[0]), 0.0, float(error[0]), 0.0, 0.0, np.inf)
    energy = np.array(energies, dtype=np.float64)
    middle, at = (float(np.average(values, weights=weight)) for values in (energy, share))
    at_error = float(weight.sum() ** -0.5) if is_known.all() else 0.0
    slope = slope_error = 0.0
    if np.ptp(energy) > _SAME_ENERGY * middle:
        spread = float((weight * (energy - middle) ** 2).sum())
        slope = float((weight * (energy - middle) * share).sum()) / spread
        slope_error = spread**-0.5 if is_known.all() else 0.0
    return _PowderLine(middle, at, slope, at_error, slope_error, float(energy.min()),
                       float(energy.max()))


def _mean(lines: tuple[_PowderLine, ...]) -> _PowderLine:
    """The mean of several powders, for one that was not tested."""
    middle, at, slope, at_error, slope_error = np.mean(
        [(line.middle_J_mm, line.at, line.slope, line.at_error, line.slope_error)
         for line in lines], axis=0).tolist()
    return _PowderLine(middle, at, slope, at_error, slope_error,
                       min(line.lowest_J_mm for line in lines),
                       max(line.highest_J_mm for line in lines))
