"""Check, before planning, whether this part can be made on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.errors import LmctlError, PlanError
from lmctl.part.copies import bounds_of_copies_mm
from lmctl.preflight.hoppers import hopper_for_material
from lmctl.preflight.placement import Placement, place_part

if TYPE_CHECKING:
    from lmctl.part.part import Part


def check_part(part: Part, profile: MachineProfile) -> Placement:
    """Placement of the part. Reports all problems at once.

    Raises PlanError: alloy rules that cannot be kept, a material without a hopper, a part outside
    the machine's travel, a recipe beyond the laser's power or the axes' speed, a part without
    layers.
    """
    wrong: list[LmctlError] = []
    for material in part.materials:
        try:
            hopper_for_material(material.name, profile)
        except PlanError as error:
            wrong.append(error)
        power_W = material.power_W * max(1.0, part.process.first_layer_power)
        if power_W > profile.laser.max_power_W:
            wrong.append(PlanError(
                f"{material.name} wants {power_W:g} W; the laser of {profile.name!r} "
                f"has {profile.laser.max_power_W:g}",
                hint="lower the material's power_W, with its speed_mm_s",
            ))
        fastest = min(profile.motion.max_speed_mm_s[:2])
        if material.speed_mm_s > fastest:
            wrong.append(PlanError(
                f"{material.name} wants {material.speed_mm_s:g} mm/s; the axes of "
                f"{profile.name!r} reach {fastest:g}",
                hint="lower the material's speed_mm_s, with its power_W",
            ))
    if part.alloy_rules is not None and part.laid_mixtures is not None:
        from lmctl.preflight.alloy_check import alloy_problems  # late: most parts have no rules

        shares = [one.share for one in profile.dilution if one.material is None
                  or one.material in part.laid_mixtures.rules.materials]
        ignored = part.process.dilution == "ignore" or not shares
        wrong += alloy_problems(part.laid_mixtures, 0.0 if ignored else min(shares))
    placement = place_part(part, profile)
    outside = _outside(part, placement, profile)
    if part.layer_stack is not None:
        from lmctl.preflight.substrate_check import substrate_findings  # late: few parts have one

        wrong += substrate_findings(part.layer_stack, placement, profile)
    if part.copies:
        from lmctl.preflight.copies_check import copies_findings  # late, as above

        wrong += copies_findings(part, placement, profile)
    if outside:
        wrong.append(PlanError(
            f"{part.name} reaches outside the travel of {profile.name!r}", where=outside,
            hint="move it with [placement] in the part file, turn it, or take a larger machine",
        ))
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise PlanError(
            f"{part.name} cannot be made on {profile.name!r}: {len(wrong)} things are in the way",
            where=[text for e in wrong for text in (e.what, *(f"  {place}" for place in e.where))],
            hint="mend them and check again with `lmctl check`",
        )
    return placement


def _outside(part: Part, placement: Placement, profile: MachineProfile) -> list[str]:
    """One line an axis in which the part, or a copy of it, leaves the travel."""
    travel = profile.motion.travel_mm
    bottom = placement.nozzle_height_mm(0)
    top = placement.nozzle_height_mm(placement.n_layers - 1)
    if part.layer_stack is not None:
        z_mm = float(placement.offset_mm[2])
        bottom = part.layer_stack.lowest_mm(bottom - z_mm) + z_mm
        top = part.layer_stack.highest_mm(top - z_mm) + z_mm
    top += profile.motion.clearance_mm
    found = []
    for name, low, high in _boxes(part):
        low, high = low + placement.offset_mm, high + placement.offset_mm
        spans = {"x": (low[0], high[0], travel.x), "y": (low[1], high[1], travel.y)}
        found += [f"{name}{axis}: needs {a:.1f} to {b:.1f} mm, has {limits[0]:g} to {limits[1]:g}"
                  for axis, (a, b, limits) in spans.items() if a < limits[0] or b > limits[1]]
    if bottom < travel.z[0] or top > travel.z[1]:
        found.append(f"z: needs {bottom:.1f} to {top:.1f} mm, has {travel.z[0]:g} to "
                     f"{travel.z[1]:g} (clearance above the part included)")
    return found


def _boxes(part: Part) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Each copy's name and box, (3,) each; of a part without copies its own, without a name."""
    if not part.copies:
        yield "", *bounds_of_copies_mm(part)
    for copy in part.copies:
        yield f"{copy.name!r}, ", *bounds_of_copies_mm(replace(part, copies=(copy,)))
