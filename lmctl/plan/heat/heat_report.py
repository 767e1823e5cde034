"""The prediction of temperature in a job's totals and findings, and when one is made."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lmctl.config.part_file import ProcessSettings
from lmctl.job.schema import LayerHeat
from lmctl.plan.plan_report import Finding, report_finding
from lmctl.plan.recipe import Recipe
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part
    from lmctl.plan.heat.heat_planner import HeatPlanner


def heat_planner_of(
    part: Part, recipe: Recipe, placement: Placement, *, is_excerpt: bool
) -> HeatPlanner | None:
    """The planner of a part's temperature; None where none is limited, or the layers below the
    first are not planned."""
    limit_C = part.process.interpass_max_C
    if limit_C is None or part.build_heat is None or is_excerpt:
        return None
    from lmctl.plan.heat.heat_planner import HeatPlanner  # late: few parts state a limit

    offset = placement.offset_mm
    return HeatPlanner(part.build_heat, limit_C, recipe, placement.low_mm + offset,
                       placement.high_mm + offset)


def heat_totals(heat: HeatPlanner | None) -> dict[str, Any]:
    """What `lmctl plan --json` prints of it, all predicted; empty where nothing is."""
    if heat is None or not heat.layers:
        return {}
    hottest = _hottest(heat.layers)
    return {"predicted_heat": {
        "interpass_max_C": heat.limit_C,
        "interpass_C": hottest.interpass_C,
        "layer": hottest.layer + 1,
        "at_mm": [hottest.x_mm, hottest.y_mm],
        "wait_s": round(sum(layer.wait_s for layer in heat.layers), 2),
        "layers_with_waits": sum(layer.wait_s > 0 for layer in heat.layers),
        "cuts": sum(layer.cuts for layer in heat.layers),
        "layers_reordered": sum(layer.order != "nearest" for layer in heat.layers),
        "layers_above_limit": len(_above(heat)),
        "least_power_factor": min(layer.power_factor for layer in heat.layers),
        "by_layer": [
            {"layer": one.layer + 1, "interpass_C": one.interpass_C,
             "at_mm": [one.x_mm, one.y_mm], "wait_s": one.wait_s, "cuts": one.cuts,
             "power_factor": one.power_factor, "order": one.order} for one in heat.layers],
    }}


def heat_findings(
    heat: HeatPlanner | None, process: ProcessSettings, *, is_excerpt: bool
) -> list[Finding]:
    """Findings for the job."""
    if heat is None or not heat.layers:
        if process.interpass_max_C is None or not is_excerpt:
            return []
        power = (", and beam power is the recipe's" if process.power_follows_temperature else "")
        return [report_finding(False, "temperature is not predicted for some layers alone: their "
                               f"times are those without waits for heat{power}")]
    hottest, above = _hottest(heat.layers), _above(heat)
    wait_s = sum(layer.wait_s for layer in heat.layers)
    waiting = sum(layer.wait_s > 0 for layer in heat.layers)
    cuts = sum(layer.cuts for layer in heat.layers)
    waits = (f"with {wait_s:.0f} s of waits in {waiting} layers, and paths interrupted for them in "
             f"{cuts} places" if waiting else "without waits for heat")
    reordered = sum(layer.order != "nearest" for layer in heat.layers)
    if reordered:
        waits += f"; tracks of {reordered} layers are in an order that heat asked for"
    if process.power_follows_temperature:
        least = min(layer.power_factor for layer in heat.layers)
        waits += f"; beam power follows temperature, down to {100 * least:.0f} % of the recipe's"
    if not above:
        return [report_finding(
            True, f"interpass temperature predicted at most {hottest.interpass_C:.0f} °C, in layer "
            f"{hottest.layer + 1} at x {hottest.x_mm:.1f}, y {hottest.y_mm:.1f} (limit "
            f"{heat.limit_C:g} °C), {waits}")]
    return [report_finding(
        False, f"the interpass limit of {heat.limit_C:g} °C cannot be kept by waiting: the beam "
        f"is predicted to come back to {hottest.interpass_C:.0f} °C in layer {hottest.layer + 1} "
        f"at x {hottest.x_mm:.1f}, y {hottest.y_mm:.1f}, on a piece of path too short to be "
        f"interrupted again, and to more than the limit in {len(above)} layers, the first is layer "
        f"{above[0].layer + 1}; {waits}. Lower power_W or power_per_layer, widen the part there, "
        f"or set interpass_max_C to {_rounded_up_C(hottest.interpass_C)}")]


def _rounded_up_C(temperature_C: float) -> int:
    """To the next ten."""
    return math.ceil(temperature_C / 10) * 10


def _hottest(layers: list[LayerHeat]) -> LayerHeat:
    return layers[int(np.argmax([layer.interpass_C for layer in layers]))]


def _above(heat: HeatPlanner) -> list[LayerHeat]:
    limit_C = heat.limit_C + heat.tolerance_K
    return [layer for layer in heat.layers if layer.interpass_C > limit_C]
