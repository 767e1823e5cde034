"""Reads and writes the rows of a register map on its device, in as few requests as it allows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from firmware_protocol.device_map import DeviceMap, row_name
from firmware_protocol.registers import (
    MAX_WRITE_REGISTERS,
    RegisterBlock,
    RegisterMap,
    RegisterSpace,
    RegisterType,
    RegisterValue,
)
from lmctl.machine.modbus.client import ModbusLink

#: A row of a map on its device: (channel, name); channel None: of the device itself.
Place = tuple[int | None, str]


class MappedRegisters:
    """The registers of one device, by the names of its map's rows."""

    def __init__(self, link: ModbusLink, device: DeviceMap) -> None:
        self._link = link
        self._device = device
        self._tables: dict[int | None, RegisterMap] = {
            unit: device.registers_of_unit(unit) for unit in device.unit_ids()}
        self._plans: dict[tuple[Place, ...], list[tuple[int | None, RegisterBlock]]] = {}
        self._read = {
            RegisterSpace.INPUT: link.read_input, RegisterSpace.HOLDING: link.read_holding,
            RegisterSpace.COIL: link.read_coils, RegisterSpace.DISCRETE: link.read_discrete_inputs}
        self._hopper_rows = {one.register.name for one in device.hopper_rows}

    def places(self, name: str, channels: Sequence[int]) -> list[Place]:
        """Where a row is: once on the device, or once in each of the hoppers."""
        if name in self._hopper_rows:
            return [(channel, name) for channel in channels]
        return [(None, name)]

    async def read(self, places: Iterable[Place]) -> dict[Place, RegisterValue]:
        """The values of rows. Raises as requests do; RegisterError for words without meaning."""
        wanted = tuple(dict.fromkeys(places))
        plan = self._plans.get(wanted)
        if plan is None:
            plan = self._plans[wanted] = self._blocks(wanted, self._device.max_registers)
        values: dict[tuple[int | None, str], RegisterValue] = {}
        for unit, block in plan:
            words = await self._read[block.kind](block.address, block.count, unit)
            values |= {(unit, name): value for name, value in block.decode(words).items()}
        return {place: values[self._unit(place), row_name(place[1], place[0])] for place in wanted}

    async def write(self, values: Mapping[Place, RegisterValue]) -> None:
        """Write rows by rising address, those that follow each other in one request.

        Raises as requests do; RegisterError for a value that does not fit.
        """
        most = min(self._device.max_registers, MAX_WRITE_REGISTERS)
        for unit, block in self._blocks(tuple(values), most):
            named = {row_name(name, channel): value for (channel, name), value in values.items()
                     if self._unit((channel, name)) == unit}
            write = self._link.write_coils if block.kind is RegisterSpace.COIL else self._link.write
            await write(block.address, block.encode(named), unit)

    def nearest(self, place: Place, value: float) -> tuple[RegisterValue, bool]:
        """What a register holds that is nearest to a value, and whether its limits forbid more."""
        table, name = self._tables[self._unit(place)], row_name(place[1], place[0])
        row = table[name]
        is_float = row.type is RegisterType.F32
        low = -math.inf if is_float else row.type.least / row.counts_per_unit
        high = math.inf if is_float else row.type.greatest / row.counts_per_unit
        low = low if row.minimum is None else max(low, row.minimum)
        high = high if row.maximum is None else min(high, row.maximum)
        limited = min(max(value, low), high)
        return table.decode(name, table.encode(name, limited)), limited != value

    def _unit(self, place: Place) -> int | None:
        channel = place[0]
        return None if channel is None else self._device.unit_of(channel)

    def _blocks(
        self, places: Sequence[Place], most: int
    ) -> list[tuple[int | None, RegisterBlock]]:
        by_unit: dict[int | None, list[str]] = {}
        for place in places:
            by_unit.setdefault(self._unit(place), []).append(row_name(place[1], place[0]))
        return [(unit, block) for unit, names in by_unit.items()
                for block in self._tables[unit].plan_reads(names, most=most)]
