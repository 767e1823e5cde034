"""Properties of a mixture from volume fractions, by named rules of micromechanics.

Every rule is written for any number of materials and for complex fractions, so that derivatives by
a complex step are exact. n materials; fractions have them along the last axis.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray

#: Real or complex: (..., n) fractions in, (...) values out.
Array = NDArray[Any]

ElasticRule = Literal["voigt", "reuss", "mori-tanaka", "tamura"]
ConductionRule = Literal["voigt", "reuss", "maxwell-eucken"]


def voigt_mean(fractions: Array, values: FloatArray) -> Array:
    """Equal strain: Σ Vᵢ xᵢ, the upper bound of a modulus.

    Source: Voigt, Lehrbuch der Kristallphysik (1928).
    """
    return fractions @ values


def reuss_mean(fractions: Array, values: FloatArray) -> Array:
    """Equal stress: 1 / Σ (Vᵢ / xᵢ), the lower bound of a modulus.

    Source: Reuss, Z. angew. Math. Mech. 9 (1929) 49-58.
    """
    return np.asarray(1.0 / (fractions @ (1.0 / values)))


def mori_tanaka_moduli(
    fractions: Array, bulk: FloatArray, shear: FloatArray, matrix: int
) -> tuple[Array, Array]:
    """Bulk and shear modulus of spheres of the other materials in one that is the matrix.

    Source: Mori and Tanaka, Acta Metall. 21 (1973) 571-574, in the form of Benveniste, Mech. Mater.
    6 (1987) 147-157: moduli weighted by Vᵢ times the dilute strain concentration.
    """
    bulk_share, shear_share = _sphere_concentrations(bulk, shear, matrix)
    return (fractions @ (bulk * bulk_share) / (fractions @ bulk_share),
            fractions @ (shear * shear_share) / (fractions @ shear_share))


def _sphere_concentrations(
    bulk: FloatArray, shear: FloatArray, matrix: int
) -> tuple[FloatArray, FloatArray]:
    """Dilute strain concentration of each material as a sphere in the matrix, (n,) each."""
    k, g = bulk[matrix], shear[matrix]
    k_star = 4.0 * g / 3.0
    g_star = g * (9.0 * k + 8.0 * g) / (6.0 * (k + 2.0 * g))
    return (k + k_star) / (bulk + k_star), (g + g_star) / (shear + g_star)


def tamura_modulus(fractions: Array, modulus: FloatArray, transfer_MPa: float) -> Array:
    """Elastic modulus by the rule of Tamura, Tomota and Ozawa.

    transfer_MPa : q, ratio of the differences of stress and strain between the materials; 0 is
        equal stress (Reuss), very large is equal strain (Voigt)
    Source: Tamura, Tomota and Ozawa, Proc. 3rd Int. Conf. Strength of Metals and Alloys, Cambridge
    (1973) vol. 1, 611-615. Two materials there; for more, the same with Σ over all of them.
    """
    share = 1.0 / (transfer_MPa + modulus)
    return np.asarray(fractions @ (modulus * share) / (fractions @ share))


def maxwell_eucken_conductivity(
    fractions: Array, conductivity: FloatArray, matrix: int
) -> Array:
    """Thermal conductivity of spheres of the other materials in the matrix.

    Source: Maxwell, Treatise on Electricity and Magnetism (1873) art. 314; Eucken, VDI
    Forschungsheft 353 (1932).
    """
    share = 3.0 * conductivity[matrix] / (2.0 * conductivity[matrix] + conductivity)
    return np.asarray(fractions @ (conductivity * share) / (fractions @ share))


def levin_expansion(
    fractions: Array, expansion: FloatArray, bulk: FloatArray, effective_bulk: Array
) -> Array:
    """Expansion of two materials from the bulk modulus of their mixture, which is exact.

    Source: Levin, Mech. Solids 2 (1967) 58-61.
    """
    compliance = 1.0 / bulk
    mean_compliance, mean_expansion = fractions @ compliance, fractions @ expansion
    difference = compliance[1] - compliance[0]
    if abs(difference) < 1e-12 * compliance.max():
        return mean_expansion  # equal stiffness: nothing constrains anything
    slope = (expansion[1] - expansion[0]) / difference
    return np.asarray(mean_expansion + slope * (1.0 / effective_bulk - mean_compliance))


def concentrated_expansion(
    fractions: Array, expansion: FloatArray, stress_share: Array
) -> Array:
    """Expansion of any number of materials: Σ Vᵢ bᵢ αᵢ, b the share of stress that each takes.

    stress_share : (..., n) or (n,), any common factor
    Source: Levin, Mech. Solids 2 (1967) 58-61, its general form; Rosen and Hashin, Int. J. Eng.
    Sci. 8 (1970) 157-173.
    """
    weight = fractions * stress_share
    return np.asarray((weight @ expansion) / weight.sum(axis=-1))


def sphere_stress_shares(bulk: FloatArray, shear: FloatArray, matrix: int) -> FloatArray:
    """Hydrostatic stress each material takes, as a sphere in the matrix, to a common factor."""
    return np.asarray(bulk * _sphere_concentrations(bulk, shear, matrix)[0])
