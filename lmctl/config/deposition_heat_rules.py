"""Mistakes about heat that concern several tables: a limit that cannot hold, missing constants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeGuard

from lmctl.config.material_constants import find_constants
from lmctl.config.materials import find_material
from lmctl.config.substrate import SubstrateSettings
from lmctl.errors import Finding

#: Alloy of a plate that the part file does not name.
DEFAULT_PLATE = "steel"


def deposition_heat_findings(data: dict[str, Any]) -> Iterator[Finding]:
    """Mistakes of a part file, as plain data of any shape, that limits its temperature."""
    process = data.get("process")
    process = process if isinstance(process, dict) else {}
    limit = process.get("interpass_max_C")
    follows = process.get("power_follows_temperature") is True
    if not _is_number(limit):
        if follows and limit is None:
            yield Finding("process.power_follows_temperature", "temperature is predicted only with "
                          "a limit: state process.interpass_max_C, too")
        return
    plate = data.get("substrate")
    plate = plate if isinstance(plate, dict) else {}
    plate_C = plate.get("temperature_C", SubstrateSettings.model_fields["temperature_C"].default)
    if _is_number(plate_C) and limit <= plate_C:
        yield Finding("process.interpass_max_C",
                      f"{limit:g} °C is not above the plate's temperature, {plate_C:g} °C "
                      "(substrate.temperature_C): no wait would be long enough")
    if process.get("copy_order") == "part-by-part":
        yield Finding("process.interpass_max_C", "is predicted layer by layer: not with "
                      'copy_order = "part-by-part"')
    if plate.get("kind", "plate") != "plate":
        yield Finding("process.interpass_max_C", "is predicted on a level plate: not on a "
                      "substrate with a shape of its own")
    tables = data.get("material")
    materials = [one for one in tables if isinstance(one, dict)] if isinstance(tables, list) else []
    for number, item in enumerate(materials, start=1):
        name = item.get("name")
        if not isinstance(name, str):
            continue
        for key in _missing(item, name, absorbs=True):
            yield Finding(f"material[{number}].{key}",
                          f"is missing, and the library has no {key} of {name!r}: "
                          "process.interpass_max_C needs it")
        if follows:
            yield from _melting_findings(f"material[{number}].melting_C", item, name, limit)
    alloy = plate.get("material") or DEFAULT_PLATE
    if isinstance(alloy, str):
        own = next((one for one in materials if one.get("name") == alloy), {})
        missing = list(_missing(own, alloy, absorbs=False))
        if missing:
            yield Finding("substrate.material",
                          f"the library has no {', '.join(missing)} of {alloy!r}, which "
                          "process.interpass_max_C needs: add a [[material]] table for it, or name "
                          f"a library material such as {DEFAULT_PLATE!r}")


def _melting_findings(
    path: str, item: dict[str, Any], name: str, limit_C: float
) -> Iterator[Finding]:
    """Of a powder whose melting point decides the beam's power."""
    constants = find_constants(name)
    melting_C = item.get("melting_C", constants.melting_C if constants else None)
    if melting_C is None:
        yield Finding(path, f"is missing, and the library has no melting_C of {name!r}: "
                      "process.power_follows_temperature needs it")
    elif _is_number(melting_C) and melting_C <= limit_C:
        yield Finding("process.interpass_max_C", f"{limit_C:g} °C is not below the melting point "
                      f"of {name!r}, {melting_C:g} °C: no power follows from such a temperature")


def _missing(item: dict[str, Any], name: str, *, absorbs: bool) -> Iterator[str]:
    """Keys that neither a material's table nor the library states."""
    constants, powder = find_constants(name), find_material(name)
    found = {"conductivity_W_m_K": constants, "heat_capacity_J_kg_K": constants,
             "density_g_cm3": powder, **({"absorptivity": powder} if absorbs else {})}
    yield from (key for key, library in found.items() if library is None and key not in item)


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
