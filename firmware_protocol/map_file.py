"""Reads the register map of a device from TOML, with all its mistakes at once.

Source: docs/reference/device-maps.md.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from firmware_protocol.device_map import DeviceIdentity, DeviceMap, HopperRow
from firmware_protocol.map_checks import find_feeder_contradictions, find_register_contradictions
from firmware_protocol.map_meanings import read_feeder_map, unknown_row
from firmware_protocol.registers import (
    MAX_READ_REGISTERS,
    Register,
    RegisterSpace,
    RegisterType,
    WordOrder,
)
from firmware_protocol.table_reader import TableReader

#: Maps that ship, by the name that a profile may give in place of a file.
SHIPPED_MAPS = ("pmx", "sio")
DEVICES = ("feeder", "safety")
MAX_BYTES = 1_000_000
_FUNCTION_CODES = (1, 2, 3, 4, 15, 16, 23)
_USUAL_CODES = (3, 4, 16, 23)
_MAX_HOPPERS = 4

_SPACES = {space.value: space for space in RegisterSpace}
_TYPES = {kind.name.lower(): kind for kind in RegisterType}


class MapFileError(ValueError):
    """The text is no register map, or contradicts itself; one line per mistake."""

    def __init__(self, mistakes: Iterable[str]) -> None:
        self.mistakes = tuple(mistakes)
        super().__init__("\n".join(self.mistakes))


def load_map(path: Path) -> DeviceMap:
    """Read a map file. Raises OSError where it cannot be read; MapFileError."""
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise MapFileError([f"larger than {MAX_BYTES:,} bytes"])
    try:
        return parse_map(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise MapFileError([f"not text: byte {error.start} is not UTF-8"]) from None


@cache
def shipped_map(name: str) -> DeviceMap:
    """One of `SHIPPED_MAPS`."""
    return load_map(Path(__file__).parent / "maps" / f"{name}.toml")


def parse_map(text: str) -> DeviceMap:
    """The map in a text. Raises MapFileError with every mistake, each with the path of its key."""
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise MapFileError([f"not valid TOML: {str(error)[:200]}"]) from None
    mistakes: list[str] = []
    found = _device_map(TableReader(data, "", mistakes))
    if mistakes:
        raise MapFileError(mistakes)
    return found


def _device_map(top: TableReader) -> DeviceMap:
    known = len(top.mistakes)
    name = top.text("name")
    device = top.choice("device", DEVICES)
    description = top.text("description") if top.has_key("description") else ""
    hoppers = top.integer("hoppers", 1, least=1, most=_MAX_HOPPERS)
    input_base = top.integer("input_base", 0, least=0, most=65_536)
    holding_base = top.integer("holding_base", 0, least=0, most=65_536)
    coil_base = top.integer("coil_base", 0, least=0, most=65_536)
    discrete_base = top.integer("discrete_base", 0, least=0, most=65_536)
    word_order = WordOrder(top.choice("word_order", [one.value for one in WordOrder], "ABCD"))
    codes = top.integers("function_codes", _USUAL_CODES, least=1, most=23)
    max_registers = top.integer(
        "max_registers", MAX_READ_REGISTERS, least=1, most=MAX_READ_REGISTERS)
    hopper_unit = top.integer("hopper_unit", least=1, most=247 - _MAX_HOPPERS + 1) if (
        top.has_key("hopper_unit")) else None
    for code in codes:
        if code not in _FUNCTION_CODES:
            top.report_mistake("function_codes", f"{code} is not used here; "
                               f"{', '.join(map(str, _FUNCTION_CODES))} are")
    rows = [_register(table) for table in top.tables("register")]
    hopper_rows = [_hopper_row(table, hopper_unit) for table in top.tables("hopper_register")]
    if not rows and not hopper_rows:
        top.report_mistake("register", "there is none: a map lists the device's registers")
    names = [row.name for row in rows] + [one.register.name for one in hopper_rows]
    bits = _meanings(top, "bits", names, 15)
    meanings = _meanings(top, "codes", names, 65_535)
    identity = _identity(top, names) if top.has_key("identity") else None
    found = DeviceMap(
        name, device, tuple(rows), tuple(hopper_rows), description, hoppers, input_base,
        holding_base, coil_base, discrete_base, word_order, codes, max_registers, hopper_unit, bits,
        meanings, identity)
    read_whole = len(top.mistakes) == known
    for mistake in find_register_contradictions(found) if read_whole else ():
        top.report_mistake("", mistake)
    if device == "feeder":
        feeder = read_feeder_map(top, found)
        found = DeviceMap(**{**vars(found), "feeder": feeder})
        if read_whole:
            for mistake in find_feeder_contradictions(found, feeder):
                top.report_mistake("", mistake)
    top.report_unknown_keys()
    return found


def _register(table: TableReader, *, has_own_unit: bool = False) -> Register:
    name = table.text("name")
    space = table.choice("space", _SPACES, "holding")
    address = table.integer("address", least=0, most=131_071)
    kind = table.choice("type", _TYPES, "bit" if _SPACES[space].has_bits else "u16")
    scale = table.number("counts_per_unit", 1.0, above=0)
    length = table.integer("length", 0, least=0, most=MAX_READ_REGISTERS)
    row = Register(
        name, _SPACES[space], address, _TYPES[kind],
        int(scale) if scale.is_integer() else scale,
        table.text("unit") if table.has_key("unit") else "",
        table.text("description") if table.has_key("description") else "",
        writable=table.boolean("writable", False),
        minimum=table.number("minimum") if table.has_key("minimum") else None,
        maximum=table.number("maximum") if table.has_key("maximum") else None,
        may_be_unavailable=table.boolean("may_be_unavailable", False),
        length=length,
    )
    if kind == "ascii" and not length:
        table.report_mistake("length", "is missing: a text needs its number of registers")
    if not has_own_unit:
        table.report_unknown_keys()
    return row


def _hopper_row(table: TableReader, hopper_unit: int | None) -> HopperRow:
    own_unit = hopper_unit is not None
    step = table.integer("step", 0, least=0, most=65_535) if own_unit else (
        table.integer("step", least=1, most=65_535))
    row = _register(table, has_own_unit=True)
    table.report_unknown_keys()
    if own_unit and step:
        table.report_mistake("step", "must be 0: each hopper has its own unit id (hopper_unit)")
    return HopperRow(row, step)


def _meanings(
    top: TableReader, key: str, names: list[str], most: int
) -> Mapping[str, Mapping[str, int]]:
    """The tables [bits.ROW] and [codes.ROW]: names of bits, or of values."""
    found: dict[str, dict[str, int]] = {}
    tables = top.table(key, {})
    for row in tables.key_names():
        table = tables.table(row)
        if row not in names:
            tables.report_mistake(row, unknown_row(row, names))
        found[row] = {
            name: table.integer(name, least=0, most=most) for name in table.key_names()}
    return found


def _identity(top: TableReader, names: list[str]) -> DeviceIdentity:
    table = top.table("identity")
    register = table.text("register")
    value = table.integer("value", least=0, most=2**32 - 1)
    if register != "?" and register not in names:
        table.report_mistake("register", unknown_row(register, names))
    table.report_unknown_keys()
    return DeviceIdentity(register, value)

