"""Physical constants of library materials at room temperature: elasticity, heat, strength.

Handbook values of the dense, wrought or sintered material. A deposit has others, by a few per cent
for stiffness and much more for strength: a part file may state its own, which then count.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class MaterialConstants:
    """What a simulation of the part in service or of its build needs of one dense material.

    elastic_modulus_GPa, poisson_ratio : of isotropic elasticity
    conductivity_W_m_K : thermal conductivity
    expansion_1e6_K : linear thermal expansion, in millionths per kelvin
    strength_MPa : yield strength of metals; flexural or transverse rupture strength of ceramics and
        cemented carbides
    heat_capacity_J_kg_K : specific heat capacity
    melting_C : where all of it is molten; of cemented carbides the binder alone, which melts as the
        eutectic with its carbide
    Heat capacity and melting point are usual values, not checked against `source`.
    source : of the other values
    """

    elastic_modulus_GPa: float
    poisson_ratio: float
    conductivity_W_m_K: float
    expansion_1e6_K: float
    strength_MPa: float
    heat_capacity_J_kg_K: float
    melting_C: float
    source: str


_ASM1 = "ASM Handbook vol. 1, Irons, Steels and High-Performance Alloys (1990)"
_HASTELLOY = "Haynes International, Hastelloy X, H-3009"
_ASM2 = "ASM Handbook vol. 2, Nonferrous Alloys and Special-Purpose Materials (1990)"
_HARD = "Brookes, World Directory and Handbook of Hardmetals, 6th ed. (1996)"
_CERAMIC = "Munro, J. Am. Ceram. Soc. 80 (1997) 1919-1928; CRC Materials Science Handbook (2001)"
_SHACKELFORD = "Shackelford and Alexander, CRC Materials Science and Engineering Handbook (2001)"
_REDDY = "Praveen and Reddy, Int. J. Solids Struct. 35 (1998) 4457-4476, Table 1"

_TABLE: tuple[tuple[str, float, float, float, float, float, float, float, str], ...] = (
    ("316L", 193, 0.30, 14.6, 16.0, 205, 500, 1400, _ASM1),
    ("304L", 193, 0.29, 16.2, 17.2, 205, 500, 1450, _ASM1),
    ("H13", 210, 0.30, 24.4, 11.0, 1400, 460, 1480, _ASM1),
    ("steel", 207, 0.29, 50.0, 12.0, 250, 486, 1520, _ASM1),
    ("4340", 205, 0.29, 44.5, 12.3, 860, 475, 1500, _ASM1),
    ("maraging", 186, 0.30, 20.9, 10.1, 1900, 460, 1450, _ASM1),
    ("Fe", 208, 0.29, 80.4, 11.8, 130, 449, 1538, _ASM1),
    ("IN625", 208, 0.28, 9.8, 12.8, 450, 410, 1350, "Special Metals, Inconel alloy 625, SMC-063"),
    ("IN718", 200, 0.29, 11.4, 13.0, 1030, 435, 1336, "Special Metals, Inconel alloy 718, SMC-045"),
    ("Hastelloy X", 205, 0.32, 9.1, 13.9, 360, 486, 1355, _HASTELLOY),
    ("Ni", 207, 0.31, 90.9, 13.3, 150, 444, 1455, _ASM2),
    ("Stellite 6", 209, 0.29, 14.8, 11.4, 700, 420, 1410, _ASM2),
    ("Stellite 21", 240, 0.29, 14.5, 11.0, 565, 420, 1440, _ASM2),
    ("CoCrMo", 230, 0.30, 13.0, 12.5, 500, 450, 1450, _ASM2),
    ("Ti-6Al-4V", 113.8, 0.342, 6.7, 8.6, 880, 526, 1660, _ASM2),
    ("CP-Ti", 103, 0.34, 16.4, 8.6, 275, 523, 1668, _ASM2),
    ("V", 127.6, 0.37, 30.7, 8.4, 310, 489, 1910, _ASM2),
    ("Cr", 279, 0.21, 93.9, 4.9, 280, 449, 1907, _SHACKELFORD),
    ("Nb", 103, 0.40, 53.7, 7.3, 105, 265, 2477, _ASM2),
    ("Cu", 117, 0.34, 391, 16.9, 69, 385, 1085, _ASM2),
    ("Al", 70, 0.30, 204, 23.0, 35, 900, 660, _REDDY),
    ("AlSi10Mg", 71, 0.33, 130, 20.5, 170, 910, 596, _ASM2),
    ("WC", 696, 0.19, 110, 5.2, 600, 203, 2785, _SHACKELFORD),
    ("WC-12Co", 560, 0.22, 75, 5.6, 2900, 220, 1320, _HARD),
    ("WC-17Co", 510, 0.23, 67, 6.3, 2800, 235, 1320, _HARD),
    ("WC-6Co", 630, 0.21, 90, 4.9, 2000, 210, 1320, _HARD),
    ("TiC", 440, 0.19, 21, 7.7, 500, 560, 3070, _SHACKELFORD),
    ("Cr3C2", 380, 0.28, 19, 10.3, 400, 550, 1810, _SHACKELFORD),
    ("Al2O3", 400, 0.231, 33, 6.5, 380, 775, 2054, _CERAMIC),
    ("8YSZ", 205, 0.31, 2.2, 10.5, 300, 450, 2700, _SHACKELFORD),
    ("ZrO2", 151, 0.30, 2.09, 10.0, 500, 450, 2715, _REDDY),
)

#: Constants by the library's name of the material; a few powders have none that we know.
MATERIAL_CONSTANTS = MappingProxyType(
    {name: MaterialConstants(*values) for name, *values in _TABLE}  # type: ignore[arg-type]
)


def find_constants(name: str) -> MaterialConstants | None:
    """The constants of a library material, case ignored; None where none are known."""
    folded = {known.casefold(): constants for known, constants in MATERIAL_CONSTANTS.items()}
    return folded.get(name.casefold())
