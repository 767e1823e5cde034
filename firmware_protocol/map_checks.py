"""Contradictions within a register map: overlaps, impossible scales, features without a place."""

from __future__ import annotations

from collections.abc import Iterator

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.feeder_map import (
    HOPPER_QUANTITIES,
    SETPOINTS,
    SUBSTITUTES,
    WRITTEN_QUANTITIES,
    FeederMap,
    MappedAction,
)
from firmware_protocol.registers import (
    Register,
    RegisterError,
    RegisterMap,
    RegisterSpace,
    RegisterType,
)

_READ_CODE, _WRITE_CODE = 3, 16
#: Function codes by which each space is read, and in words; and the one that writes coils.
_READ_CODES = {
    RegisterSpace.INPUT: (4, "an input register"), RegisterSpace.HOLDING: (3, "a holding register"),
    RegisterSpace.COIL: (1, "a coil"), RegisterSpace.DISCRETE: (2, "a discrete input")}
_WRITE_COIL_CODE = 15


def find_register_contradictions(device: DeviceMap) -> Iterator[str]:
    """Each contradiction among registers, as "place: reason"."""
    names = [row.name for row in device.rows] + [one.register.name for one in device.hopper_rows]
    for name in dict.fromkeys(names):
        if names.count(name) > 1:
            yield f"register {name!r}: {names.count(name)} registers have this name"
    for row in (*device.rows, *(one.register for one in device.hopper_rows)):
        for reason in _row_contradictions(row, device):
            yield f"register {row.name!r}: {reason}"
    yield from _overlaps(device)
    for code in (_READ_CODE, _WRITE_CODE):
        if code not in device.function_codes:
            yield f"function_codes: no device can be driven without {code}"


def _row_contradictions(row: Register, device: DeviceMap) -> Iterator[str]:
    code, what = _READ_CODES[row.space]
    if row.space is not RegisterSpace.HOLDING and code not in device.function_codes:
        other = "put it into holding registers, or " if row.space is RegisterSpace.INPUT else ""
        yield f"it is {what}, and function_codes lacks {code}: {other}add {code}"
    if row.writable and row.space in (RegisterSpace.INPUT, RegisterSpace.DISCRETE):
        yield f"{what} cannot be written"
    if row.writable and row.space is RegisterSpace.COIL and (
        _WRITE_COIL_CODE not in device.function_codes
    ):
        yield f"it is a coil to write, and function_codes lacks {_WRITE_COIL_CODE}"
    if row.space.has_bits is not (row.type is RegisterType.BIT):
        yield (f"{what} is of type bit, not {row.type.name.lower()}" if row.space.has_bits else
               'type bit is for space = "coil" and "discrete"; bits in a register are of type bits')
    if row.space.has_bits:
        yield from _bit_contradictions(row, what)
    base = {RegisterSpace.INPUT: device.input_base, RegisterSpace.HOLDING: device.holding_base,
            RegisterSpace.COIL: device.coil_base,
            RegisterSpace.DISCRETE: device.discrete_base}[row.space]
    first = row.address - base
    if first < 0 or first + row.word_count > 0x1_0000:
        yield (f"address {row.address} is wire address {first} with base {base}, "
               "outside 0 to 65535")
    if row.word_count > device.max_registers:
        yield f"it takes {row.word_count} registers, and max_registers is {device.max_registers}"
    if row.minimum is not None and row.maximum is not None and row.minimum > row.maximum:
        yield f"minimum {row.minimum:g} is above maximum {row.maximum:g}"
    if row.type in (RegisterType.BITS, RegisterType.ASCII, RegisterType.F32) and (
        row.counts_per_unit != 1
    ):
        yield f"a value of type {row.type.name.lower()} has no counts_per_unit"
        return
    if row.type in (RegisterType.ASCII, RegisterType.F32) or row.space.has_bits:
        return
    low, high = row.type.least, row.type.greatest
    for limit, value in (("minimum", row.minimum), ("maximum", row.maximum)):
        if value is not None and not low <= round(value * row.counts_per_unit) <= high:
            yield (f"{limit} {value:g} {row.unit}".rstrip() + f" takes "
                   f"{value * row.counts_per_unit:g} counts at {row.counts_per_unit:g} counts per "
                   f"unit, and {row.type.name.lower()} holds {low} to {high}")


def _bit_contradictions(row: Register, what: str) -> Iterator[str]:
    """Keys of numbers, which a single bit has none of."""
    given = {
        "counts_per_unit": row.counts_per_unit != 1, "unit": bool(row.unit),
        "minimum": row.minimum is not None, "maximum": row.maximum is not None,
        "may_be_unavailable": row.may_be_unavailable, "length": bool(row.length)}
    for key in (key for key, is_given in given.items() if is_given):
        yield f"{what} is one bit: it has no {key}"


def _overlaps(device: DeviceMap) -> Iterator[str]:
    taken: dict[tuple[int | None, RegisterSpace, int], str] = {}
    found: set[tuple[str, str]] = set()
    for unit, row in device.placed_rows():
        for address in range(row.address, row.address + row.word_count):
            other = taken.setdefault((unit, row.space, address), row.name)
            if other != row.name and (other, row.name) not in found:
                found.add((other, row.name))
                register = "" if row.space.has_bits else " register"
                yield (f"register {row.name!r}: overlaps {other!r} at {row.space.value}{register} "
                       f"{address}")


