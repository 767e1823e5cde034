"""The material library: handbook values, each a default that a part file may replace.

Densities are from docs/explanation/process-defaults.md, Powders (handbook). Catch efficiencies,
powers and speeds are *starting values* for the medium DED class (2 mm bead,
docs/explanation/process-defaults.md, Process window), by kind of powder: they get a first bead onto
the bench and are no substitute for a trial track. lmctl reports which ones it used.

Absorptivities of titanium and nickel alloys were measured by calorimeter in powder deposition at
1 kW: 0.42 and 0.37 (F. Lia, J. Park, J. Tressler and R. Martukanitz, Additive Manufacturing 18
(2017) 31-39). Those of other kinds are of the same order: lower for good reflectors, higher
for carbides and oxides. They are starting values as well.
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class LibraryMaterial:
    """One powder of the library.

    density_g_cm3, apparent_g_cm3 : of the solid; of the loose powder, None where no value is known
    catch_efficiency : share of the fed powder that ends in the bead, (0, 1]
    power_W, speed_mm_s : starting recipe of the pure material
    absorptivity : share of the beam's power that stays in the part, (0, 1]
    """

    name: str
    density_g_cm3: float
    apparent_g_cm3: float | None
    catch_efficiency: float
    power_W: float
    speed_mm_s: float
    absorptivity: float


@dataclass(frozen=True)
class _Kind:
    """What powders of a kind share: (catch_efficiency, power_W, speed_mm_s, absorptivity)."""

    catch_efficiency: float
    power_W: float
    speed_mm_s: float
    absorptivity: float


# Reflective or conductive metals need more power; carbides and oxides rebound unmelted, so less of
# them is caught (docs/explanation/powder-delivery.md, Volume, mass and catch), and they are kept
# below the power at which they dissolve.
_STEEL = _Kind(0.75, 1500.0, 10.0, 0.37)
_NICKEL = _Kind(0.75, 1600.0, 10.0, 0.37)
_TITANIUM = _Kind(0.75, 1400.0, 10.0, 0.42)
_REFRACTORY = _Kind(0.70, 2200.0, 8.0, 0.37)
_COPPER = _Kind(0.65, 2500.0, 8.0, 0.15)
_ALUMINIUM = _Kind(0.60, 2000.0, 12.0, 0.20)
_CARBIDE = _Kind(0.55, 1800.0, 10.0, 0.50)
_OXIDE = _Kind(0.50, 1400.0, 10.0, 0.50)

_TABLE: tuple[tuple[str, float, float | None, _Kind], ...] = (
    ("316L", 7.99, 4.4, _STEEL),
    ("304L", 8.00, 4.4, _STEEL),
    ("H13", 7.80, 4.2, _STEEL),
    ("steel", 7.85, 4.3, _STEEL),
    ("4340", 7.85, 4.3, _STEEL),
    ("maraging", 8.10, 4.6, _STEEL),
    ("Fe", 7.87, 4.2, _STEEL),
    ("IN625", 8.44, 4.7, _NICKEL),
    ("IN718", 8.19, 4.5, _NICKEL),
    ("Hastelloy X", 8.22, 4.6, _NICKEL),
    ("NiCrBSi", 8.0, 4.3, _NICKEL),
    ("Ni", 8.90, 4.7, _NICKEL),
    ("Stellite 6", 8.44, 4.7, _NICKEL),
    ("Stellite 21", 8.33, 4.6, _NICKEL),
    ("CoCrMo", 8.30, 4.6, _NICKEL),
    ("Ti-6Al-4V", 4.43, 2.5, _TITANIUM),
    ("CP-Ti", 4.51, 2.5, _TITANIUM),
    ("V", 6.11, 3.2, _REFRACTORY),
    ("Cr", 7.19, 3.6, _REFRACTORY),
    ("Nb", 8.57, 4.7, _REFRACTORY),
    ("Cu", 8.96, 4.9, _COPPER),
    ("CuAl10", 7.6, 4.2, _COPPER),
    ("Al", 2.70, 1.4, _ALUMINIUM),
    ("AlSi10Mg", 2.67, 1.4, _ALUMINIUM),
    ("WC", 15.63, None, _CARBIDE),
    ("WC/W2C", 16.5, 8.5, _CARBIDE),
    ("WC-12Co", 14.3, 4.8, _CARBIDE),
    ("WC-17Co", 13.9, 4.6, _CARBIDE),
    ("WC-6Co", 14.9, None, _CARBIDE),
    ("TiC", 4.93, 2.2, _CARBIDE),
    ("Cr3C2", 6.68, 2.8, _CARBIDE),
    ("Al2O3", 3.97, 1.8, _OXIDE),
    ("8YSZ", 6.05, 2.3, _OXIDE),
    ("ZrO2", 5.7, 2.2, _OXIDE),
)

#: Every material lmctl knows, by name.
MATERIAL_LIBRARY = MappingProxyType(
    {
        name: LibraryMaterial(
            name, density, apparent, kind.catch_efficiency, kind.power_W, kind.speed_mm_s,
            kind.absorptivity,
        )
        for name, density, apparent, kind in _TABLE
    }
)


def find_material(name: str) -> LibraryMaterial | None:
    """The library's material of that name, case ignored; None where there is none."""
    if name in MATERIAL_LIBRARY:
        return MATERIAL_LIBRARY[name]
    folded = {known.casefold(): material for known, material in MATERIAL_LIBRARY.items()}
    return folded.get(name.casefold())


def suggest_name(name: str, known: list[str]) -> str:
    """ "did you mean …" for a name that is not among `known`, or "" where none is similar."""
    matches = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if not matches:
        folded = {candidate.casefold(): candidate for candidate in known}
        matches = [
            folded[match]
            for match in difflib.get_close_matches(name.casefold(), list(folded), n=1, cutoff=0.6)
        ]
    return f"did you mean {matches[0]!r}?" if matches else ""
