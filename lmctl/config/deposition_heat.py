"""Keys of `[process]` about heat: a limit of temperature, least times, and beam power by layer."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from lmctl.config.toml_file import ConfigModel

PowerFactor = Annotated[float, Field(gt=0, le=5)]


class DepositionHeatSettings(ConfigModel):
    """How the plan keeps a part from growing too hot; the defaults change nothing.

    interpass_max_C : the beam does not come back to a place that is predicted to be hotter; the
        plan waits with the beam off. None: temperature is neither predicted nor limited
    least_layer_time_s : least time from the first bead of a layer to the first of the next
    first_layer_power : factor on the beam power of the first layer
    power_per_layer : factor on the beam power from each layer to the next, from the second layer's
        on; final_power : the factor on the recipe's power at which it stops falling
    power_follows_temperature : each layer's beam power falls with the mean temperature that it is
        predicted to find, so that the molten pool stays as large as on the plate; beside the
        factors above, and not below the least of power_range. It needs interpass_max_C
    power_range : least and greatest factor allowed, on beam power and so on energy per volume
    surface_loss_W_m2_K : from free surfaces to gas and surroundings, by convection and radiation
    """

    interpass_max_C: Annotated[float, Field(ge=-50, le=3000)] | None = None
    least_layer_time_s: Annotated[float, Field(ge=0, le=36_000)] = 0.0
    first_layer_power: PowerFactor = 1.0
    power_per_layer: Annotated[float, Field(ge=0.5, le=1)] = 1.0
    final_power: PowerFactor = 0.8
    power_follows_temperature: bool = False
    power_range: tuple[PowerFactor, PowerFactor] = (0.7, 1.3)
    surface_loss_W_m2_K: Annotated[float, Field(ge=0, le=1000)] = 25.0

    @model_validator(mode="after")
    def _energy_within_range(self) -> DepositionHeatSettings:
        least, most = self.power_range
        if least > 1 or most < 1:
            raise ValueError("power_range must hold the recipe's own power, 1")
        wanted = {"first_layer_power": self.first_layer_power}
        if self.power_per_layer < 1:
            wanted["final_power"] = self.final_power
        outside = [f"{name} = {value:g}" for name, value in wanted.items()
                   if not least <= value <= most]
        if outside:
            raise ValueError(
                f"{' and '.join(outside)} would take energy per volume outside {least:g} to "
                f"{most:g} times the recipe's (power_range)")
        if self.power_per_layer < 1 and self.final_power > 1:
            raise ValueError("final_power is above 1, and power_per_layer only lowers power")
        return self

    def power_factor(self, layer: int) -> float:
        """Factor on the recipe's beam power in a layer, counted from 0."""
        if layer == 0:
            return self.first_layer_power
        if self.power_per_layer == 1:
            return 1.0
        return max(self.power_per_layer ** (layer - 1), self.final_power)
