"""What another strategy would hold within the same intervals, tried on one layer.

Tracks along lines of equal mixture need powder to change between tracks only, with the beam off:
they suffer least where dead times and lags are not quite what was measured.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lmctl.config.machine import MachineProfile
from lmctl.errors import PlanError
from lmctl.plan.dilution.compensation import compensation_of
from lmctl.plan.geometry import layer_geometry
from lmctl.plan.margins.mixture_margins import mixture_margins
from lmctl.plan.recipe import recipe_of
from lmctl.plan.sequence.layer_sequencer import LayerSequencer
from lmctl.preflight.placement import Placement

if TYPE_CHECKING:
    from lmctl.part.part import Part

def dilution_half_width(profile: MachineProfile) -> float:
    """Half of the widest interval of a dilution that the profile knows; 0 without any."""
    return max((one.half_width for one in profile.dilution), default=0.0)


_STRATEGY = "iso-composition"
#: One layer is tried, of at least so many: planning may not take much longer.
_ONE_IN = 16


@dataclass(frozen=True)
class StrategyMargins:
    """Shares of path that a strategy holds: as predicted, in 95 of 100 cells, and at worst.

    layer : of the part, from 1, on which that was tried
    """

    strategy: str
    predicted: float
    usual: float
    worst: float
    layer: int

    def as_json(self) -> dict[str, object]:
        """For the job's totals."""
        return {"strategy": self.strategy, "predicted": round(self.predicted, 4),
                "path_95_of_100": round(self.usual, 4), "worst": round(self.worst, 4),
                "tried_on_layer": self.layer}


def iso_composition_margins(
    part: Part, profile: MachineProfile, placement: Placement
) -> StrategyMargins | None:
    """The margins of tracks along lines of equal mixture.

    returns : None where the part is planned so already, where it has too few layers for a trial to
        be cheap, without intervals, and where it cannot be planned so
    """
    if part.process.strategy in (_STRATEGY, "iso-3d") or placement.n_layers < _ONE_IN:
        return None
    other = replace(part, process=part.process.model_copy(update={
        "strategy": _STRATEGY, "region": ()}), copies=())  # one copy tells
    middle = placement.n_layers // 2
    recipe = recipe_of(other, profile, placement.layer_height_mm)
    sequencer = LayerSequencer(other.name, other.process, recipe, profile,
                               compensation_of(other, profile, recipe), part.layer_stack)
    try:
        geometry = layer_geometry(other, placement, middle)
        if not geometry.n_tracks:
            return None
        sequencer.sequence(0, geometry, placement, is_last=False)
        sequencer.finish()
    except PlanError:
        return None
    found = mixture_margins(
        sequencer.samples, recipe, profile.calibration_use, part.composition,
        sequencer.statistics.correct_mixture_fraction, dilution_half_width(profile))
    if found is None or found.usual is None or found.path.worst is None:
        return None
    return StrategyMargins(_STRATEGY, found.path.predicted, found.usual, found.path.worst,
                           middle + 1)