def find_feeder_contradictions(device: DeviceMap, feeder: FeederMap) -> Iterator[str]:
    """Each contradiction in what the map says of its registers."""
    yield from _feature_contradictions(device, feeder)
    if "flow_setpoint_g_min" not in feeder.hopper_quantities:
        yield "hopper_values.flow_setpoint_g_min: is missing: no feeder is driven without it"
    for setpoint in SETPOINTS:
        quantity = feeder.hopper_quantities.get(setpoint)
        if quantity is None:
            continue
        if not _row(device, quantity.register).writable:
            yield f"hopper_values.{setpoint}: register {quantity.register!r} is not writable"
        if setpoint not in feeder.recipe_order:
            yield f"recipe.order: lacks {setpoint}, which hopper_values has"
    for name in WRITTEN_QUANTITIES:
        written = feeder.quantities.get(name)
        if written is not None and not _row(device, written.register).writable:
            yield f"values.{name}: register {written.register!r} is not writable"
    for key, row_name in (
        ("recipe.commit", feeder.commit), ("watchdog.heartbeat", feeder.heartbeat),
        ("watchdog.timeout", feeder.watchdog_timeout),
    ):
        if row_name is not None and not _row(device, row_name).writable:
            yield f"{key}: register {row_name!r} is not writable"
    for key, row_name in (
        ("recipe.commit", feeder.commit), ("recipe.applied", feeder.applied),
        ("watchdog.timeout", feeder.watchdog_timeout),
    ):
        if row_name is not None and _row(device, row_name).space.has_bits:
            yield f"{key}: register {row_name!r} is one bit, and a number is needed"
    if device.identity is not None and _row(device, device.identity.register).space.has_bits:
        yield f"identity.register: {device.identity.register!r} is one bit, and tells no device"
    for key, meanings in (("bits", device.bits), ("codes", device.codes)):
        for name in meanings:
            if _row(device, name).space.has_bits:
                yield f"{key}.{name}: it is one bit already, and has no {key} to name"
    if feeder.commit is not None and feeder.applied is None:
        yield ("recipe.applied: is missing: the register that shows which recipe runs belongs to "
               "commit")
    if feeder.watchdog_timeout is not None:
        if feeder.heartbeat is None:
            yield "watchdog.timeout: means nothing without watchdog.heartbeat"
        if _row(device, feeder.watchdog_timeout).unit not in ("ms", "s"):
            yield f"watchdog.timeout: register {feeder.watchdog_timeout!r} must be in ms or s"
    for command, actions in feeder.commands.items():
        for action in actions:
            yield from _action_contradictions(device, command, action)
    for name, value in feeder.settings:
        if reason := _unwritable_value(device, name, value):
            yield f"setting: {reason}"
    codes = [alarm.code for alarm in feeder.alarms if alarm.code is not None]
    for code in sorted({code for code in codes if codes.count(code) > 1}):
        yield f"alarm: two alarms have code {code}"
    if codes and "alarm_code" not in feeder.quantities:
        yield "values.alarm_code: is missing: alarms are listed by code, and no register shows one"


def _feature_contradictions(device: DeviceMap, feeder: FeederMap) -> Iterator[str]:
    """Every feature is either in registers or declared missing, and not both."""
    provided = feeder.provided_features() | ({"identity"} if device.identity else set())
    for feature, ways in SUBSTITUTES.items():
        if feature in provided and feature in feeder.missing:
            yield f"missing.{feature}: the map has registers for it, too: take one of them out"
        if feature not in provided and feature not in feeder.missing:
            way = next(iter(ways))
            yield (f"{_PLACES[feature]}: is missing; if the device has none, write {feature} = "
                   f'"{way}" under [missing]: {ways[way]}')


#: Where the registers of a feature are named.
_PLACES = {
    "identity": "identity", "atomic_recipe": "recipe.commit", "watchdog": "watchdog.heartbeat",
    "remote": "conditions.remote", "feed": "commands.feed", "gas": "commands.gas",
    "gas_ok": "conditions.gas_ok", "feeding": "conditions.feeding",
    "stable": "conditions.stable", "post_flow": "values.post_flow_s",
    "flow": "hopper_values.flow_g_min", "alarm": "values.alarm_code", "clock": "values.tick_ms",
}


def _action_contradictions(
    device: DeviceMap, command: str, action: MappedAction
) -> Iterator[str]:
    for value in (action.on, action.off):
        if not action.mask and value is not None and (
            reason := _unwritable_value(device, action.register, value)
        ):
            yield f"commands.{command}: {reason}"
    if not action.mask and action.off is None and command not in ("alarm_reset",):
        yield f"commands.{command}: register {action.register!r} has `on` and no `off`"


def _unwritable_value(device: DeviceMap, name: str, value: float) -> str:
    """Why a register cannot hold a value; "" where it can."""
    row = _row(device, name)
    try:
        RegisterMap([row], input_base=device.input_base, holding_base=device.holding_base,
                    coil_base=device.coil_base, discrete_base=device.discrete_base
                    ).encode(name, value)
    except RegisterError as error:
        return str(error)
    return ""


def _row(device: DeviceMap, name: str) -> Register:
    """A row by its name in the file; a row that is not there is reported where it is named."""
    for row in (*device.rows, *(one.register for one in device.hopper_rows)):
        if row.name == name:
            return row
    return Register(name, RegisterSpace.HOLDING, 0, unit="ms", writable=True)


def describe_map(device: DeviceMap) -> str:
    """A map in a line of words."""
    n_rows = len(device.rows) + len(device.hopper_rows)
    words = [f"{n_rows} registers"]
    rows = [*device.rows, *(one.register for one in device.hopper_rows)]
    if n_bits := sum(row.space.has_bits for row in rows):
        words = [f"{n_rows - n_bits} registers, {n_bits} coils and discrete inputs"]
    if device.feeder is not None:
        known = sum(name in device.feeder.hopper_quantities for name in HOPPER_QUANTITIES)
        words += [f"{device.hoppers} hoppers", f"{known} quantities of each"]
    return ", ".join(words)


