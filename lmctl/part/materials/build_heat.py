"""Thermal constants of a part's powders and of the plate under it, every value settled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.deposition_heat_rules import DEFAULT_PLATE
from lmctl.config.material_constants import find_constants
from lmctl.config.materials import find_material
from lmctl.config.part_file import MaterialSettings, PartFile

#: Gas, powder and surroundings [°C].
AMBIENT_C = 20.0


@dataclass(frozen=True)
class PlateHeat:
    """The plate a part is deposited on, and what surrounds both.

    at_C : plate and table at the start, and the table for good
    conductivity_W_mm_K, capacity_J_mm3_K : of the plate
    contact_W_mm2_K : between plate and table, 0 where insulated
    loss_W_mm2_K : of free surfaces; ambient_C : of gas, powder and surroundings
    """

    at_C: float
    thickness_mm: float
    conductivity_W_mm_K: float
    capacity_J_mm3_K: float
    contact_W_mm2_K: float
    loss_W_mm2_K: float
    ambient_C: float

    @property
    def diffusivity_mm2_s(self) -> float:
        """Conductivity over capacity."""
        return self.conductivity_W_mm_K / self.capacity_J_mm3_K


@dataclass(frozen=True, eq=False)
class BuildHeat:
    """Of m powders, in the part's order, (m,) float64 each; and the plate.

    melting_C : None where beam power does not follow temperature
    Constants do not change with temperature. Those of a mixture are means by volume.
    """

    conductivity_W_mm_K: FloatArray
    capacity_J_mm3_K: FloatArray
    absorptivity: FloatArray
    plate: PlateHeat
    melting_C: FloatArray | None = None

    @property
    def diffusivity_mm2_s(self) -> FloatArray:
        """Conductivity over capacity, (m,)."""
        return np.asarray(self.conductivity_W_mm_K / self.capacity_J_mm3_K)


def resolve_build_heat(part: PartFile) -> BuildHeat | None:
    """The constants of a checked part file: its own, else the library's; None where no temperature
    is limited."""
    process, plate = part.process, part.substrate
    if process.interpass_max_C is None:
        return None
    alloy = plate.material or DEFAULT_PLATE
    of_plate = next((one for one in part.material if one.name == alloy),
                    MaterialSettings(name=alloy))
    of_powders = np.array([_constants(material) for material in part.material])
    conductivity, capacity, _ = _constants(of_plate)
    return BuildHeat(of_powders[:, 0], of_powders[:, 1], of_powders[:, 2], PlateHeat(
        at_C=plate.temperature_C, thickness_mm=plate.thickness_mm,
        conductivity_W_mm_K=conductivity, capacity_J_mm3_K=capacity,
        contact_W_mm2_K=plate.contact_W_m2_K * 1e-6,
        loss_W_mm2_K=process.surface_loss_W_m2_K * 1e-6, ambient_C=AMBIENT_C),
        np.array([_melting_C(material) for material in part.material])
        if process.power_follows_temperature else None)


def _constants(material: MaterialSettings) -> tuple[float, float, float]:
    """Conductivity [W/(mm K)], heat capacity by volume [J/(mm³ K)], absorptivity; checked before
    (`deposition_heat_rules`)."""
    constants, powder = find_constants(material.name), find_material(material.name)
    conductivity = material.conductivity_W_m_K or (
        constants.conductivity_W_m_K if constants else 0.0)
    heat = material.heat_capacity_J_kg_K or (constants.heat_capacity_J_kg_K if constants else 0.0)
    density = material.density_g_cm3 or (powder.density_g_cm3 if powder else 0.0)
    absorptivity = material.absorptivity or (powder.absorptivity if powder else 0.0)
    return conductivity * 1e-3, density * heat * 1e-6, absorptivity


def _melting_C(material: MaterialSettings) -> float:
    constants = find_constants(material.name)
    return material.melting_C or (constants.melting_C if constants else 0.0)
