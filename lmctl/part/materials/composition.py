"""Composition of a part: rules of bodies, blends of features, and rules in a boolean.

Fractions are volume fractions in the order of the part's materials; every mixture that a rule
gives is non-negative and sums to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.part.materials.profiles import MixtureProfile, normalise_rows

if TYPE_CHECKING:
    from lmctl.part.bodies.body import Body
    from lmctl.part.bodies.transformed import SimilarityTransform
    from lmctl.part.booleans.overlap import OverlapWeights
    from lmctl.part.materials.features import Feature


class CompositionField(Protocol):
    """Composition of a body."""

    def fractions(self, points: FloatArray) -> FloatArray:
        """points (n, 3) float64 [mm] -> (n, n_materials) float64, each ≥ 0, rows summing to 1"""


@dataclass(frozen=True)
class GradedComposition:
    """A profile over the distance to a feature."""

    feature: Feature
    profile: MixtureProfile

    def fractions(self, points: FloatArray) -> FloatArray:
        return self.profile.fractions(self.feature.distance(points))


@dataclass(frozen=True)
class BlendedComposition:
    """(6)-(8): Σ wᵢ f(rᵢ) with Σ wᵢ = 1.

    weights : constants that sum to 1, or None for 1/rᵢ^power; on a feature (rᵢ = 0) it alone counts
    """

    parts: tuple[GradedComposition, ...]
    weights: tuple[float, ...] | None
    power: float = 1.0

    def fractions(self, points: FloatArray) -> FloatArray:
        distances = np.stack([part.feature.distance(points) for part in self.parts])
        shares = self._shares(np.abs(distances))
        mixed = sum(
            share[:, None] * part.profile.fractions(distance)
            for share, part, distance in zip(shares, self.parts, distances, strict=True)
        )
        return normalise_rows(np.asarray(mixed))

    def _shares(self, distances: FloatArray) -> FloatArray:
        if self.weights is not None:
            return np.repeat(np.array(self.weights)[:, None], distances.shape[1], axis=1)
        return inverse_distance_weights(distances, self.power)


def inverse_distance_weights(distances: FloatArray, power: float) -> FloatArray:
    """(1/rᵢ^p)/Σ(1/r^p) by columns, (k, n) -> (k, n); where some rᵢ are 0 they share alone."""
    least = distances.min(axis=0)
    relative = least / np.where(distances > 0, distances, 1.0)  # ≤ 1, so no power overflows
    shares = np.where(least > 0, relative**power, distances == 0)
    return np.asarray(shares / shares.sum(axis=0))


@dataclass(frozen=True)
class UniformComposition:
    """One mixture everywhere. mixture : (n_materials,)"""

    mixture: tuple[float, ...]

    def fractions(self, points: FloatArray) -> FloatArray:
        return np.tile(np.array(self.mixture), (len(points), 1))


@dataclass(frozen=True)
class TransformedComposition:
    """The rule of a body that was moved: it goes with the body."""

    rule: CompositionField
    transform: SimilarityTransform

    def fractions(self, points: FloatArray) -> FloatArray:
        return self.rule.fractions(self.transform.invert(points))


@dataclass(frozen=True)
class OverlapComposition:
    """What a union or intersection is of: each body's own material where it is alone, and where
    several overlap a mixture that passes from one to the other
    (docs/explanation/multi-colour-distance-field.md, Booleans).

    Where A and B overlap, A's share is rA/(rA + rB), r being the distance to the piece of a body's
    surface that lies in the other. On L2, where B begins to be alone, rA is 0; on L1 rB is. So the
    mixture is continuous across both, with no gap and no overlap. Where a body lies wholly in the
    other its piece of surface is all of it.
    """

    bodies: tuple[Body, ...]
    rules: tuple[CompositionField, ...]
    overlap: OverlapWeights

    def fractions(self, points: FloatArray) -> FloatArray:
        shares = self.overlap.weights(points)
        mixed: FloatArray | None = None
        for rule, share in zip(self.rules, shares, strict=True):
            own = np.flatnonzero(share > 0)
            if len(own) == 0:
                continue
            found = rule.fractions(points[own])
            if mixed is None:
                mixed = np.zeros((len(points), found.shape[1]))
            mixed[own] += share[own, None] * found
        assert mixed is not None, "shares sum to 1"
        return normalise_rows(mixed)


