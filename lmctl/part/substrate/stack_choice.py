"""Choose how the layers of a part follow its substrate, and refuse what cannot be followed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.errors import LmctlError, PlanError
from lmctl.part.substrate.layer_stack import FollowedShape, LayerStack
from lmctl.part.substrate.substrate_surface import SubstrateSurface
from lmctl.part.substrate.surface_heights import GridHeights, SurfaceHeights

if TYPE_CHECKING:
    from lmctl.part.bodies import Body

#: Places under the part are so many beads apart, or farther so that there are no more than this.
_APART_BEADS, _MOST_PLACES = 0.5, 20_000
#: Points kept of the surface around.
_MOST_AROUND = 20_000
#: Heights looked at over each place: so many to a layer, and at most.
_PER_LAYER, _MOST_HEIGHTS = 4, 400
#: Halvings of the step to the top of the part.
_HALVINGS = 24
#: Most that a blended layer's thickness may differ from the layer height, as a factor.
MAX_STRETCH_FACTOR = 1.5
#: The part may lie beside a measured surface by so many beads squared.
_BESIDE_BEADS2 = 1.0


@dataclass(frozen=True, eq=False)
class StackOfPart:
    """The layers of a part over its substrate, and the u of its highest point [mm]."""

    stack: LayerStack
    highest_mm: float


def stack_of_part(
    substrate: SubstrateSurface, body: Body, bead_mm: float, layer_height_mm: float
) -> StackOfPart:
    """How the layers of a body lie over its substrate.

    Raises PlanError with all that is wrong: nothing of the part lies over the substrate, it lies
    beside the measured surface, the surface is too steep, layers would be too thick or too thin.
    """
    heights = substrate.heights
    places, apart_mm = _places(body, bead_mm)
    tops = _tops(body, heights.height_mm(places), places, layer_height_mm)
    over = np.isfinite(tops)
    if not over.any():
        raise PlanError("the part lies nowhere above its substrate", where="substrate",
                        hint="check the heights of both: they are in the part file's coordinates")
    region, top_mm = places[over], tops[over]
    wrong: list[LmctlError] = []
    beside = ~heights.covers(region)
    if beside.sum() * apart_mm**2 > _BESIDE_BEADS2 * bead_mm**2:
        wrong.append(_beside(region[beside], apart_mm))
        region, top_mm = region[~beside], top_mm[~beside]
    if len(region):
        wrong += _too_steep(substrate, region)
        stack = _stack(substrate, region, top_mm)
        wrong += _too_uneven(stack, region)
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise PlanError(
            f"the part cannot be deposited on its substrate: {len(wrong)} things are in the way",
            where=[text for e in wrong for text in (e.what, *(f"  {place}" for place in e.where))],
            hint="mend them and check again with `lmctl check`")
    highest = float(stack.level_mm(np.column_stack([region, top_mm])).max())
    return StackOfPart(stack, highest)


def _stack(substrate: SubstrateSurface, region: FloatArray, top_mm: FloatArray) -> LayerStack:
    settings, heights = substrate.settings, substrate.heights
    bottom = heights.height_mm(region)
    shape = settings.layers
    if shape == "auto":
        if np.ptp(bottom) <= 2 * settings.standoff_tolerance_mm:
            shape = "level"
        else:
            shape = "shifted" if isinstance(heights, GridHeights) else "parallel"
    followed: FollowedShape = shape
    stack = LayerStack(heights, followed, region, _around(heights),
                       base_mm=float(bottom.min() + bottom.max()) / 2)
    if shape == "blended":
        top = float(top_mm.max())
        stack = replace(stack, top_mm=top, depth_mm=float((top - bottom).mean()))
    return stack


def _around(heights: SurfaceHeights) -> FloatArray:
    """Measured points of the surface, (q, 3); none of a formula, which is no higher around."""
    if not isinstance(heights, GridHeights):
        return np.empty((0, 3))
    nodes = heights.nodes_mm()[heights.covered.ravel()]
    return nodes[:: max(1, len(nodes) // _MOST_AROUND)]


def _places(body: Body, bead_mm: float) -> tuple[FloatArray, float]:
    """Places (k, 2) over the body's box, and how far apart."""
    low, high = body.tight_bounds_mm
    size = high[:2] - low[:2]
    apart = max(_APART_BEADS * bead_mm, float(np.sqrt(np.prod(size) / _MOST_PLACES)))
    count = np.maximum(np.ceil(size / apart).astype(int), 1)
    x, y = (low[axis] + (np.arange(count[axis]) + 0.5) * size[axis] / count[axis]
            for axis in (0, 1))
    yy, xx = np.meshgrid(y, x, indexing="ij")
    return np.column_stack([xx.ravel(), yy.ravel()]), apart


