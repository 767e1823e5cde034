"""What a job says of its substrate: how its layers follow it, and the slope they are laid on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from lmctl.plan.plan_report import Finding, report_finding

if TYPE_CHECKING:
    from lmctl.part.part import Part

_LAYERS = {
    "level": "layers are level", "shifted": "each layer is its surface, raised",
    "parallel": "layers are parallel to it", "blended": "layers pass from it to a level top",
}


def substrate_totals(part: Part) -> dict[str, Any]:
    """What the totals of a job hold of a substrate with a shape; nothing on a plate."""
    stack = part.layer_stack
    if part.substrate_surface is None or stack is None:
        return {}
    return {"substrate": {
        "kind": part.substrate.kind, "material": part.substrate.material,
        "layers": stack.shape,
        "rise_mm": round(stack.highest_mm(0.0) - stack.lowest_mm(0.0), 3),
        "slope_deg": round(math.degrees(math.atan(stack.steepest_slope(0.0))), 2),
    }}


def substrate_report(part: Part, has_nozzle: bool) -> list[Finding]:
    """Findings about a substrate with a shape. has_nozzle : whether the profile states a nozzle"""
    totals = substrate_totals(part).get("substrate")
    if totals is None or part.substrate_surface is None or part.layer_stack is None:
        return []
    surface = part.substrate_surface.heights.height_mm(part.layer_stack.region_mm)
    found = [report_finding(
        True, f"substrate: a {totals['kind']} that rises by "
        f"{surface.max() - surface.min():.2f} mm under the part, {_LAYERS[totals['layers']]}; "
        f"slopes of layers up to {totals['slope_deg']:.1f}°. Heights of lost pieces and overhangs "
        "count from it")]
    if not has_nozzle and len(part.layer_stack.around_mm) and not part.layer_stack.is_level():
        found.append(report_finding(
            False, "the machine profile states no [nozzle]: whether it clears the substrate beside "
            "it is not checked"))
    return found
