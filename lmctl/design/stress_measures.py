"""Scalars of a stress tensor, and how they change with its components.

Stresses are (..., 6) float64 [MPa] in the order xx, yy, zz, xy, yz, xz.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from lmctl.array_types import FloatArray

StressMeasure = Literal[
    "von-mises", "tresca", "largest-principal", "xx", "yy", "zz", "xy", "yz", "xz"]
STRESS_MEASURES: tuple[StressMeasure, ...] = get_args(StressMeasure)
STRESS_COMPONENTS = ("xx", "yy", "zz", "xy", "yz", "xz")

#: Off-diagonal components count twice in a product of symmetric tensors.
_DOUBLED = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def stress_measure(stress: FloatArray, measure: StressMeasure) -> FloatArray:
    """A scalar of the stress, (...) [MPa].

    "tresca" is the difference of the largest and the smallest principal stress.
    """
    if measure in STRESS_COMPONENTS:
        return np.asarray(stress[..., STRESS_COMPONENTS.index(measure)])
    if measure == "von-mises":
        deviator = _deviator(stress)
        return np.asarray(np.sqrt(1.5 * (deviator**2 @ _DOUBLED)))
    principal = np.linalg.eigvalsh(as_tensor(stress))
    if measure == "tresca":
        return np.asarray(principal[..., 2] - principal[..., 0])
    return np.asarray(principal[..., 2])


def stress_measure_slopes(stress: FloatArray, measure: StressMeasure) -> FloatArray:
    """Derivatives of a measure by the six components, (..., 6)."""
    if measure in STRESS_COMPONENTS:
        found = np.zeros_like(stress)
        found[..., STRESS_COMPONENTS.index(measure)] = 1.0
        return found
    if measure == "von-mises":
        deviator = _deviator(stress)
        size = np.maximum(stress_measure(stress, measure), 1e-300)
        return np.asarray(1.5 * deviator * _DOUBLED / size[..., None])
    _, ways = np.linalg.eigh(as_tensor(stress))
    largest = _dyad(ways[..., 2])
    return largest - _dyad(ways[..., 0]) if measure == "tresca" else largest


def as_tensor(stress: FloatArray) -> FloatArray:
    """(..., 3, 3) of (..., 6)."""
    return np.asarray(stress[..., np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])])


def _deviator(stress: FloatArray) -> FloatArray:
    found = stress.copy()
    found[..., :3] -= stress[..., :3].mean(axis=-1, keepdims=True)
    return found


def _dyad(way: FloatArray) -> FloatArray:
    """Derivatives of a principal stress along a direction (..., 3)."""
    i, j = np.array([0, 1, 2, 0, 1, 0]), np.array([0, 1, 2, 1, 2, 2])
    return np.asarray(way[..., i] * way[..., j] * _DOUBLED)