def _tops(
    body: Body, bottom_mm: FloatArray, places: FloatArray, layer_height_mm: float
) -> FloatArray:
    """The highest z of the body over each place, −inf where it is not above the substrate."""
    top = float(body.tight_bounds_mm[1][2])
    lowest = float(bottom_mm.min())
    if top <= lowest:
        return np.full(len(places), -np.inf)
    count = int(np.clip(np.ceil((top - lowest) * _PER_LAYER / layer_height_mm), 1, _MOST_HEIGHTS))
    step = (top - lowest) / count
    found = np.full(len(places), -np.inf)
    waiting = np.arange(len(places))
    for k in range(count):
        z_mm = top - (k + 0.5) * step
        waiting = waiting[bottom_mm[waiting] < z_mm]
        inside = _is_inside(body, places[waiting], np.full(len(waiting), z_mm))
        found[waiting[inside]] = z_mm
        waiting = waiting[~inside]
    rows = np.flatnonzero(np.isfinite(found))
    low, high = found[rows], np.minimum(found[rows] + step, top)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        inside = _is_inside(body, places[rows], middle)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    found[rows] = high
    return found


def _is_inside(body: Body, places: FloatArray, z_mm: FloatArray) -> NDArray[np.bool_]:
    if len(places) == 0:
        return np.empty(0, dtype=np.bool_)
    return np.asarray(body.distance_at(np.column_stack([places, z_mm])) > 0)


def _beside(beside: FloatArray, apart_mm: float) -> PlanError:
    low, high = beside.min(axis=0), beside.max(axis=0)
    return PlanError(
        f"{len(beside) * apart_mm**2:.0f} mm² of the part lie beside the substrate: material would "
        "start in the air",
        where=f"between x {low[0]:.1f} and {high[0]:.1f}, y {low[1]:.1f} and {high[1]:.1f} mm",
        hint="scan all of the face, or cut the part where its substrate ends")


def _too_steep(substrate: SubstrateSurface, region: FloatArray) -> list[LmctlError]:
    if substrate.settings.layers == "level":
        return []
    steep = np.linalg.norm(substrate.heights.slope(region), axis=1)
    angle = np.degrees(np.arctan(steep))
    limit = substrate.settings.max_slope_deg
    worst = int(np.argmax(angle))
    if angle[worst] <= limit:
        return []
    return [PlanError(
        f"the substrate slopes by up to {angle[worst]:.1f}°, and the limit is {limit:g}°",
        where=[f"at x {region[worst, 0]:.1f}, y {region[worst, 1]:.1f} mm",
               f"{(angle > limit).mean():.0%} of what is deposited on is steeper",
               f"substrate.max_slope_deg = {limit:g}"],
        hint="turn the workpiece so that this side lies level and build it in several jobs, or "
             "raise substrate.max_slope_deg where the process holds it")]


def _too_uneven(stack: LayerStack, region: FloatArray) -> list[LmctlError]:
    if stack.shape != "blended":
        return []
    stretch = stack.stretch(region, 0.0)
    low, high = float(stretch.min()), float(stretch.max())
    if low >= 1 / MAX_STRETCH_FACTOR and high <= MAX_STRETCH_FACTOR:
        return []
    return [PlanError(
        f"layers blended to a level top would be {low:.2f} to {high:.2f} times the layer height",
        where=f"at most {1 / MAX_STRETCH_FACTOR:.2f} to {MAX_STRETCH_FACTOR:g} times can be "
              "deposited by pace alone",
        hint='set substrate.layers = "shifted", so that layers end where the part ends')]
