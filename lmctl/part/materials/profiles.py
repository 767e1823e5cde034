"""The mixture at each distance from a feature; every row sums to 1.

Source: docs/explanation/multi-colour-distance-field.md, Material field.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lmctl.array_types import FloatArray


class MixtureProfile(Protocol):
    """The mixture at each distance."""

    def fractions(self, distance: FloatArray) -> FloatArray:
        """distance (n,) [mm] -> (n, n_materials) float64, each ≥ 0, rows summing to 1"""

    @property
    def changing_range_mm(self) -> tuple[float, float]:
        """Between which distances the mixture changes; equal where it never does."""


@dataclass(frozen=True, eq=False)
class PowerLawProfile:
    """near · (1 − f) + far · f with f = (a·d)^k clamped to [0, 1]; k = 1 is linear.

    Source: Zhou et al. 2009, Eq. (4).

    d runs from 0 at over_mm[0] to 1 at over_mm[1], clamped; near, far : (n_materials,)
    """

    near: FloatArray
    far: FloatArray
    over_mm: tuple[float, float]
    a: float = 1.0
    k: float = 1.0

    def fractions(self, distance: FloatArray) -> FloatArray:
        start, end = self.over_mm
        d = np.clip((distance - start) / (end - start), 0.0, 1.0)
        f = np.clip((self.a * d) ** self.k, 0.0, 1.0)[:, None]
        return normalise_rows(self.near * (1.0 - f) + self.far * f)

    @property
    def changing_range_mm(self) -> tuple[float, float]:
        return self.over_mm


@dataclass(frozen=True, eq=False)
class TabulatedProfile:
    """Mixtures at rising distances, linear between, constant beyond; one row is a constant.

    at_mm : (k,) strictly rising; mixtures : (k, n_materials)
    """

    at_mm: FloatArray
    mixtures: FloatArray

    def fractions(self, distance: FloatArray) -> FloatArray:
        columns = [np.interp(distance, self.at_mm, column) for column in self.mixtures.T]
        return normalise_rows(np.stack(columns, axis=1))

    @property
    def changing_range_mm(self) -> tuple[float, float]:
        return float(self.at_mm[0]), float(self.at_mm[-1])


@dataclass(frozen=True, eq=False)
class SteppedProfile:
    """Mixtures that change at once.

    ends_mm : (k,) rising, where all but the last end
    mixtures : (k + 1, n_materials)
    """

    ends_mm: FloatArray
    mixtures: FloatArray

    def fractions(self, distance: FloatArray) -> FloatArray:
        return normalise_rows(self.mixtures[np.searchsorted(self.ends_mm, distance, side="right")])

    @property
    def changing_range_mm(self) -> tuple[float, float]:
        if len(self.ends_mm) == 0:
            return 0.0, 0.0
        return float(self.ends_mm[0]), float(self.ends_mm[-1])


def normalise_rows(fractions: FloatArray) -> FloatArray:
    """Rows without the −1e-17 that interpolation leaves, made to sum to 1."""
    positive = np.maximum(fractions, 0.0)
    total = positive[:, 0].copy()
    for column in positive.T[1:]:  # few columns: much faster than sums of short rows
        total += column
    return np.asarray(positive / total[:, None], dtype=np.float64)
