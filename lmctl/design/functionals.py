"""Numbers that an optimisation minimises or limits: norms and largest values of a solution."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.performance_model import PerformanceModel, PerformanceSolution
from lmctl.design.stress_measures import (
    STRESS_MEASURES,
    StressMeasure,
    stress_measure,
    stress_measure_slopes,
)

#: p of the norm that stands for the largest value while it is searched.
PEAK_NORM = 30.0

#: How sharply the largest value of a constraint is smoothed: it is met with a few per cent spare.
_PEAK_SHARPNESS = 300.0

#: A stress of one material counts where its fraction is well above this, and nowhere without it.
_PRESENT_FRACTION = 0.05


@dataclass(frozen=True)
class Quantity:
    """What is measured of a solution.

    name : a stress measure, "utilisation", "temperature", "mass", "cost" or "fraction"
    norm : p of the norm over the volume; None is a bound of the largest value, from above
    scale : size of the quantity, > 0, for None; sign : −1 bounds the smallest value from below
    material : number of the material, of a fraction; or of a stress, where alone it counts
    reference_C : what temperatures are counted from in a norm
    """

    name: str
    norm: float | None = PEAK_NORM
    scale: float = 1.0
    sign: float = 1.0
    material: int | None = None
    reference_C: float = 0.0


@dataclass(eq=False)
class Partials:
    """Derivatives of a value by the fields, each per volume at the places of integration.

    stress : (n_elements, q, 6); temperature, density, price, strength : (n_elements, q)
    fractions : (n_elements, q, n_materials)
    """

    value: float
    stress: FloatArray | None = None
    temperature: FloatArray | None = None
    density: FloatArray | None = None
    price: FloatArray | None = None
    strength: FloatArray | None = None
    fractions: dict[int, FloatArray] = field(default_factory=dict)


def evaluate(
    model: PerformanceModel, solution: PerformanceSolution, quantity: Quantity
) -> Partials:
    """The value of a quantity and its partial derivatives."""
    weights = model.discretisation.weights
    if quantity.name == "mass":
        density = solution.properties.density_g_mm3
        return Partials(float((weights * density).sum()), density=np.ones_like(weights))
    if quantity.name == "cost":
        price = solution.properties.price_per_mm3
        return Partials(float((weights * price).sum()), price=np.ones_like(weights))
    local = _local_values(model, solution, quantity)
    present = np.ones_like(weights)
    if quantity.material is not None and quantity.name != "fraction":
        present = -np.expm1(-solution.fractions[..., quantity.material] / _PRESENT_FRACTION)
    value, slope = aggregate(local * present, weights, quantity)
    found = Partials(value)
    if quantity.material is not None and quantity.name != "fraction":
        found.fractions[quantity.material] = slope * local * (1.0 - present) / _PRESENT_FRACTION
    slope = slope * present
    if quantity.name == "fraction":
        assert quantity.material is not None
        found.fractions[quantity.material] = slope
    elif quantity.name == "temperature":
        found.temperature = slope
    elif quantity.name == "utilisation":
        strength = solution.properties.strength_MPa
        slopes = stress_measure_slopes(solution.stress_MPa, "von-mises")
        found.stress = slopes * (slope / strength)[..., None]
        found.strength = -slope * local / strength
    else:
        slopes = stress_measure_slopes(solution.stress_MPa, _measure(quantity.name))
        found.stress = slopes * slope[..., None]
    return found


def _local_values(
    model: PerformanceModel, solution: PerformanceSolution, quantity: Quantity
) -> FloatArray:
    if quantity.name == "temperature":
        warm = model.discretisation.at_places(solution.temperature_C)
        return warm - (quantity.reference_C if quantity.norm is not None else 0.0)
    if quantity.name == "fraction":
        return solution.fractions[..., quantity.material or 0]
    if quantity.name == "utilisation":
        return np.asarray(stress_measure(solution.stress_MPa, "von-mises")
                          / solution.properties.strength_MPa)
    return stress_measure(solution.stress_MPa, _measure(quantity.name))


def aggregate(
    local: FloatArray, weights: FloatArray, quantity: Quantity
) -> tuple[float, FloatArray]:
    """One value of local ones, with its slopes by them, per weight."""
    if quantity.norm is None:
        sharpness = _PEAK_SHARPNESS / quantity.scale
        signed = quantity.sign * local
        most = float(signed.max())
        term = np.exp(sharpness * (signed - most))
        total = float(term.sum())
        value = most + float(np.log(total)) / sharpness
        return quantity.sign * value, term / total / weights
    p = quantity.norm
    positive = np.maximum(local, 0.0)
    top = max(float(positive.max()), 1e-300)
    relative = (positive / top) ** p
    volume = float(weights.sum())
    mean = max(float((weights * relative).sum()) / volume, 1e-300)
    value = top * mean ** (1.0 / p)
    factor = value / mean / volume
    return value, factor * (positive / top) ** (p - 1.0) / top


def _measure(name: str) -> StressMeasure:
    return next(measure for measure in STRESS_MEASURES if measure == name)
