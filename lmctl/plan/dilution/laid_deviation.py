"""Where a layer could not be deposited as designed, and by how much: for the layer above it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray

#: A deviation of every fraction by less than this is none.
_LEAST_FRACTION = 1e-3


@dataclass(frozen=True)
class LaidDeviation:
    """Deviation of one layer's deposit from the part's composition.

    layer : its number
    points_mm : (n, 2) vertices of its tracks; fractions : (n, k) the deviation there
    """

    layer: int
    points_mm: FloatArray
    fractions: FloatArray

    @classmethod
    def of_layer(
        cls, layer: int, points_mm: FloatArray, fractions: FloatArray
    ) -> LaidDeviation | None:
        """The deviation of a layer; None where there is none worth carrying."""
        if np.abs(fractions).max(initial=0.0) < _LEAST_FRACTION:
            return None
        return cls(layer, points_mm, fractions)

    def at(self, points_mm: FloatArray) -> FloatArray:
        """The deviation under places (q, 2): that of the nearest vertex, (q, k)."""
        from scipy.spatial import cKDTree  # late: most layers deviate nowhere

        _, nearest = cKDTree(self.points_mm).query(points_mm)
        return np.asarray(self.fractions[nearest])
