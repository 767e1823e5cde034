"""Smooth nodal fields of a solution, and an estimate of the error of its discretisation.

Strains of quadratic elements jump from one to the next; the recovered ones are the averages at the
nodes. Strains, not stresses, are averaged, because the stiffness may jump where strains do not. The
difference between recovered and computed stresses estimates the error (Zienkiewicz and Zhu, Int. J.
Numer. Methods Eng. 24 (1987) 337-357).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.design.discretisation import full_stress, strain_operator
from lmctl.design.effective_properties import effective_properties
from lmctl.design.performance_model import (
    CompositionFunction,
    PerformanceModel,
    PerformanceSolution,
)


@dataclass(frozen=True, eq=False)
class RecoveredFields:
    """Fields at the nodes.

    fractions : (n_nodes, n_materials); temperature_C : (n_nodes,)
    displacement_mm : (n_nodes, dim); stress_MPa : (n_nodes, 6)
    stress_error_MPa : (n_nodes,), estimated size of the error of a stress there
    strength_MPa : (n_nodes,), of the mixture
    relative_error : estimated error in the energy norm, as a share of the solution's
    """

    fractions: FloatArray
    temperature_C: FloatArray
    displacement_mm: FloatArray
    stress_MPa: FloatArray
    stress_error_MPa: FloatArray
    strength_MPa: FloatArray
    relative_error: float


def recover_fields(
    model: PerformanceModel, solution: PerformanceSolution, composition: CompositionFunction
) -> RecoveredFields:
    """The nodal fields of a solution of `composition`."""
    d, space = model.discretisation, model.space
    node_strain = _strains_at_nodes(model, solution.displacement_mm)
    volume = d.weights.sum(axis=1)
    weight = np.broadcast_to(np.abs(volume)[:, None], d.element_nodes.shape)
    total = d.add_up(weight)
    mean = np.stack([d.add_up(weight * node_strain[..., k]) / total
                     for k in range(node_strain.shape[2])], axis=1)
    fractions = composition(space.part_points(d.nodes_mm))
    properties = effective_properties(fractions, model.phases, model.rules, space.kind)
    warming = solution.temperature_C - model.conditions.stress_free_C
    stress = full_stress(space, mean, properties, warming)
    smooth = np.einsum("qa,eas->eqs", d.shapes, mean[d.element_nodes])
    difference = full_stress(space, smooth - solution.strain, solution.properties,
                             np.zeros(d.weights.shape))
    modulus = solution.properties.elastic_modulus_MPa
    energy = (solution.stress_MPa**2).sum(axis=2) / modulus
    wrong = (difference**2).sum(axis=2) / modulus
    relative = np.sqrt((wrong * d.weights).sum() / max((energy * d.weights).sum(), 1e-300))
    of_element = np.sqrt((difference**2).sum(axis=2).mean(axis=1))
    error = d.add_up(weight * of_element[:, None]) / total
    return RecoveredFields(
        fractions, solution.temperature_C, solution.displacement_mm, stress, error,
        properties.strength_MPa, float(relative))


def _strains_at_nodes(model: PerformanceModel, displacement: FloatArray) -> FloatArray:
    """(n_elements, a, strains): each element's own strains at its nodes.

    On the axis of a turned part the hoop strain takes its limit, the radial one.
    """
    d, space = model.discretisation, model.space
    mesh = d.fitted.mesh
    dim = space.dim
    corners = np.concatenate([np.zeros((dim, 1)), np.eye(dim)], axis=1)
    order = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))[: 3 if dim == 2 else 6]
    local = np.concatenate(
        [corners] + [0.5 * (corners[:, [a]] + corners[:, [b]]) for a, b in order], axis=1)
    shapes = np.stack([np.asarray(d.element.lbasis(local, k)[0]) for k in range(len(local.T))])
    by_local = np.stack([np.asarray(d.element.lbasis(local, k)[1]) for k in range(len(local.T))])
    found = []
    for rows in d.blocks():
        nodes = d.nodes_mm[d.element_nodes[rows]]
        jacobian = np.einsum("kjp,eki->epij", by_local, nodes, optimize=True)
        inverse = np.linalg.inv(jacobian)
        slopes = np.einsum("kjp,epji->epki", by_local, inverse, optimize=True)
        b = strain_operator(space, slopes, shapes.T, nodes)
        of = displacement[d.element_nodes[rows]].reshape(len(nodes), 1, -1, 1)
        strain = (b @ of)[..., 0]
        if space.kind == "axisymmetric":
            on_axis = nodes[..., 0] < 1e-9 * float(np.abs(mesh.p).max())
            strain[..., 1] = np.where(on_axis, strain[..., 0], strain[..., 1])
        found.append(strain)
    return np.concatenate(found)
