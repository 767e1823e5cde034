"""A device's register map as a map file describes it: rows, habits, and their meanings.

A map file is TOML; `map_file` reads it, and both ends of a wire work from the same one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from firmware_protocol.feeder_map import FeederMap
from firmware_protocol.registers import (
    MAX_READ_REGISTERS,
    Register,
    RegisterMap,
    WordOrder,
)


@dataclass(frozen=True)
class HopperRow:
    """A register that each hopper has.

    register : that of hopper 1
    step : how much further the address of the next hopper's is
    """

    register: Register
    step: int


@dataclass(frozen=True)
class DeviceIdentity:
    """The value by which the device is recognised."""

    register: str
    value: int


@dataclass(frozen=True)
class DeviceMap:
    """One device.

    device : "feeder" or "safety"
    rows, hopper_rows : registers of the device, and those that each hopper has
    hoppers : how many it has
    input_base, holding_base : what its manual calls the register at wire address 0
    coil_base, discrete_base : what it calls the coil, and the discrete input, at wire address 0
    word_order : of its 32-bit values
    function_codes : those it carries out
    max_registers : most registers that it moves in one request
    hopper_unit : the unit id of hopper 1 where each hopper answers under its own, the next one
        higher; None: they answer as the device
    bits, codes : meanings by the row's name: {name: number}
    feeder : how a feeder is commanded and read; None for other devices
    """

    name: str
    device: str
    rows: tuple[Register, ...]
    hopper_rows: tuple[HopperRow, ...] = ()
    description: str = ""
    hoppers: int = 1
    input_base: int = 0
    holding_base: int = 0
    coil_base: int = 0
    discrete_base: int = 0
    word_order: WordOrder = WordOrder.ABCD
    function_codes: tuple[int, ...] = (3, 4, 16, 23)
    max_registers: int = MAX_READ_REGISTERS
    hopper_unit: int | None = None
    bits: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    codes: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    identity: DeviceIdentity | None = None
    feeder: FeederMap | None = None

    @property
    def channels(self) -> range:
        return range(1, self.hoppers + 1)

    def unit_ids(self) -> tuple[int | None, ...]:
        """The units of this device: None is the one that the profile addresses."""
        if self.hopper_unit is None:
            return (None,)
        return (None, *(self.hopper_unit + channel - 1 for channel in self.channels))

    def unit_of(self, channel: int) -> int | None:
        """The unit that holds a hopper's registers."""
        return None if self.hopper_unit is None else self.hopper_unit + channel - 1

    def placed_rows(self) -> Iterator[tuple[int | None, Register]]:
        """Every register with its unit; a hopper's rows are called as `row_name` says."""
        for row in self.rows:
            yield None, row
        for channel in self.channels:
            for one in self.hopper_rows:
                name = row_name(one.register.name, channel)
                address = one.register.address + (channel - 1) * one.step
                yield self.unit_of(channel), replace(one.register, name=name, address=address)

    def registers_of_unit(self, unit: int | None) -> RegisterMap:
        """The registers of one unit. Raises RegisterError where they contradict each other."""
        return RegisterMap(
            [row for place, row in self.placed_rows() if place == unit],
            word_order=self.word_order, input_base=self.input_base,
            holding_base=self.holding_base, coil_base=self.coil_base,
            discrete_base=self.discrete_base)


def row_name(name: str, channel: int | None) -> str:
    """A row's name in its unit's table: "FLOW" of hopper 2 is "H2.FLOW"; None: of the device."""
    return name if channel is None else f"H{channel}.{name}"
