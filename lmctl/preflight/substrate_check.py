"""Check whether the nozzle can follow a substrate: lifts clear it, and the cone meets nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.nozzle import NozzleSettings
from lmctl.errors import PlanError
from lmctl.part.substrate import LayerStack
from lmctl.preflight.placement import Placement

#: Nozzle places that are compared with the surface around, at most, and at a time.
_MOST_PLACES, _AT_ONCE = 4_000, 200


def substrate_findings(
    stack: LayerStack, placement: Placement, profile: MachineProfile
) -> Iterator[PlanError]:
    """What keeps the nozzle from depositing the first and the last layer of a stack."""
    first, last = placement.layer_height_mm, placement.n_layers * placement.layer_height_mm
    rise = max(stack.highest_around_mm(level) - stack.lowest_mm(level) for level in (first, last))
    clearance = profile.motion.clearance_mm
    if rise > clearance:
        yield PlanError(
            f"a layer on the substrate, with the surface around it, rises by {rise:.1f} mm; the "
            f"nozzle lifts by {clearance:g} mm before it crosses",
            where=f"motion.clearance_mm = {clearance:g}",
            hint=f"raise motion.clearance_mm in the machine profile to {np.ceil(rise):g} or more")
    if profile.nozzle is not None:
        yield from _meets(stack, first, profile.nozzle)


def _meets(stack: LayerStack, level_mm: float, nozzle: NozzleSettings) -> Iterator[PlanError]:
    """Whether the nozzle over the first layer touches the surface beside it."""
    around = stack.around_mm
    if not len(around):
        around = np.column_stack([stack.region_mm, stack.height_mm(stack.region_mm, 0.0)])
    places = stack.region_mm[:: max(1, len(stack.region_mm) // _MOST_PLACES)]
    tool = np.column_stack([places, stack.height_mm(places, level_mm)])
    reach = nozzle.reach_mm(float(around[:, 2].max() - tool[:, 2].min()))
    if reach <= 0:
        return
    worst, tool_at, at = _deepest(tool, around, nozzle)
    if worst > 0:
        yield PlanError(
            f"the nozzle runs {worst:.1f} mm into the substrate beside it",
            where=["nozzle over x {:.1f}, y {:.1f}, z {:.1f} mm".format(*tool_at),
                   "surface at x {:.1f}, y {:.1f}, z {:.1f} mm".format(*at),
                   f"nozzle.standoff_mm = {nozzle.standoff_mm:g}, half_angle_deg = "
                   f"{nozzle.half_angle_deg:g}"],
            hint="take a slimmer nozzle, or grind the edge of the place to be filled")


def _deepest(
    tool: FloatArray, around: FloatArray, nozzle: NozzleSettings
) -> tuple[float, FloatArray, FloatArray]:
    """How deep the surface stands in the nozzle at worst, over which place, and at which point."""
    worst, pair = -np.inf, (tool[0], around[0])
    for begin in range(0, len(tool), _AT_ONCE):
        over = tool[begin : begin + _AT_ONCE]
        high = around[around[:, 2] > over[:, 2].min() + nozzle.standoff_mm]
        if not len(high):
            continue
        beside = np.hypot(over[:, None, 0] - high[None, :, 0], over[:, None, 1] - high[None, :, 1])
        deep = high[None, :, 2] - over[:, None, 2] - _underside_mm(nozzle, beside)
        row, column = np.unravel_index(int(np.argmax(deep)), deep.shape)
        if deep[row, column] > worst:
            worst, pair = float(deep[row, column]), (over[row], high[column])
    return worst, *pair


def _underside_mm(nozzle: NozzleSettings, beside_mm: FloatArray) -> FloatArray:
    """Height of the nozzle over the tool point [mm], beside its axis; inf beyond it."""
    beyond = np.maximum(beside_mm - nozzle.tip_diameter_mm / 2, 0.0)
    height = nozzle.standoff_mm + beyond / math.tan(math.radians(nozzle.half_angle_deg))
    if nozzle.body_diameter_mm is None:
        return np.asarray(height)
    return np.where(beside_mm > nozzle.body_diameter_mm / 2, np.inf, height)
