"""A simulated feeder whose registers are those of a map file.

Discs, hoses and alarms are those of the PMX device; its registers are read and written by the
names of the map, so that what a host reads and writes has to pass through both.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from firmware_protocol.device_map import DeviceMap, row_name
from firmware_protocol.feeder_map import FeederMap, MappedAction, MappedCondition
from firmware_protocol.pmx import (
    ALARM_RESET_KEY,
    PMX_MAP,
    WATCHDOG_RESET_KEY,
    FeederCommandBits,
    FeederStatusBits,
    HopperStatusBits,
    SetpointMode,
    hopper_register_name,
)
from firmware_protocol.registers import (
    Register,
    RegisterError,
    RegisterMap,
    RegisterSpace,
    RegisterType,
    RegisterValue,
)
from simulators.feeder.device import PmxFeederDevice
from simulators.feeder.readings import register_values
from simulators.modbus_errors import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ExceptionReplyError

#: Registers of a PMX that hold a quantity of a map.
_DEVICE_SOURCES = {
    "alarm_code": "FIRST_ALARM_CODE", "refusal_code": "LAST_REFUSAL", "uptime_s": "UPTIME",
    "tick_ms": "TICK", "total_gas_L_min": "TOTAL_GAS", "mixer_pressure_mbar": "MIXER_PRESSURE",
}
_HOPPER_SOURCES = {
    "flow_g_min": "FLOW_EST", "weighed_flow_g_min": "FLOW_LIW", "weight_g": "WEIGHT",
    "level_percent": "LEVEL", "carrier_L_min": "CARRIER_ACT",
}
_SETPOINT_TARGETS = {"flow_setpoint_g_min": "FLOW_SP", "carrier_setpoint_L_min": "CARRIER_SP"}
_TIME_TARGETS = {"stabilise_s": "STABILISE", "post_flow_s": "POSTFLOW"}
_STATUS_SOURCES = {
    "remote": FeederStatusBits.REMOTE, "gas_ok": FeederStatusBits.GAS_OK,
    "feeding": FeederStatusBits.FEEDING, "stable": FeederStatusBits.STABLE,
    "alarm": FeederStatusBits.ALARM, "watchdog_tripped": FeederStatusBits.WATCHDOG_TRIPPED,
    "estop_closed": FeederStatusBits.ESTOP_CHAIN_OK, "lids_closed": FeederStatusBits.LID_CLOSED,
    "config_valid": FeederStatusBits.CONFIG_VALID,
}
_HOPPER_STATUS_SOURCES = {
    "level_low": HopperStatusBits.LEVEL_LOW, "empty": HopperStatusBits.LEVEL_EMPTY,
    "clipped": HopperStatusBits.LIMITED, "pressurised": HopperStatusBits.PRESSURISED,
    "refilling": HopperStatusBits.REFILLING,
}
_COMMAND_TARGETS = {
    "remote": FeederCommandBits.ENABLE_REMOTE, "gas": FeederCommandBits.GAS_ON,
    "feed": FeederCommandBits.FEED_ON, "refill": FeederCommandBits.REFILL_HOLD,
}


class MappedFeederDevice:
    """The feeder behind all its units. Raises ValueError for a map that is no feeder's."""

    def __init__(self, device: PmxFeederDevice, device_map: DeviceMap) -> None:
        if device_map.feeder is None:
            raise ValueError(f"{device_map.name} is no feeder")
        self.device = device
        self.map = device_map
        self.feeder_map: FeederMap = device_map.feeder
        self.tables: dict[int | None, RegisterMap] = {
            unit: device_map.registers_of_unit(unit) for unit in device_map.unit_ids()}
        self.held: dict[str, RegisterValue] = {}  # what was written, by the row's name in its unit
        self._sequence = 0
        if "feed" in self.feeder_map.missing and "gas" in self.feeder_map.missing:
            self._obey()

    def units(self) -> dict[int | None, MappedFeederUnit]:
        """The registers of each unit, by its id; None for the device's own."""
        return {unit: MappedFeederUnit(self, unit) for unit in self.tables}

    def values(self, unit: int | None) -> dict[str, RegisterValue]:
        """The value of every row of a unit now, by its name in the unit."""
        time_s = self.device.advance_to_now()
        system = register_values(self.device, 0, time_s)
        hoppers = {channel: register_values(self.device, channel, time_s)
                   for channel in self.device.hoppers if channel in self.map.channels}
        found: dict[str, RegisterValue] = {}
        for place, row in self.map.placed_rows():
            if place == unit:
                found[row.name] = self.held.get(row.name, 0 if row.type is not (
                    RegisterType.ASCII) else "")
        for name, quantity in self.feeder_map.quantities.items():
            if name in _DEVICE_SOURCES and quantity.register in found:
                value = self._alarm(system) if name == "alarm_code" else (
                    system[_DEVICE_SOURCES[name]])
                found[quantity.register] = None if value is None else (
                    quantity.to_register(float(value)))
        for channel, values in hoppers.items():
            for name, quantity in self.feeder_map.hopper_quantities.items():
                hopper_row = row_name(quantity.register, channel)
                if name in _HOPPER_SOURCES and hopper_row in found:
                    value = values[_HOPPER_SOURCES[name]]
                    found[hopper_row] = None if not isinstance(value, int | float) else (
                        quantity.to_register(value))
        self._put_conditions(found, system, hoppers)
        if self.map.identity is not None and unit is None:
            found[self.map.identity.register] = self.map.identity.value
        if self.feeder_map.applied is not None and unit is None:
            found[self.feeder_map.applied] = system["SEQ_APPLIED"]
        return found

    def write(self, unit: int | None, written: Mapping[str, RegisterValue]) -> None:
        """Carry out a write of rows, by their names in the unit. Raises ExceptionReplyError."""
        self.held |= written
        fm = self.feeder_map
        self.device.holding.set_raw_word("SETPOINT_MODE", SetpointMode.G_MIN)
        for name, target in _TIME_TARGETS.items():
            if (quantity := fm.quantities.get(name)) and quantity.register in written:
                self._write_pmx(target, quantity.from_register(written[quantity.register]))
        if fm.watchdog_timeout in written:
            row = self.tables[None][str(fm.watchdog_timeout)]
            time = written[row.name]
            self._write_pmx("WD_TIMEOUT", _number(time) * (1 if row.unit == "ms" else 1000))
        if fm.heartbeat in written:
            self._write_pmx("HEARTBEAT", _number(written[str(fm.heartbeat)]))
        recipe = False
        for channel in self.device.hoppers:
            for name, target in _SETPOINT_TARGETS.items():
                setpoint = fm.hopper_quantities.get(name)
                if setpoint and (row_of := row_name(setpoint.register, channel)) in written:
                    value = setpoint.from_register(written[row_of]) or 0.0
                    self._write_pmx(hopper_register_name(channel, target), max(0.0, value))
                    recipe = True
        if fm.commit is not None and fm.commit in written:
            self._write_pmx("SEQ", _number(written[fm.commit]))
        elif recipe and fm.commit is None:
            self._sequence = self._sequence % 0xFFFF + 1
            self._write_pmx("SEQ", self._sequence)
        if any(self._is_written(action, written) for action in fm.commands.get("alarm_reset", ())):
            self.device.write(PMX_MAP.wire_address("WD_RESET"),
                              [WATCHDOG_RESET_KEY, ALARM_RESET_KEY])
        commanded = any(self._is_written(action, written) for name in _COMMAND_TARGETS
                        for action in fm.commands.get(name, ()))
        if commanded or (recipe and "feed" in fm.missing):
            self._obey()

    def _write_pmx(self, name: str, value: float | None) -> None:
        self.device.write(PMX_MAP.wire_address(name), PMX_MAP.encode(name, value or 0))

    def _obey(self) -> None:
        """Give the device the command word that the rows make together."""
        fm, command = self.feeder_map, FeederCommandBits(0)
        for name, bit in _COMMAND_TARGETS.items():
            if self._is_on(fm.commands.get(name, ())):
                command |= bit
        if "remote" in fm.missing:
            command |= FeederCommandBits.ENABLE_REMOTE
        if "gas" in fm.missing:
            command |= FeederCommandBits.GAS_ON
        if "feed" in fm.missing and any(
            self.device.holding[hopper_register_name(channel, "FLOW_SP")] > 0
            for channel in self.device.hoppers
        ):
            command |= FeederCommandBits.FEED_ON
        if "post_flow" in fm.missing:  # the host times it
            self.device.holding.set_raw_word("POSTFLOW", 0)
        self.device.write(PMX_MAP.wire_address("COMMAND"), [int(command)])

    def _is_on(self, actions: Sequence[MappedAction]) -> bool:
        """Whether all of a command's writes are on: of a register that each hopper has, any."""
        def is_on(action: MappedAction, row: str) -> bool:
            value = int(_number(self.held.get(row, 0)))
            return bool(value & action.mask) if action.mask else value == action.on

        return bool(actions) and all(
            any(is_on(action, row) for row in self._rows_of(action)) for action in actions)

    def _is_written(self, action: MappedAction, written: Mapping[str, RegisterValue]) -> bool:
        rows = [row for row in self._rows_of(action) if row in written]
        if action.off is None or not rows:  # a reset acts on its own value only
            return any(written[row] == action.on for row in rows)
        return True

    def _rows_of(self, action: MappedAction) -> list[str]:
        if not action.in_hopper:
            return [action.register]
        return [row_name(action.register, channel) for channel in self.map.channels]

    def _alarm(self, system: Mapping[str, RegisterValue]) -> RegisterValue:
        """The device's code for the alarm of a PMX: its own list, else the first of it."""
        code = system["FIRST_ALARM_CODE"]
        known = [alarm.code for alarm in self.feeder_map.alarms if alarm.code is not None]
        return code if not code or not known or code in known else known[0]

    def _put_conditions(
        self, found: dict[str, RegisterValue], system: Mapping[str, RegisterValue],
        hoppers: Mapping[int, Mapping[str, RegisterValue]],
    ) -> None:
        """Set bits and codes so that every condition is met where it is true."""
        status = int(_number(system["STATUS"]))
        wanted: dict[str, list[tuple[MappedCondition, bool]]] = {}
        conditions = [(condition, bool(status & _STATUS_SOURCES[name]))
                      for name, condition in self.feeder_map.conditions.items()]
        shown = [alarm.condition for alarm in self.feeder_map.alarms if alarm.condition]
        conditions += [(condition, bool(status & FeederStatusBits.ALARM) and at == 0)
                       for at, condition in enumerate(shown)]
        for condition, is_true in conditions:
            channels = list(hoppers) if condition.in_hopper else [None]
            for channel in channels:
                wanted.setdefault(row_name(condition.register, channel), []).append(
                    (condition, is_true))
        for channel, values in hoppers.items():
            flags = int(_number(values["STATUS"]))
            for name, condition in self.feeder_map.hopper_conditions.items():
                wanted.setdefault(row_name(condition.register, channel), []).append(
                    (condition, bool(flags & _HOPPER_STATUS_SOURCES[name])))
        for row, those in wanted.items():
            if row in found:
                found[row] = self._word(row, int(_number(found[row])), those)

    def _word(self, row: str, held: int, those: Sequence[tuple[MappedCondition, bool]]) -> int:
        """A word that meets those conditions that are true: bits one by one, a code by trying."""
        word = held if row in self.held else 0
        for condition, is_true in those:
            if condition.mask:
                lowest = condition.mask & -condition.mask
                word = word | lowest if is_true is not condition.inverted else (
                    word & ~condition.mask)
        by_code = [one for one in those if not one[0].mask]
        if by_code:
            name = row.partition(".")[2] or row
            codes = {0, *self.map.codes.get(name, {}).values(),
                     *(code for condition, _ in by_code for code in condition.codes)}
            word = max(sorted(codes), key=lambda code: sum(
                condition.is_met(code) is is_true for condition, is_true in by_code))
        return word


