"""Find which layers of a part can be deposited, and the placement of the part for that.

`lmctl check` needs this without the rest of planning, so this module imports nothing else of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.config.part_file import ProcessSettings
from lmctl.errors import PlanError
from lmctl.part.substrate import flattened_part
from lmctl.plan.recipe import recipe_of
from lmctl.preflight.part_check import check_part
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part, PartSection

#: Points across each way of the outline's box; and most edges that all of them are measured to.
_RASTER, _MOST_EDGES = 15, 2_000


def place_layers(part: Part, profile: MachineProfile) -> Placement:
    """Where the layers of a part lie, all that can be deposited.

    Layers at the bottom and at the top without tracks are left out; a part that the part file does
    not place is set down by what is left out below it.
    Raises PlanError: what `check_part` and `recipe_of` find, or no layer with tracks.
    """
    part = flattened_part(part)
    placement = check_part(part, profile)
    recipe_of(part, profile, placement.layer_height_mm)

    def has_tracks(layer: int) -> bool:
        if _is_wide(part.section(placement.cut_height_mm(layer)), part.process):
            return True
        from lmctl.plan.geometry import layer_geometry  # late: most parts are wide at both ends

        return layer_geometry(part, placement, layer).n_tracks > 0

    layers = range(placement.n_layers)
    first = next((layer for layer in layers if has_tracks(layer)), None)
    if first is None:
        raise nothing_to_deposit(part)
    last = next(layer for layer in reversed(layers) if has_tracks(layer))
    set_down = part.placement_mm is None and part.layer_stack is None
    return placement.restricted_to_layers(first, last, set_down=set_down)


def _is_wide(section: PartSection, process: ProcessSettings) -> bool:
    """Whether tracks fit for certain: a circle of two beads' radius lies in the outline.

    Looked for around the points of a coarse raster, without the compiled kernels: loading them
    takes longer than all else that the check of a plain part does.
    """
    edges = sum(len(loop) - 1 for loop in section.loops)
    if process.strategy != "offset" or not 0 < edges <= _MOST_EDGES:
        return False
    start = np.vstack([loop[:-1] for loop in section.loops])
    end = np.vstack([loop[1:] for loop in section.loops])
    low, high = start.min(axis=0), start.max(axis=0)
    at = low + (high - low) * (np.indices((_RASTER, _RASTER)).reshape(2, -1).T + 0.5) / _RASTER
    direction, offset = end - start, at[:, None] - start
    length_sq = np.maximum((direction * direction).sum(axis=1), 1e-300)
    share = (offset * direction).sum(axis=2) / length_sq
    apart = offset - np.clip(share, 0.0, 1.0)[:, :, None] * direction
    distance = np.hypot(apart[:, :, 0], apart[:, :, 1]).min(axis=1)
    needed_mm = 2 * process.bead_width_mm + max(0.0, -process.allowance_mm)
    return bool((_is_inside(at, start, end) & (distance >= needed_mm)).any())


def _is_inside(at: FloatArray, start: FloatArray, end: FloatArray) -> NDArray[np.bool_]:
    """(n,) whether points (n, 2) lie within loops of edges: an odd number is passed towards +x."""
    crosses = (start[:, 1] > at[:, None, 1]) != (end[:, 1] > at[:, None, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (at[:, None, 1] - start[:, 1]) / (end[:, 1] - start[:, 1])
    beyond = start[:, 0] + share * (end[:, 0] - start[:, 0]) > at[:, None, 0]
    odd: NDArray[np.bool_] = (crosses & beyond).sum(axis=1) % 2 == 1
    return odd


def nothing_to_deposit(part: Part) -> PlanError:
    """The error of a part without tracks in any layer.

    What is narrower than a bead has one track from half a bead on, unless `narrow_features` says
    otherwise.
    """
    process = part.process
    least = "a bead" if process.narrow_features == "omit" else "half a bead"
    return PlanError(
        f"{part.name} has nothing as wide as {least}: no layer has a track",
        where=f"process.bead_width_mm = {process.bead_width_mm:g}, "
              f"narrow_features {process.narrow_features}, strategy {process.strategy}",
        hint="take a finer bead, or check the units of the part")
