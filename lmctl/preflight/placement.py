"""Where the part is placed on the platform, and at which heights it is cut."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import MachineProfile
from lmctl.errors import PlanError
from lmctl.job.container import MAX_LAYERS
from lmctl.part.copies import bounds_of_copies_mm

if TYPE_CHECKING:
    from lmctl.part.part import Part

#: Largest deviation from the layer height of the process, so that whole layers fill a part.
MAX_LAYER_HEIGHT_CHANGE = 0.1
#: Heights that differ by less, as a ratio, are the same.
_EQUAL = 1e-6


@dataclass(frozen=True)
class Placement:
    """Where the layers of a part are cut and deposited.

    offset_mm : (3,) float64, program coordinates of the part's own origin
    low_mm, high_mm : (3,) float64, bounds of the part in its own coordinates; of several copies
        those of all
    layer_height_mm : fitted to the part's height, if that takes no more than a tenth
    n_layers : layers to deposit
    skipped : layers at the bottom that have nothing to deposit
    """

    offset_mm: FloatArray
    low_mm: FloatArray
    high_mm: FloatArray
    layer_height_mm: float
    n_layers: int
    skipped: int = 0

    def cut_height_mm(self, layer: int) -> float:
        """Height of a layer's middle, in the part's own coordinates."""
        return float(self.low_mm[2] + (self.skipped + layer + 0.5) * self.layer_height_mm)

    def nozzle_height_mm(self, layer: int) -> float:
        """Nozzle height while a layer is deposited: the layer's top, in program coordinates."""
        top_mm = self.low_mm[2] + (self.skipped + layer + 1) * self.layer_height_mm
        return float(self.offset_mm[2] + top_mm)

    def uncovered_height_mm(self) -> float:
        """How much taller the part is than its layers; negative where they end above it."""
        built_mm = (self.skipped + self.n_layers) * self.layer_height_mm
        return float(self.high_mm[2] - self.low_mm[2] - built_mm)

    def restricted_to_layers(self, first: int, last: int, *, set_down: bool) -> Placement:
        """Without the layers below `first` and above `last`.

        set_down : lower the part by what is left out below it, so that it rests on the platform
        """
        drop = np.array([0.0, 0.0, first * self.layer_height_mm if set_down else 0.0])
        return replace(self, offset_mm=self.offset_mm - drop, n_layers=last - first + 1,
                       skipped=self.skipped + first)


def fitted_layer_height_mm(tall_mm: float, wanted_mm: float) -> float:
    """The layer height of which a whole number fills the part, if it is near enough to the wanted.

    tall_mm : height of the part; wanted_mm : process.layer_height_mm, returned where nothing fits
    """
    fewer = max(1, int(tall_mm / wanted_mm + _EQUAL))
    fitted = min((tall_mm / fewer, tall_mm / (fewer + 1)), key=lambda h: abs(h / wanted_mm - 1))
    if abs(fitted / wanted_mm - 1) <= _EQUAL:
        return wanted_mm
    return fitted if abs(fitted / wanted_mm - 1) <= MAX_LAYER_HEIGHT_CHANGE else wanted_mm


def place_part(part: Part, profile: MachineProfile) -> Placement:
    """The part where its file puts it, else centred in x and y with its lowest point at z = 0.

    On a substrate with a shape that is the lowest point of the substrate under the part.
    Layers are those whose middle plane meets the part. Raises PlanError where there is none, or
    more than a job holds.
    """
    low, high = bounds_of_copies_mm(part)
    if part.placement_mm is not None:
        offset = np.asarray(part.placement_mm, dtype=np.float64)
    else:
        travel = profile.motion.travel_mm
        platform = np.array([sum(travel.x) / 2, sum(travel.y) / 2, 0.0])
        lowest = low[2] if part.layer_stack is None else part.layer_stack.lowest_mm(0.0)
        offset = platform - np.array([*((low + high) / 2)[:2], lowest])
    height = fitted_layer_height_mm(float(high[2] - low[2]), part.process.layer_height_mm)
    n_layers = int(np.floor((high[2] - low[2]) / height + 0.5 - 1e-6))  # a plane on top is out
    if n_layers < 1:
        raise PlanError(
            f"{part.name} is {high[2] - low[2]:.3g} mm tall, not more than half a layer",
            where=f"process.layer_height_mm = {height:g}",
            hint="lower layer_height_mm, or check the units of the part",
        )
    if n_layers > MAX_LAYERS:
        raise PlanError(
            f"{part.name} would have {n_layers:,} layers; a job holds at most {MAX_LAYERS:,}",
            where=f"process.layer_height_mm = {height:g}",
            hint="raise layer_height_mm, or check the units of the part",
        )
    return Placement(offset, low, high, height, n_layers)
