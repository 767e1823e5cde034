"""Reads what a feeder's map file says of its registers: quantities, conditions, commands.

Source: docs/reference/device-maps.md.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from firmware_protocol.device_map import DeviceMap
from firmware_protocol.feeder_map import (
    COMMANDS,
    DEVICE_CONDITIONS,
    DEVICE_QUANTITIES,
    HOPPER_CONDITIONS,
    HOPPER_QUANTITIES,
    SETPOINTS,
    SUBSTITUTES,
    UNIT_FACTORS,
    FeederMap,
    MappedAction,
    MappedAlarm,
    MappedCondition,
    MappedQuantity,
)
from firmware_protocol.registers import Register, RegisterType
from firmware_protocol.table_reader import TableReader

#: Tables of a feeder's map beside its registers.
FEEDER_TABLES = ("values", "hopper_values", "conditions", "hopper_conditions", "commands",
                 "recipe", "watchdog", "setting", "alarm", "refusal", "missing")


def read_feeder_map(top: TableReader, device: DeviceMap) -> FeederMap:
    """The tables of a feeder; mistakes are reported to `top`."""
    rows = _Rows(device)
    recipe, watchdog = top.table("recipe", {}), top.table("watchdog", {})
    found = FeederMap(
        quantities=_quantities(top.table("values", {}), rows, DEVICE_QUANTITIES, in_hopper=False),
        hopper_quantities=_quantities(
            top.table("hopper_values", {}), rows, HOPPER_QUANTITIES, in_hopper=True),
        conditions=_conditions(top.table("conditions", {}), rows, DEVICE_CONDITIONS),
        hopper_conditions=_conditions(
            top.table("hopper_conditions", {}), rows, HOPPER_CONDITIONS, in_hopper=True),
        commands=_commands(top.table("commands", {}), rows),
        settings=tuple(_setting(table, rows) for table in top.tables("setting")),
        recipe_order=_order(recipe),
        commit=_optional_row(recipe, "commit", rows),
        applied=_optional_row(recipe, "applied", rows),
        heartbeat=_optional_row(watchdog, "heartbeat", rows),
        watchdog_timeout=_optional_row(watchdog, "timeout", rows),
        alarms=tuple(_alarm(table, rows) for table in top.tables("alarm")),
        refusals=dict(_refusal(table) for table in top.tables("refusal")),
        missing=_missing(top.table("missing", {})),
    )
    recipe.report_unknown_keys()
    watchdog.report_unknown_keys()
    return found


def unknown_row(name: str, names: Iterable[str]) -> str:
    """That the map has no such register, and which one may have been meant."""
    from difflib import get_close_matches  # needed for mistakes only

    near = get_close_matches(name, list(names), n=1)
    return f"there is no register {name!r}" + (f"; did you mean {near[0]!r}?" if near else "")


class _Rows:
    """The rows of a map by name, and the meanings of their bits and codes."""

    def __init__(self, device: DeviceMap) -> None:
        self.of_device = {row.name: row for row in device.rows}
        self.of_hopper = {one.register.name: one.register for one in device.hopper_rows}
        self.device = device

    def named(self, table: TableReader, key: str, name: str) -> Register | None:
        row = self.of_device.get(name) or self.of_hopper.get(name)
        if row is None and name != "?":
            table.report_mistake(key, unknown_row(name, [*self.of_device, *self.of_hopper]))
        return row

    def is_in_hopper(self, name: str) -> bool:
        return name in self.of_hopper

    def numbers(
        self, table: TableReader, key: str, row: str, meanings: Mapping[str, Mapping[str, int]],
        most: int,
    ) -> tuple[int, ...]:
        """Numbers of bits or codes that are given as such, or by their names in the map."""
        known, found = meanings.get(row, {}), []
        for one in table.names_or_integers(key):
            number = known.get(one) if isinstance(one, str) else one
            if number is None:
                there = f"; it has {', '.join(known)}" if known else ""
                table.report_mistake(key, f"register {row!r} has no {one!r}{there}")
            elif number > most:
                table.report_mistake(key, f"must be at most {most}, not {number}")
            else:
                found.append(number)
        return tuple(found)

    def mask(self, table: TableReader, row: Register) -> int:
        """The bits named by the key `bit`."""
        bits = self.numbers(table, "bit", row.name, self.device.bits, 15)
        if row.type is RegisterType.BIT:
            table.report_mistake("bit", f"register {row.name!r} is one bit already: leave it out")
        elif row.word_count != 1 or row.type is RegisterType.F32:
            table.report_mistake("bit", f"register {row.name!r} is no word of bits")
        return sum(1 << bit for bit in set(bits))


def _quantities(
    table: TableReader, rows: _Rows, known: Mapping[str, str], *, in_hopper: bool
) -> dict[str, MappedQuantity]:
    found = {}
    for name, unit in known.items():
        if not table.has_key(name):
            continue
        quantity = _quantity(table, name, unit, rows)
        if quantity is None:
            continue
        if quantity.in_hopper is not in_hopper:
            wanted = "each hopper has" if in_hopper else "the device has"
            table.report_mistake(name, f"must be a register that {wanted}")
        found[name] = quantity
    table.report_unknown_keys()
    return found


def _quantity(table: TableReader, key: str, unit: str, rows: _Rows) -> MappedQuantity | None:
    """A quantity: the name of its row, or a table with `register`, `zero` and `full_scale`."""
    zero, full_scale = 0.0, None
    if table.is_table(key):
        inner = table.table(key)
        name = inner.text("register")
        zero = inner.number("zero", 0.0)
        full_scale = inner.number("full_scale", above=0)
        inner.report_unknown_keys()
    else:
        name = table.text(key)
    row = rows.named(table, key, name)
    if row is None:
        return None
    if row.type in (RegisterType.ASCII, RegisterType.BITS, RegisterType.BIT):
        table.report_mistake(key, f"register {name!r} holds no number")
    factor = 1.0
    if full_scale is not None:
        if row.maximum is None or row.maximum <= zero:
            table.report_mistake(
                key, f"full_scale needs `maximum` of register {name!r}, above zero ({zero:g})")
        else:
            factor = full_scale / (row.maximum - zero)
    elif unit and row.unit not in UNIT_FACTORS[unit]:
        table.report_mistake(
            key, f"register {name!r} is in {row.unit or 'no unit'}; {unit} can be made of "
            f"{', '.join(UNIT_FACTORS[unit])}, or of anything by `full_scale`")
    elif unit:
        factor = UNIT_FACTORS[unit][row.unit]
    return MappedQuantity(name, rows.is_in_hopper(name), zero, factor)


def _conditions(
    table: TableReader, rows: _Rows, known: tuple[str, ...], *, in_hopper: bool = False
) -> dict[str, MappedCondition]:
    found = {}
    for name in known:
        if not table.has_key(name):
            continue
        inner = table.table(name)
        condition = _condition(inner, rows)
        if condition is not None:
            if in_hopper and not condition.in_hopper:
                inner.report_mistake("register", "must be a register that each hopper has")
            found[name] = condition
        inner.report_unknown_keys()
    table.report_unknown_keys()
    return found


def _condition(table: TableReader, rows: _Rows) -> MappedCondition | None:
    """`register` with `bit` or `is`, alone for a coil or a discrete input; `inverted`; `of` for
    registers of hoppers."""
    name = table.text("register")
    row = rows.named(table, "register", name)
    inverted = table.boolean("inverted", False)
    of_all = table.choice("of", ("any", "all"), "any") == "all"
    if row is None:
        table.names_or_integers("bit")
        table.names_or_integers("is")
        return None
    mask = 0
    codes: tuple[int, ...] = ()
    if row.type is RegisterType.BIT and not table.has_key("bit") and not table.has_key("is"):
        mask = 1
    elif table.has_key("bit") is table.has_key("is"):
        table.report_mistake("", "needs either `bit` or `is`")
    elif table.has_key("bit"):
        mask = rows.mask(table, row)
    else:
        codes = rows.numbers(table, "is", name, rows.device.codes, 65_535)
    return MappedCondition(name, rows.is_in_hopper(name), mask, codes, inverted, of_all)


def _commands(table: TableReader, rows: _Rows) -> dict[str, tuple[MappedAction, ...]]:
    found = {}
    for name in COMMANDS:
        if not table.has_key(name):
            continue
        actions = [_action(one, rows) for one in table.tables(name)]
        if not actions:
            table.report_mistake(name, "has no writes: a list of tables is needed")
        found[name] = tuple(action for action in actions if action is not None)
    table.report_unknown_keys()
    return found


def _action(table: TableReader, rows: _Rows) -> MappedAction | None:
    """`register` with `bit`, with `on` and `off`, or with `on` alone; of a coil alone, which is
    then 1 while the command is on."""
    name = table.text("register")
    row = rows.named(table, "register", name)
    on = table.names_or_integers("on")
    off = table.names_or_integers("off")
    action = None
    if row is not None:
        is_coil = row.type is RegisterType.BIT and not table.has_key("bit")
        if not is_coil and table.has_key("bit") is table.has_key("on"):
            table.report_mistake("", "needs either `bit`, or `on` and mostly `off`")
        if not row.writable:
            table.report_mistake("register", f"register {name!r} is not writable")
        mask = rows.mask(table, row) if table.has_key("bit") else 0
        on_codes = rows.numbers(table, "on", name, rows.device.codes, 65_535) if on else (1,)
        off_codes = rows.numbers(table, "off", name, rows.device.codes, 65_535) if off else ()
        ends_at_0 = mask or (is_coil and not table.has_key("on"))
        action = MappedAction(name, rows.is_in_hopper(name), mask, on_codes[0] if on_codes else 1,
                              0 if ends_at_0 else off_codes[0] if off_codes else None)
    else:
        table.names_or_integers("bit")
    table.report_unknown_keys()
    return action


def _setting(table: TableReader, rows: _Rows) -> tuple[str, float]:
    name, value = table.text("register"), table.number("value")
    row = rows.named(table, "register", name)
    if row is not None and not row.writable:
        table.report_mistake("register", f"register {name!r} is not writable")
    table.report_unknown_keys()
    return name, value


def _order(table: TableReader) -> tuple[str, ...]:
    order = table.texts("order", SETPOINTS)
    for name in order:
        if name not in SETPOINTS:
            table.report_mistake("order", f"{name!r} is no set-point; {' and '.join(SETPOINTS)} "
                                          "are")
    return order


def _optional_row(table: TableReader, key: str, rows: _Rows) -> str | None:
    if not table.has_key(key):
        return None
    name = table.text(key)
    row = rows.named(table, key, name)
    if row is not None and rows.is_in_hopper(name):
        table.report_mistake(key, "must be a register that the device has")
    return name


def _alarm(table: TableReader, rows: _Rows) -> MappedAlarm:
    text, remedy = table.text("text"), table.text("remedy", "see the feeder's manual")
    has_code, has_condition = table.has_key("code"), table.has_key("register")
    if has_code is has_condition:
        table.report_mistake("", "needs either `code`, or `register` of a condition that shows it")
    code = table.integer("code", least=1, most=65_535) if has_code else None
    condition = _condition(table, rows) if has_condition else None
    table.report_unknown_keys()
    return MappedAlarm(text, remedy, code, condition)


def _refusal(table: TableReader) -> tuple[int, str]:
    code, text = table.integer("code", least=1, most=65_535), table.text("text")
    table.report_unknown_keys()
    return code, text


def _missing(table: TableReader) -> dict[str, str]:
    found = {}
    for feature, ways in SUBSTITUTES.items():
        if table.has_key(feature):
            found[feature] = table.choice(feature, ways)
    table.report_unknown_keys()
    return found
