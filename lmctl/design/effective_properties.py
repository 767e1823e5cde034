"""What the field equations need of a mixture, and how that changes with the volume fractions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.design.mixing import (
    ConductionRule,
    ElasticRule,
    concentrated_expansion,
    levin_expansion,
    maxwell_eucken_conductivity,
    mori_tanaka_moduli,
    reuss_mean,
    sphere_stress_shares,
    tamura_modulus,
    voigt_mean,
)
from lmctl.design.phases import PhaseConstants

ModelKind = Literal["plane-stress", "plane-strain", "axisymmetric", "solid"]

_COMPLEX_STEP = 1e-30


@dataclass(frozen=True)
class MixingRules:
    """By which rules the properties of mixtures are found.

    matrix : number of the material that surrounds the others (Mori-Tanaka, Maxwell-Eucken)
    transfer_GPa : q of the rule of Tamura
    """

    elastic: ElasticRule = "mori-tanaka"
    conduction: ConductionRule = "maxwell-eucken"
    matrix: int = 0
    transfer_GPa: float = 100.0


@dataclass(frozen=True, eq=False)
class EffectiveProperties:
    """Properties at places, each (...) float64.

    lame_MPa, shear_MPa : λ and G, for plane stress with the thickness strain eliminated
    thermal_stress_MPa_K : stress per kelvin of a body that cannot expand; likewise
    conductivity_W_mm_K, density_g_mm3, strength_MPa, price_per_mm3
    """

    lame_MPa: FloatArray
    shear_MPa: FloatArray
    thermal_stress_MPa_K: FloatArray
    conductivity_W_mm_K: FloatArray
    density_g_mm3: FloatArray
    strength_MPa: FloatArray
    price_per_mm3: FloatArray

    @property
    def elastic_modulus_MPa(self) -> FloatArray:
        """E of a solid with these λ and G (not of the reduced ones of plane stress)."""
        lame, shear = self.lame_MPa, self.shear_MPa
        return np.asarray(shear * (3.0 * lame + 2.0 * shear) / (lame + shear))


def effective_properties(
    fractions: FloatArray, phases: PhaseConstants, rules: MixingRules, kind: ModelKind
) -> EffectiveProperties:
    """Properties of mixtures.

    fractions : (..., n_materials) float64, rows summing to 1
    """
    return EffectiveProperties(*(np.ascontiguousarray(value.real)
                                 for value in _evaluate(fractions, phases, rules, kind)))


def property_slopes(
    fractions: FloatArray, phases: PhaseConstants, rules: MixingRules, kind: ModelKind
) -> tuple[EffectiveProperties, ...]:
    """Derivatives of the properties by the fraction of each material, the others held.

    returns : one EffectiveProperties a material
    """
    slopes = []
    for number in range(len(phases.names)):
        stepped = fractions.astype(complex)
        stepped[..., number] += 1j * _COMPLEX_STEP
        slopes.append(EffectiveProperties(*(
            np.ascontiguousarray(value.imag / _COMPLEX_STEP)
            for value in _evaluate(stepped, phases, rules, kind))))
    return tuple(slopes)


def _evaluate(
    fractions: NDArray[Any], phases: PhaseConstants, rules: MixingRules, kind: ModelKind
) -> tuple[NDArray[Any], ...]:
    bulk, shear, stress_share = _elastic(fractions, phases, rules)
    if len(phases.names) == 2:
        expansion = levin_expansion(fractions, phases.expansion_1_K, phases.bulk_MPa, bulk)
    else:
        expansion = concentrated_expansion(fractions, phases.expansion_1_K, stress_share)
    lame = bulk - 2.0 / 3.0 * shear
    thermal = 3.0 * bulk * expansion
    if kind == "plane-stress":
        reduction = 2.0 * shear / (lame + 2.0 * shear)
        lame, thermal = lame * reduction, thermal * reduction
    conduct = phases.conductivity_W_mm_K
    conductivity = (
        maxwell_eucken_conductivity(fractions, conduct, rules.matrix)
        if rules.conduction == "maxwell-eucken"
        else (voigt_mean if rules.conduction == "voigt" else reuss_mean)(fractions, conduct))
    return (lame, shear, thermal, conductivity,
            fractions @ phases.density_g_mm3, fractions @ phases.strength_MPa,
            fractions @ (phases.density_g_mm3 * phases.price_per_g))


def _elastic(
    fractions: NDArray[Any], phases: PhaseConstants, rules: MixingRules
) -> tuple[NDArray[Any], NDArray[Any], FloatArray]:
    """Bulk and shear modulus, and the share of hydrostatic stress that each material takes."""
    bulk, shear = phases.bulk_MPa, phases.shear_MPa
    if rules.elastic == "voigt":
        return voigt_mean(fractions, bulk), voigt_mean(fractions, shear), bulk
    if rules.elastic == "reuss":
        return reuss_mean(fractions, bulk), reuss_mean(fractions, shear), np.ones_like(bulk)
    if rules.elastic == "mori-tanaka":
        mixed = mori_tanaka_moduli(fractions, bulk, shear, rules.matrix)
        return *mixed, sphere_stress_shares(bulk, shear, rules.matrix)
    transfer = 1e3 * rules.transfer_GPa
    modulus = tamura_modulus(fractions, phases.elastic_modulus_MPa, transfer)
    poisson = voigt_mean(fractions, phases.poisson_ratio)
    share = phases.elastic_modulus_MPa / (transfer + phases.elastic_modulus_MPa)
    return modulus / (3.0 * (1.0 - 2.0 * poisson)), modulus / (2.0 * (1.0 + poisson)), share
