"""Least, mean and greatest of a quantity, gathered bit by bit and joined over runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray


@dataclass(frozen=True)
class ValueRange:
    """weight : what the mean is weighted by, seconds or millimetres; greater than 0"""

    least: float
    mean: float
    greatest: float
    weight: float

    def joined_with(self, other: ValueRange) -> ValueRange:
        """Of both together."""
        weight = self.weight + other.weight
        mean = (self.mean * self.weight + other.mean * other.weight) / weight
        return ValueRange(min(self.least, other.least), mean, max(self.greatest, other.greatest),
                          weight)


def range_of(values: FloatArray, weights: FloatArray) -> ValueRange | None:
    """Of (n,) values with (n,) weights; what is NaN or weighs nothing is left out.

    None where nothing is left.
    """
    use = np.isfinite(values) & (weights > 0)
    if not use.any():
        return None
    known, weight = values[use], weights[use]
    total = float(weight.sum())
    return ValueRange(float(known.min()), float(known @ weight) / total, float(known.max()), total)


def joined_ranges(one: dict[str, ValueRange], other: dict[str, ValueRange]) -> dict[
    str, ValueRange
]:
    """Of two sets of named quantities, those of one name joined."""
    return {
        name: one[name].joined_with(other[name]) if name in one and name in other
        else one.get(name) or other[name]
        for name in {**one, **other}
    }
