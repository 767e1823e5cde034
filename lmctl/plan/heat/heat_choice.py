"""What is predicted and chosen for one layer, until its lines are written."""

from __future__ import annotations

from dataclasses import dataclass

from lmctl.array_types import FloatArray
from lmctl.plan.heat.part_temperature import PartTemperature


@dataclass(frozen=True)
class PredictedReadings:
    """Temperatures that the beam is predicted to come back to in one layer; r places.

    place_mm : (r, 2) program coordinates; at_s : (r,) seconds from the layer's start, waits
    included; found_C : (r,)
    """

    place_mm: FloatArray
    at_s: FloatArray
    found_C: FloatArray


@dataclass(frozen=True)
class HeatChoice:
    """What is chosen for a layer.

    waited_s, cuts : as in `LayerHeat`; order : of its tracks
    trial : the part after it, and its readings, where they are known already
    """

    waited_s: float = 0.0
    cuts: int = 0
    order: str = "nearest"
    trial: tuple[PartTemperature, PredictedReadings] | None = None

    @property
    def is_compared(self) -> bool:
        """Whether its time is compared with another's: nearest first without waits is not."""
        return self.waited_s > 0 or self.order != "nearest"
