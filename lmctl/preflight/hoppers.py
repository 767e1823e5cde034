"""Which hopper of a machine feeds which material."""

from __future__ import annotations

from lmctl.config.machine import HopperSettings, MachineProfile
from lmctl.errors import PlanError


def hopper_for_material(material: str, profile: MachineProfile) -> HopperSettings:
    """The first hopper that holds a material. Raises PlanError where none does."""
    for hopper in profile.hopper:
        if hopper.material == material:
            return hopper
    filled = ", ".join(f"{h.name}: {h.material}" for h in profile.hopper)
    raise PlanError(
        f"no hopper of {profile.name!r} holds {material}", where=f"its hoppers: {filled}",
        hint="fill a hopper with it and say so in the machine profile, or rename the material",
    )
