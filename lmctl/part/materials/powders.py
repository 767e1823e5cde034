"""The part's powders with every value settled: its own, else the process's, else the library's."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.config import materials as library
from lmctl.config.part_file import MaterialSettings, PartFile

#: Middle of what coaxial nozzles catch of metal powder (docs/explanation/powder-delivery.md,
#: Volume, mass and catch: 0.4–0.85).
UNKNOWN_CATCH_EFFICIENCY = 0.65


@dataclass(frozen=True)
class MaterialSpec:
    """One powder as planning uses it.

    density_g_mm3 : of the solid; apparent_g_mm3 : of the loose powder, None where unknown
    catch_efficiency : share of the fed powder that ends in the bead, (0, 1]
    power_W, speed_mm_s : recipe of the pure material
    defaults : values that the part file does not state, each as text with the value
    """

    name: str
    density_g_mm3: float
    apparent_g_mm3: float | None
    catch_efficiency: float
    power_W: float
    speed_mm_s: float
    defaults: tuple[str, ...]

    def note(self) -> str:
        """One line that names the defaults, "" where there are none."""
        return f"{self.name}: by default {', '.join(self.defaults)}" if self.defaults else ""


def resolve_materials(part: PartFile) -> tuple[MaterialSpec, ...]:
    """Every material of a checked part file with all values settled.

    Power and speed: the material's own, else what `[process]` states explicitly, else the
    library's, else the process's default. A material without density is one the library has
    (part_rules).
    """
    return tuple(_resolve(material, part) for material in part.material)


def _resolve(material: MaterialSettings, part: PartFile) -> MaterialSpec:
    known = library.find_material(material.name)
    defaults: list[str] = []

    def settle(
        key: str, said: str, from_library: float | None, otherwise: float | None
    ) -> float:
        own: float | None = getattr(material, key)
        if own is not None:
            return own
        if key in part.process.model_fields_set:
            return float(getattr(part.process, key))
        value = from_library if from_library is not None else otherwise
        assert value is not None, key
        defaults.append(said.format(f"{value:g}"))
        return value

    library_density = known.density_g_cm3 if known else None
    density = settle("density_g_cm3", "density {} g/cm³", library_density, None)
    apparent = material.apparent_g_cm3 or (known.apparent_g_cm3 if known else None)
    library_catch = known.catch_efficiency if known else None
    catch = settle(
        "catch_efficiency", "catch efficiency {}", library_catch, UNKNOWN_CATCH_EFFICIENCY
    )
    library_power = known.power_W if known else None
    power = settle("power_W", "power {} W", library_power, part.process.power_W)
    library_speed = known.speed_mm_s if known else None
    speed = settle("speed_mm_s", "speed {} mm/s", library_speed, part.process.speed_mm_s)
    return MaterialSpec(
        name=material.name,
        density_g_mm3=density / 1000.0,
        apparent_g_mm3=None if apparent is None else apparent / 1000.0,
        catch_efficiency=catch,
        power_W=power,
        speed_mm_s=speed,
        defaults=tuple(defaults),
    )
