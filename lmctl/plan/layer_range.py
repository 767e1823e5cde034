"""Which layers of a part can be deposited, and where the part stands for it.

`lmctl check` asks this without the rest of planning, so nothing else of it is imported here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.config.machine import MachineProfile
from lmctl.errors import PlanError
from lmctl.plan.geometry import layer_geometry
from lmctl.preflight.part_check import check_part
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part


def place_layers(part: Part, profile: MachineProfile) -> Placement:
    """Where the layers of a part lie, all that can be deposited.

    Layers at the bottom and at the top without tracks are left out; a part that the part file does
    not place is set down by what is left out below it.
    Raises PlanError: what `check_part` finds, or no layer with tracks.
    """
    placement = check_part(part, profile)

    def has_tracks(layer: int) -> bool:
        return layer_geometry(part, placement, layer).n_tracks > 0

    layers = range(placement.n_layers)
    first = next((layer for layer in layers if has_tracks(layer)), None)
    if first is None:
        raise nothing_to_deposit(part)
    last = next(layer for layer in reversed(layers) if has_tracks(layer))
    return placement.restricted_to(first, last, set_down=part.placement_mm is None)


def nothing_to_deposit(part: Part) -> PlanError:
    """The error of a part without tracks in any layer."""
    return PlanError(
        f"{part.name} has nothing as wide as a bead",
        where=f"process.bead_width_mm = {part.process.bead_width_mm:g}, "
              f"strategy {part.process.strategy}",
        hint="take a finer bead, or check the units of the part")
