"""Steady heat and linear thermo-elasticity of a part whose composition varies within elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csr_array, csr_matrix

from lmctl.array_types import FloatArray
from lmctl.design.conditions import ModelConditions
from lmctl.design.discretisation import Discretisation, full_stress
from lmctl.design.effective_properties import (
    EffectiveProperties,
    MixingRules,
    effective_properties,
)
from lmctl.design.linear_solver import FieldSolver, linear_interpolation
from lmctl.design.model_space import STRAIN_ROWS, STRESSED_AXES, ModelSpace
from lmctl.design.phases import PhaseConstants

#: Volume fractions (n, n_materials) at places in the part (n, 3) [mm].
CompositionFunction = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class PerformanceSolution:
    """The fields of a solved model.

    fractions : (n_elements, q, n_materials); properties : at the same places
    temperature_C : (n_nodes,); displacement_mm : (n_nodes, dim)
    strain : (n_elements, q, strains), shears as engineering strains
    stress_MPa : (n_elements, q, 6), xx, yy, zz, xy, yz, xz
    """

    fractions: FloatArray
    properties: EffectiveProperties
    temperature_C: FloatArray
    displacement_mm: FloatArray
    strain: FloatArray
    stress_MPa: FloatArray


class PerformanceModel:
    """A discretised part with its loads; solved for any composition.

    conditions : checked by the caller (`ModelConditions.check`)
    """

    def __init__(
        self, conditions: ModelConditions, phases: PhaseConstants, rules: MixingRules
    ) -> None:
        self.conditions, self.phases, self.rules = conditions, phases, rules
        self.heat_solver: FieldSolver | None = None
        self.elastic_solver: FieldSolver | None = None
        # Where iterations begin: designs that follow one another are near to each other.
        self._displacement: FloatArray | None = None
        self._temperatures: FloatArray | None = None

    @property
    def discretisation(self) -> Discretisation:
        """The elements it is solved on."""
        return self.conditions.discretisation

    @property
    def space(self) -> ModelSpace:
        """The space it is solved in."""
        return self.discretisation.space

    def fractions_of(self, composition: CompositionFunction) -> FloatArray:
        """A composition where properties are wanted, (n_elements, q, n_materials)."""
        d = self.discretisation
        return composition(d.part_places_mm).reshape(*d.weights.shape, -1)

    def solve(self, fractions: FloatArray) -> PerformanceSolution:
        """The fields for volume fractions (n_elements, q, n_materials).

        The solvers stay, for adjoint loads of the same matrix.
        """
        d, conditions = self.discretisation, self.conditions
        self.heat_solver = self.elastic_solver = None  # gives the memory of the last ones back
        properties = effective_properties(fractions, self.phases, self.rules, self.space.kind)
        temperature = self._temperature(properties)
        warming = d.at_places(temperature) - conditions.stress_free_C
        load = conditions.force_N + d.strain_load(self.thermal_stress(properties, warming))
        self.elastic_solver = FieldSolver(
            d.stiffness_matrix(properties), conditions.held, self.space.dim, self._linear,
            self.space.rigid_motions(d.nodes_mm))
        displacement = self.elastic_solver.solve(load, conditions.held_mm, self._displacement)
        self._displacement = displacement
        strain = d.strains(displacement)
        stress = full_stress(self.space, strain, properties, warming)
        return PerformanceSolution(fractions, properties, temperature, displacement, strain, stress)

    def forget_guesses(self) -> None:
        """Begin the iterations of the next solution at nothing."""
        self._displacement = self._temperatures = None

    def thermal_stress(self, properties: EffectiveProperties, warming_K: FloatArray) -> FloatArray:
        """What a body that cannot expand feels, in the rows of the strains, pressure positive."""
        rows = STRAIN_ROWS[self.space.kind]
        active = np.array([float(row in STRESSED_AXES[self.space.kind]) for row in rows])
        return np.asarray((properties.thermal_stress_MPa_K * warming_K)[..., None] * active)

    def _temperature(self, properties: EffectiveProperties) -> FloatArray:
        d, conditions = self.discretisation, self.conditions
        if not conditions.has_heat_problem:
            return np.full(d.n_nodes, conditions.uniform_C)
        matrix = d.conduction_matrix(properties.conductivity_W_mm_K) + self._film_matrix
        load = conditions.heat_W + self._film_load
        self.heat_solver = FieldSolver(
            matrix, conditions.fixed_temperature[:, None], self.space.dim, self._linear,
            np.ones((d.n_nodes, 1, 1)))
        found = self.heat_solver.solve(load[:, None], conditions.fixed_C[:, None],
                                       self._temperatures)
        self._temperatures = found
        return found[:, 0]

    @cached_property
    def _linear(self) -> csr_matrix:
        d = self.discretisation
        return linear_interpolation(d.element_nodes, d.n_nodes, self.space.dim)

    @cached_property
    def _film_matrix(self) -> csr_array:
        n = self.discretisation.n_nodes
        found = csr_array((n, n))
        for exchange in self.conditions.exchanges:
            of = exchange.integrals
            local = np.einsum("fq,fqa,fqb->fab", exchange.film_W_mm2_K * of.weights, of.shapes,
                              of.shapes)
            a = of.nodes.shape[1]
            rows, columns = np.repeat(of.nodes, a, axis=1), np.tile(of.nodes, (1, a))
            found = found + coo_array((local.ravel(), (rows.ravel(), columns.ravel())),
                                      shape=(n, n)).tocsr()
        return found

    @cached_property
    def _film_load(self) -> FloatArray:
        load = np.zeros(self.discretisation.n_nodes)
        for exchange in self.conditions.exchanges:
            of = exchange.integrals
            density = exchange.film_W_mm2_K * exchange.ambient_C * of.weights
            local = np.einsum("fq,fqa->fa", density, of.shapes)
            load += np.bincount(of.nodes.ravel(), local.ravel(), len(load))
        return load
