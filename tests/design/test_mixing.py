"""Mixing rules against bounds, limits and one another."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lmctl.config.material_constants import MATERIAL_CONSTANTS, find_constants
from lmctl.config.materials import MATERIAL_LIBRARY
from lmctl.config.part_file import MaterialSettings
from lmctl.design.effective_properties import (
    MixingRules,
    effective_properties,
    property_slopes,
)
from lmctl.design.mixing import concentrated_expansion, sphere_stress_shares, tamura_modulus
from lmctl.design.phases import PhaseConstants, phase_constants
from lmctl.errors import ConfigError

PAIR = phase_constants((MaterialSettings(name="316L"), MaterialSettings(name="WC-12Co")))
THREE = phase_constants(tuple(MaterialSettings(name=n) for n in ("Al", "ZrO2", "Cu")))
RULES = ("voigt", "reuss", "mori-tanaka", "tamura")


def bulk_of(phases: PhaseConstants, fractions: np.ndarray, rules: MixingRules) -> np.ndarray:
    found = effective_properties(fractions, phases, rules, "solid")
    return found.lame_MPa + 2 / 3 * found.shear_MPa


@pytest.mark.parametrize("elastic", RULES)
@pytest.mark.parametrize("phases", [PAIR, THREE], ids=["two", "three"])
def test_a_pure_material_keeps_its_own_constants(phases: PhaseConstants, elastic: str) -> None:
    pure = np.eye(len(phases.names))
    found = effective_properties(pure, phases, MixingRules(elastic=elastic), "solid")
    np.testing.assert_allclose(found.elastic_modulus_MPa, phases.elastic_modulus_MPa, rtol=1e-12)
    np.testing.assert_allclose(found.conductivity_W_mm_K, phases.conductivity_W_mm_K, rtol=1e-12)
    np.testing.assert_allclose(
        found.thermal_stress_MPa_K, 3 * phases.bulk_MPa * phases.expansion_1_K, rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.01, 1), min_size=3, max_size=3))
def test_every_rule_lies_between_reuss_and_voigt(parts: list[float]) -> None:
    share = np.array([parts]) / sum(parts)
    low, high = (bulk_of(THREE, share, MixingRules(elastic=r)) for r in ("reuss", "voigt"))
    middle = bulk_of(THREE, share, MixingRules(elastic="mori-tanaka"))
    assert low[0] * (1 - 1e-12) <= middle[0] <= high[0] * (1 + 1e-12)
    modulus = tamura_modulus(share, THREE.elastic_modulus_MPa, 1e4)
    ends = [tamura_modulus(share, THREE.elastic_modulus_MPa, q) for q in (0.0, 1e12)]
    assert ends[0] <= modulus <= ends[1]


def test_mori_tanaka_is_the_hashin_shtrikman_bound_of_its_matrix() -> None:
    """Hashin and Shtrikman, J. Mech. Phys. Solids 11 (1963) 127-140, Eqs. 4.1 and 4.2."""
    v = np.linspace(0, 1, 11)
    k, g = PAIR.bulk_MPa, PAIR.shear_MPa
    for matrix in (0, 1):
        other = 1 - matrix
        found = bulk_of(PAIR, np.stack([1 - v, v], axis=1),
                        MixingRules(elastic="mori-tanaka", matrix=matrix))
        f = v if matrix == 0 else 1 - v
        with np.errstate(divide="ignore"):
            bound = k[matrix] + f / (
                1 / (k[other] - k[matrix]) + 3 * (1 - f) / (3 * k[matrix] + 4 * g[matrix]))
        np.testing.assert_allclose(found, bound, rtol=1e-12)


def test_tamura_ends_in_reuss_and_voigt_of_the_modulus() -> None:
    share, e = np.array([[0.3, 0.7]]), PAIR.elastic_modulus_MPa
    assert tamura_modulus(share, e, 0.0)[0] == pytest.approx(1 / (0.3 / e[0] + 0.7 / e[1]))
    assert tamura_modulus(share, e, 1e15)[0] == pytest.approx(0.3 * e[0] + 0.7 * e[1])


@pytest.mark.parametrize("elastic", ["voigt", "reuss", "mori-tanaka"])
def test_levins_exact_expansion_is_the_general_form_for_two_materials(elastic: str) -> None:
    v = np.linspace(0.05, 0.95, 7)
    share = np.stack([1 - v, v], axis=1)
    found = effective_properties(share, PAIR, MixingRules(elastic=elastic), "solid")
    bulk = found.lame_MPa + 2 / 3 * found.shear_MPa
    taken = {"voigt": PAIR.bulk_MPa, "reuss": np.ones(2),
             "mori-tanaka": sphere_stress_shares(PAIR.bulk_MPa, PAIR.shear_MPa, 0)}[elastic]
    general = concentrated_expansion(share, PAIR.expansion_1_K, taken)
    np.testing.assert_allclose(found.thermal_stress_MPa_K / (3 * bulk), general, rtol=1e-10)


def test_maxwell_eucken_is_exact_for_dilute_spheres() -> None:
    """Maxwell, art. 314: k/k0 = 1 + 3 v (k1 - k0)/(k1 + 2 k0) for v -> 0."""
    v, k = 1e-6, PAIR.conductivity_W_mm_K
    found = effective_properties(np.array([[1 - v, v]]), PAIR, MixingRules(), "solid")
    slope = (found.conductivity_W_mm_K[0] / k[0] - 1) / v
    assert slope == pytest.approx(3 * (k[1] - k[0]) / (k[1] + 2 * k[0]), rel=1e-4)


@pytest.mark.parametrize("elastic", RULES)
@pytest.mark.parametrize("kind", ["solid", "plane-stress"])
def test_slopes_are_those_of_central_differences(elastic: str, kind: str) -> None:
    share, step = np.array([[0.2, 0.5, 0.3], [0.6, 0.1, 0.3]]), 1e-6
    rules = MixingRules(elastic=elastic, matrix=1)
    for number, slope in enumerate(property_slopes(share, THREE, rules, kind)):
        high, low = share.copy(), share.copy()
        high[:, number] += step
        low[:, number] -= step
        ends = [effective_properties(x, THREE, rules, kind) for x in (high, low)]
        for name in ("lame_MPa", "shear_MPa", "thermal_stress_MPa_K", "conductivity_W_mm_K"):
            expected = (getattr(ends[0], name) - getattr(ends[1], name)) / (2 * step)
            np.testing.assert_allclose(getattr(slope, name), expected, rtol=1e-6)


def test_constants_are_of_library_materials_and_have_a_source() -> None:
    assert set(MATERIAL_CONSTANTS) <= set(MATERIAL_LIBRARY)
    assert find_constants("wc-12co") is MATERIAL_CONSTANTS["WC-12Co"]
    for name, constants in MATERIAL_CONSTANTS.items():
        assert constants.source, name
        assert 60 < constants.elastic_modulus_GPa < 800, name
        assert 0.1 < constants.poisson_ratio < 0.45, name
        assert 2 < constants.expansion_1e6_K < 25, name


def test_missing_constants_are_all_named() -> None:
    own = MaterialSettings(name="mine", density_g_cm3=5, elastic_modulus_GPa=100)
    with pytest.raises(ConfigError) as caught:
        phase_constants((own, MaterialSettings(name="NiCrBSi")))
    text = caught.value.render()
    assert "material[1].poisson_ratio" in text
    assert "material[1].elastic_modulus_GPa" not in text
    assert "material[2].elastic_modulus_GPa" in text


def test_a_part_files_own_constants_count_before_the_librarys() -> None:
    found = phase_constants((MaterialSettings(name="316L", elastic_modulus_GPa=150),))
    assert found.elastic_modulus_MPa[0] == 150e3
    assert found.poisson_ratio[0] == 0.30
    assert "the part file" in found.sources[0]
