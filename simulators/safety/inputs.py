"""What a simulated safety-input device sees: inputs, analog values, and what opened first."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_protocol.registers import Value
from firmware_protocol.safety_io import ALL_GOOD, SIO, Inputs, input_code
from simulators.safety.config import SafetyConfig

#: Where its switches stand (least, greatest): a value beyond opens the input.
_SWITCHES = {
    "SHIELD_GAS": (Inputs.SHIELD_GAS_OK, 5.0, 1e9),
    "CHILLER_TEMP": (Inputs.CHILLER_OK, 5.0, 35.0),
    "CHILLER_FLOW": (Inputs.CHILLER_OK, 4.0, 1e9),
    "EXTRACTION_DP": (Inputs.EXTRACTION_OK, 200, 2000),
}


class InputCard:
    """Values by their row of the map; inputs opened by hand, and those that values open.

    first_out, trips : as FIRST_OUT and TRIP_COUNT tell
    """

    def __init__(self, config: SafetyConfig) -> None:
        self.values: dict[str, Value] = {
            "SHIELD_GAS": config.shield_gas_L_min,
            "CHILLER_TEMP": config.chiller_C,
            "CHILLER_FLOW": config.chiller_L_min,
            "OXYGEN": config.oxygen_ppm,
            "EXTRACTION_DP": round(config.extraction_Pa),
        }
        self._opened_by_hand = Inputs(0)
        self.good = self._seen()
        self.forget()

    def forget(self) -> None:
        """Nothing has opened so far, but what is open."""
        self.trips = 0
        self.reset_first_out()

    def reset_first_out(self) -> None:
        still_open = [one for one in Inputs if one not in self.good]
        self.first_out = input_code(still_open[0]) if still_open else 0

    def set_input(self, one: Inputs, good: bool) -> None:
        if good:
            self._opened_by_hand &= ~one
        else:
            self._opened_by_hand |= one
        self._look()

    def set_values(self, values: Mapping[str, Value]) -> None:
        """Raises RegisterError for a value that its register cannot say."""
        for name, value in values.items():
            SIO.encode(name, value)
        self.values.update(values)
        self._look()

    def tripped(self, code: int) -> None:
        """Something opened, in this device's own count."""
        self.trips += 1
        self.first_out = self.first_out or code

    def _look(self) -> None:
        before, self.good = self.good, self._seen()
        for one in Inputs:
            if one in before and one not in self.good:
                self.tripped(input_code(one))

    def _seen(self) -> Inputs:
        good = ALL_GOOD & ~self._opened_by_hand
        for name, (one, least, greatest) in _SWITCHES.items():
            value = self.values[name]
            if not (isinstance(value, int | float) and least <= value <= greatest):
                good &= ~one
        return good