class MappedFeederUnit:
    """The registers that answer under one unit id. unit : None for the device's own"""

    def __init__(self, feeder: MappedFeederDevice, unit: int | None) -> None:
        self._feeder = feeder
        self._unit = unit
        table = feeder.tables[unit]
        self._table = table
        self._rows: dict[tuple[RegisterSpace, int], Register] = {}
        for row in table.rows:
            first = table.wire_address(row.name)
            for address in range(first, first + row.word_count):
                self._rows[row.space, address] = row

    @property
    def device_id(self) -> int:
        return self._feeder.device.config.device_id if self._unit is None else self._unit

    def read_input(self, address: int, count: int) -> list[int]:
        return self._read(RegisterSpace.INPUT, address, count)

    def read_holding(self, address: int, count: int) -> list[int]:
        return self._read(RegisterSpace.HOLDING, address, count)

    def read_coils(self, address: int, count: int) -> list[int]:
        return self._read(RegisterSpace.COIL, address, count)

    def read_discrete(self, address: int, count: int) -> list[int]:
        return self._read(RegisterSpace.DISCRETE, address, count)

    def write_coils(self, address: int, bits: Sequence[int]) -> None:
        self._write(RegisterSpace.COIL, address, bits)

    def write(self, address: int, words: Sequence[int]) -> None:
        self._write(RegisterSpace.HOLDING, address, words)

    def _write(self, space: RegisterSpace, address: int, words: Sequence[int]) -> None:
        """Whole writable rows, all of them or none."""
        rows = self._rows_between(space, address, len(words))
        values: dict[str, RegisterValue] = {}
        for row in rows:
            first = self._table.wire_address(row.name) - address
            own = words[max(first, 0) : first + row.word_count]
            if not row.writable or len(own) != row.word_count:
                raise ExceptionReplyError(ILLEGAL_ADDRESS)
            value = self._table.decode(row.name, own)
            try:
                self._table.encode(row.name, value)
            except RegisterError:
                raise ExceptionReplyError(ILLEGAL_VALUE) from None
            values[row.name] = value
        self._feeder.write(self._unit, values)

    def _read(self, space: RegisterSpace, address: int, count: int) -> list[int]:
        rows = self._rows_between(space, address, count)
        values = self._feeder.values(self._unit)
        words: dict[int, int] = {}
        for row in rows:
            first = self._table.wire_address(row.name)
            encoded = self._table.encode(row.name, _fitting(row, values[row.name]))
            words |= dict(enumerate(encoded, first))
        return [words[at] for at in range(address, address + count)]

    def _rows_between(self, space: RegisterSpace, address: int, count: int) -> list[Register]:
        try:
            rows = [self._rows[space, at] for at in range(address, address + count)]
        except KeyError:
            raise ExceptionReplyError(ILLEGAL_ADDRESS) from None
        return list(dict.fromkeys(rows))


def _fitting(row: Register, value: RegisterValue) -> RegisterValue:
    """A value within what the row holds; 0 for none where it cannot say so."""
    if value is None:
        return None if row.may_be_unavailable else 0
    if not isinstance(value, int | float) or row.type is RegisterType.F32:
        return value
    low, high = row.type.least / row.counts_per_unit, row.type.greatest / row.counts_per_unit
    if row.may_be_unavailable and row.type is not RegisterType.BITS:
        high = (row.type.greatest - 1) / row.counts_per_unit
    if row.minimum is not None:
        low = max(low, row.minimum)
    if row.maximum is not None:
        high = min(high, row.maximum)
    bounded = min(max(value, low), high)
    return int(bounded) if row.type is RegisterType.BITS else float(bounded)


def _number(value: RegisterValue) -> float:
    return float(value) if isinstance(value, int | float) else 0.0
