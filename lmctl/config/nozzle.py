"""The nozzle of a machine profile: its shape, for what it may run into."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from lmctl.config.toml_file import ConfigModel


class NozzleSettings(ConfigModel):
    """A cone that points down, its tip the standoff above the tool point.

    standoff_mm : from the tip down to the top of the layer that is deposited
    tip_diameter_mm : of the flat tip; half_angle_deg : of the cone, from its axis
    body_diameter_mm : the widest it gets, optics and hoses included; None: the cone goes on
    """

    standoff_mm: Annotated[float, Field(gt=0, le=200)]
    tip_diameter_mm: Annotated[float, Field(gt=0, le=200)]
    half_angle_deg: Annotated[float, Field(gt=0, lt=89)]
    body_diameter_mm: Annotated[float, Field(gt=0, le=2000)] | None = None

    def reach_mm(self, higher_mm: float) -> float:
        """How far beside its axis it can meet what is so much higher than the tool point [mm]."""
        if higher_mm <= self.standoff_mm:
            return 0.0
        reach = self.tip_diameter_mm / 2 + (higher_mm - self.standoff_mm) * math.tan(
            math.radians(self.half_angle_deg))
        return reach if self.body_diameter_mm is None else min(reach, self.body_diameter_mm / 2)
