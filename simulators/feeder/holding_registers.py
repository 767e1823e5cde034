"""The holding registers of a PMX device: permitted writes and present values."""

from __future__ import annotations

from collections.abc import Mapping

from firmware_protocol.pmx import (
    FIRST_CONFIGURATION_REGISTER,
    hopper_register_name,
    register_map,
)
from firmware_protocol.registers import RegisterSpace, RegisterValue
from simulators.feeder.config import FeederConfig, HopperConfig
from simulators.modbus_errors import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionReplyError

_DEFAULTS: dict[str, RegisterValue] = {
    "WD_TIMEOUT": 1000, "WD_ACTION": 1, "STABILISE": 8.0, "POSTFLOW": 10.0, "AT_SPEED_TOL": 2.0,
}


class HoldingRegisters:
    """The words of a device with the hoppers of its configuration, channels counted from 1."""

    def __init__(self, config: FeederConfig) -> None:
        self._map = register_map(max(hopper.channel for hopper in config.hoppers))
        rows = [row for row in self._map.rows if row.space is RegisterSpace.HOLDING]
        self._limits = {
            row.address: (round(row.minimum * row.counts_per_unit),
                          round(row.maximum * row.counts_per_unit))
            for row in rows if row.minimum is not None and row.maximum is not None
        }
        self._places = {row.name: (row.address, row.counts_per_unit) for row in rows}
        self._words = {row.address + i: 0 for row in rows for i in range(row.word_count)}
        for hopper in config.hoppers:
            for name, value in _stored(hopper).items():
                self._put(hopper_register_name(hopper.channel, name), value)
        self.reset_volatile()

    def reset_volatile(self) -> None:
        """Reset everything but the stored configuration to defaults, as after a power loss."""
        for address in self._words:
            if address < FIRST_CONFIGURATION_REGISTER:
                self._words[address] = 0
        for name, value in _DEFAULTS.items():
            self._put(name, value)

    def read(self, address: int, count: int) -> list[int]:
        """Raises ExceptionReplyError(ILLEGAL_ADDRESS) if a register does not exist."""
        try:
            return [self._words[a] for a in range(address, address + count)]
        except KeyError:
            raise ExceptionReplyError(ILLEGAL_ADDRESS) from None

    def check_write(self, new: Mapping[int, int]) -> None:
        """Raises ExceptionReplyError for {address: word} that may not be written; stores none."""
        words = self._words
        if not new.keys() <= words.keys():
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        for address, word in new.items():
            if word != words[address] and address in self._limits:
                least, greatest = self._limits[address]
                if not least <= word <= greatest:
                    raise ExceptionReplyError(ILLEGAL_VALUE)

    def store(self, new: Mapping[int, int]) -> None:
        """Write words that were checked."""
        self._words.update(new)

    def __getitem__(self, name: str) -> float:
        """A one-word number in its unit."""
        address, per_unit = self._places[name]
        return self._words[address] / per_unit

    def raw_word(self, name: str) -> int:
        """Return the raw word of a one-word register."""
        return self._words[self._places[name][0]]

    def set_raw_word(self, name: str, word: int) -> None:
        self._words[self._places[name][0]] = word

    def _put(self, name: str, value: RegisterValue) -> None:
        self.store(dict(enumerate(self._map.encode(name, value), self._map.wire_address(name))))


def _stored(hopper: HopperConfig) -> dict[str, RegisterValue]:
    calibrated = hopper.calibrated_g_rev
    return {
        "FEED_FACTOR": hopper.feed_factor_g_rev if calibrated is None else calibrated,
        "N_MIN": hopper.n_min_rpm, "N_MAX": hopper.n_max_rpm,
        "CARRIER_MIN": 2.0, "CARRIER_MAX": 12.0, "LEVEL_WARN": 10.0, "LEVEL_STOP": 0.0,
        "LOT": hopper.material.encode("ascii", "replace").decode()[:32],
    }
