"""Inputs of a simulated safety device: digital inputs, analog values, first-out code."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_protocol.registers import RegisterValue
from firmware_protocol.safety_io import (
    ALL_INPUTS_OK,
    SIO_MAP,
    SafetyInputBits,
    first_out_code_of_input,
)
from simulators.safety.config import SafetyConfig

#: Switch limits (least, greatest): a value outside opens the input.
_SWITCHES = {
    "SHIELD_GAS": (SafetyInputBits.SHIELD_GAS_OK, 5.0, 1e9),
    "CHILLER_TEMP": (SafetyInputBits.CHILLER_OK, 5.0, 35.0),
    "CHILLER_FLOW": (SafetyInputBits.CHILLER_OK, 4.0, 1e9),
    "EXTRACTION_DP": (SafetyInputBits.EXTRACTION_OK, 200, 2000),
}


class InputCard:
    """Analog values by register; inputs opened by the operator, and inputs that values open.

    first_out, trips : as FIRST_OUT and TRIP_COUNT report
    """

    def __init__(self, config: SafetyConfig) -> None:
        self.values: dict[str, RegisterValue] = {
            "SHIELD_GAS": config.shield_gas_L_min,
            "CHILLER_TEMP": config.chiller_C,
            "CHILLER_FLOW": config.chiller_L_min,
            "OXYGEN": config.oxygen_ppm,
            "EXTRACTION_DP": round(config.extraction_Pa),
        }
        self._opened_by_hand = SafetyInputBits(0)
        self.good = self._seen()
        self.power_cycle()

    def power_cycle(self) -> None:
        """Clear the record of opened inputs, except those open now."""
        self.trips = 0
        self.reset_first_out()

    def reset_first_out(self) -> None:
        still_open = [one for one in SafetyInputBits if one not in self.good]
        self.first_out = first_out_code_of_input(still_open[0]) if still_open else 0

    def set_input(self, one: SafetyInputBits, good: bool) -> None:
        if good:
            self._opened_by_hand &= ~one
        else:
            self._opened_by_hand |= one
        self._look()

    def set_values(self, values: Mapping[str, RegisterValue]) -> None:
        """Raises RegisterError for a value that its register cannot hold."""
        for name, value in values.items():
            SIO_MAP.encode(name, value)
        self.values.update(values)
        self._look()

    def record_first_out(self, code: int) -> None:
        """Count a trip, and store its code if it is the first."""
        self.trips += 1
        self.first_out = self.first_out or code

    def _look(self) -> None:
        before, self.good = self.good, self._seen()
        for one in SafetyInputBits:
            if one in before and one not in self.good:
                self.record_first_out(first_out_code_of_input(one))

    def _seen(self) -> SafetyInputBits:
        good = ALL_INPUTS_OK & ~self._opened_by_hand
        for name, (one, least, greatest) in _SWITCHES.items():
            value = self.values[name]
            if not (isinstance(value, int | float) and least <= value <= greatest):
                good &= ~one
        return good
