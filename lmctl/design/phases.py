"""The constants of the materials a part is mixed of, as arrays in the part's order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.material_constants import find_constants
from lmctl.config.materials import find_material
from lmctl.config.part_file import MaterialSettings
from lmctl.errors import ConfigError, Finding

#: Keys of a material that a simulation needs, and their factor to N, mm, K.
_SCALE = {
    "elastic_modulus_GPa": 1e3,
    "poisson_ratio": 1.0,
    "conductivity_W_m_K": 1e-3,
    "expansion_1e6_K": 1e-6,
    "strength_MPa": 1.0,
}


@dataclass(frozen=True, eq=False)
class PhaseConstants:
    """Isotropic constants of m materials; every array is (m,) float64.

    elastic_modulus_MPa > 0, poisson_ratio in [0, 0.5), conductivity_W_mm_K > 0, expansion_1_K,
    density_g_mm3 > 0, strength_MPa > 0, price_per_g ≥ 0
    sources : one line a material: where its values are from
    """

    names: tuple[str, ...]
    elastic_modulus_MPa: FloatArray
    poisson_ratio: FloatArray
    conductivity_W_mm_K: FloatArray
    expansion_1_K: FloatArray
    density_g_mm3: FloatArray
    strength_MPa: FloatArray
    price_per_g: FloatArray
    sources: tuple[str, ...] = ()

    @property
    def bulk_MPa(self) -> FloatArray:
        """K = E / (3 (1 − 2ν))"""
        return np.asarray(self.elastic_modulus_MPa / (3.0 * (1.0 - 2.0 * self.poisson_ratio)))

    @property
    def shear_MPa(self) -> FloatArray:
        """G = E / (2 (1 + ν))"""
        return np.asarray(self.elastic_modulus_MPa / (2.0 * (1.0 + self.poisson_ratio)))


def phase_constants(materials: tuple[MaterialSettings, ...]) -> PhaseConstants:
    """The constants of a part's materials: their own values, else the library's.

    Raises ConfigError that names every value that neither states.
    """
    findings: list[Finding] = []
    columns: dict[str, list[float]] = {key: [] for key in _SCALE}
    densities, sources = [], []
    for number, material in enumerate(materials, start=1):
        known, library = find_constants(material.name), find_material(material.name)
        own = [key for key in _SCALE if getattr(material, key) is not None]
        for key, scale in _SCALE.items():
            value = getattr(material, key)
            if value is None and known is not None:
                value = getattr(known, key)
            if value is None:
                findings.append(Finding(
                    f"material[{number}].{key}",
                    f"is missing, and the library has no {key} of {material.name!r}"))
            columns[key].append(scale * (np.nan if value is None else float(value)))
        density = material.density_g_cm3 or (library.density_g_cm3 if library else np.nan)
        densities.append(density / 1e3)
        stated = [f"{', '.join(own)}: the part file"] if own else []
        if known is not None and len(own) < len(_SCALE):
            stated.append(f"the rest: {known.source}" if own else known.source)
        sources.append(f"{material.name}: {'; '.join(stated)}")
    if findings:
        raise ConfigError("the part cannot be simulated: constants of materials are missing",
                          findings=findings, hint="add them to the [[material]] table")
    prices = [(material.price_per_kg or 0.0) / 1e3 for material in materials]
    return PhaseConstants(
        names=tuple(material.name for material in materials),
        elastic_modulus_MPa=np.array(columns["elastic_modulus_GPa"]),
        poisson_ratio=np.array(columns["poisson_ratio"]),
        conductivity_W_mm_K=np.array(columns["conductivity_W_m_K"]),
        expansion_1_K=np.array(columns["expansion_1e6_K"]),
        density_g_mm3=np.array(densities), strength_MPa=np.array(columns["strength_MPa"]),
        price_per_g=np.array(prices), sources=tuple(sources))
