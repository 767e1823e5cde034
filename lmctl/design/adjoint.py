"""Gradients of values of a solution by the volume fractions at every place, by adjoint solutions.

The equilibrium Σ w Bᵀ σ = F and the heat balance are multiplied by adjoint fields, which one
solution each of the same matrices gives; then no derivative of the fields themselves is needed
(Tortorelli and Michaleris, Inverse Problems in Eng. 1 (1994) 71-105).
"""

from __future__ import annotations

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.discretisation import apply_elasticity
from lmctl.design.effective_properties import property_slopes
from lmctl.design.functionals import Partials
from lmctl.design.model_space import STRAIN_ROWS, STRESSED_AXES
from lmctl.design.performance_model import PerformanceModel, PerformanceSolution


def fraction_gradient(
    model: PerformanceModel, solution: PerformanceSolution, partials: Partials
) -> FloatArray:
    """Derivatives of a value by the fractions, (n_elements, q, n_materials), weights included.

    The model's solvers must be those of this solution: it was the last one solved.
    """
    by_property = _property_gradient(model, solution, partials)
    slopes = property_slopes(solution.fractions, model.phases, model.rules, model.space.kind)
    columns = []
    for number, slope in enumerate(slopes):
        column = sum(
            (values * getattr(slope, name) for name, values in by_property.items()),
            start=np.zeros_like(model.discretisation.weights))
        if number in partials.fractions:
            column = column + partials.fractions[number]
        columns.append(column)
    return np.stack(columns, axis=2) * model.discretisation.weights[..., None]


def _property_gradient(
    model: PerformanceModel, solution: PerformanceSolution, partials: Partials
) -> dict[str, FloatArray]:
    """Derivatives per volume by each property, by its name."""
    found: dict[str, FloatArray] = {}
    for name, values in (("density_g_mm3", partials.density), ("price_per_mm3", partials.price),
                         ("strength_MPa", partials.strength)):
        if values is not None:
            found[name] = values
    heat = partials.temperature
    if partials.stress is not None:
        heat_of_stress = _elastic_gradient(model, solution, partials.stress, found)
        heat = heat_of_stress if heat is None else heat + heat_of_stress
    if heat is not None and model.conditions.has_heat_problem:
        assert model.heat_solver is not None, "there is a heat problem"
        d = model.discretisation
        adjoint = model.heat_solver.solve(d.spread(heat)[:, None])[:, 0]
        found["conductivity_W_mm_K"] = -(
            d.slopes_of(adjoint) * d.slopes_of(solution.temperature_C)).sum(axis=2)
    return found


def _elastic_gradient(
    model: PerformanceModel, solution: PerformanceSolution, by_stress: FloatArray,
    found: dict[str, FloatArray],
) -> FloatArray:
    """Adds derivatives by the elastic properties; returns that by the temperature, per volume."""
    d, space, properties = model.discretisation, model.space, solution.properties
    rows = list(STRAIN_ROWS[space.kind])
    normal = [k for k, row in enumerate(rows) if row < 3]
    shear = [k for k, row in enumerate(rows) if row >= 3]
    direct = by_stress[..., rows]
    across = by_stress[..., 2] if space.kind == "plane-strain" else np.zeros(d.weights.shape)
    by_strain = apply_elasticity(space, direct, properties.lame_MPa, properties.shear_MPa)
    by_strain[..., normal] += (properties.lame_MPa * across)[..., None]
    assert model.elastic_solver is not None, "the model has been solved"
    adjoint = model.elastic_solver.solve(d.strain_load(by_strain))
    virtual = direct - d.strains(adjoint)
    strain = solution.strain
    trace = strain[..., normal].sum(axis=2)
    found["lame_MPa"] = trace * (virtual[..., normal].sum(axis=2) + across)
    found["shear_MPa"] = (2.0 * (virtual[..., normal] * strain[..., normal]).sum(axis=2)
                          + (virtual[..., shear] * strain[..., shear]).sum(axis=2))
    active = [k for k, row in enumerate(rows) if row in STRESSED_AXES[space.kind]]
    loaded = virtual[..., active].sum(axis=2) + across
    warming = d.at_places(solution.temperature_C) - model.conditions.stress_free_C
    found["thermal_stress_MPa_K"] = -warming * loaded
    return np.asarray(-properties.thermal_stress_MPa_K * loaded)
