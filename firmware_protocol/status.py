"""The status report `<State|field|field...>`: parsed strictly, written as the firmware writes it.

Every field is optional and may come in any order. Fields not known here are kept as they came,
with a value or without one: firmware adds fields from version to version. A report in which a
*known* field is malformed or repeated is discarded: it was damaged on the line.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

CONTROLLER_STATES = frozenset(
    ("Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Check", "Home", "Sleep", "Tool")
)

_INT = re.compile(r"[0-9]{1,9}")
_DECIMAL = r"-?[0-9]{1,9}(?:\.[0-9]{1,9})?"
_NUMBER = re.compile(_DECIMAL)
_POSITION = re.compile(rf"{_DECIMAL}(?:,{_DECIMAL}){{2,7}}")
_KEY = re.compile(r"[!-~]{1,32}")  # of an unknown field: any printable characters but a colon

#: Most reports of a machine at work are of this form, and change in every field.
_USUAL_TEXT = "<%s|MPos:%.3f,%.3f,%.3f|Bf:%d,%d|Ln:%d|FS:%.0f,%.0f>"
_USUAL = re.compile(
    rf"<(Run|Idle)\|MPos:({_DECIMAL}),({_DECIMAL}),({_DECIMAL})\|Bf:([0-9]{{1,9}}),([0-9]{{1,9}})"
    rf"(?:\|Ln:([0-9]{{1,9}}))?\|FS:({_DECIMAL}),({_DECIMAL})>"
)

_Values = tuple[tuple[str, Any], ...]


class StatusReport(NamedTuple):
    """One status report. None means: not in this report.

    machine_mm, work_mm : MPos, WPos, one value an axis (work = machine - offset)
    offset_mm : WCO
    planner_blocks_free, rx_bytes_free : Bf
    line_number : Ln, the N word of the block being executed
    feed_mm_min, spindle_speed : F or FS, actual feed and S; spindle_measured: grblHAL's third value
    override_percents : Ov, feed, rapid, spindle [%]
    active_pins, accessories : Pn, A, the letters as they came ("" is not None)
    unknown_fields : fields not known here, (key, value), in the order they came; the value is None
        where the key comes alone, without a colon
    """

    state: str
    substate: int | None = None
    machine_mm: tuple[float, ...] | None = None
    work_mm: tuple[float, ...] | None = None
    offset_mm: tuple[float, ...] | None = None
    planner_blocks_free: int | None = None
    rx_bytes_free: int | None = None
    line_number: int | None = None
    feed_mm_min: float | None = None
    spindle_speed: float | None = None
    spindle_speed_measured: float | None = None
    override_percents: tuple[int, int, int] | None = None
    active_pins: str | None = None
    accessories: str | None = None
    unknown_fields: tuple[tuple[str, str | None], ...] = ()

    @property
    def is_held(self) -> bool:
        """Held at standstill, or by a door that is closed or open."""
        if self.state == "Hold":
            return self.substate in (None, 0)
        return self.state == "Door" and self.substate in (None, 0, 1)

    def _usual_values(self) -> tuple[Any, ...] | None:
        """The values of `_USUAL_TEXT`, if it has these fields and no others."""
        (state, substate, machine_mm, work_mm, offset_mm, blocks, rx, line, feed, spindle,
         measured, overrides, pins, accessories, other) = self
        if (
            substate is work_mm is offset_mm is measured is overrides is pins is accessories is None
            and machine_mm is not None and len(machine_mm) == 3
            and None not in (blocks, rx, line, feed, spindle) and not other
        ):
            return (state, *machine_mm, blocks, rx, line, feed, spindle)
        return None

    def work_position_mm(self, offset_mm: tuple[float, ...] | None) -> tuple[float, ...] | None:
        """The position in program (work) coordinates; None where it cannot be determined.

        offset_mm : work offset as last reported
        """
        if self.work_mm is not None or self.machine_mm is None or offset_mm is None:
            return self.work_mm
        return tuple([m - o for m, o in zip(self.machine_mm, offset_mm, strict=False)])

    def format(self) -> str:
        """The report as text without line end, fields in the order both firmwares use.

        Lengths with three decimals, rates as whole numbers ($13=0). Which fields appear, and
        when, is the firmware's choice and so the caller's.
        """
        if usual := self._usual_values():
            return _USUAL_TEXT % usual
        parts = [self.state if self.substate is None else f"{self.state}:{self.substate}"]
        if self.machine_mm is not None:
            parts.append(f"MPos:{_lengths(self.machine_mm)}")
        if self.work_mm is not None:
            parts.append(f"WPos:{_lengths(self.work_mm)}")
        if self.planner_blocks_free is not None:
            parts.append(f"Bf:{self.planner_blocks_free},{self.rx_bytes_free}")
        if self.line_number is not None:
            parts.append(f"Ln:{self.line_number}")
        if self.feed_mm_min is not None and self.spindle_speed is None:
            parts.append(f"F:{self.feed_mm_min:.0f}")
        elif self.feed_mm_min is not None:
            rates = f"FS:{self.feed_mm_min:.0f},{self.spindle_speed:.0f}"
            measured = self.spindle_speed_measured
            parts.append(rates if measured is None else f"{rates},{measured:.0f}")
        if self.active_pins is not None:
            parts.append(f"Pn:{self.active_pins}")
        if self.offset_mm is not None:
            parts.append(f"WCO:{_lengths(self.offset_mm)}")
        if self.override_percents is not None:
            parts.append("Ov:{},{},{}".format(*self.override_percents))
        if self.accessories is not None:
            parts.append(f"A:{self.accessories}")
        parts += [key if value is None else f"{key}:{value}" for key, value in self.unknown_fields]
        return f"<{'|'.join(parts)}>"


def parse_status(text: str) -> StatusReport | None:
    """A report from its text `<...>` without line end, or None where it is not a sound report.

    >>> parse_status("<Run|MPos:1.000,0.000,0.000|Ln:7>").line_number
    7
    """
    if usual := _USUAL.fullmatch(text):
        state, x, y, z, blocks, rx, line, feed, spindle = usual.groups()
        return StatusReport(
            state, machine_mm=(float(x), float(y), float(z)), planner_blocks_free=int(blocks),
            rx_bytes_free=int(rx), line_number=int(line) if line else None, feed_mm_min=float(feed),
            spindle_speed=float(spindle),
        )
    if len(text) < 3 or text[0] != "<" or text[-1] != ">":
        return None
    head, *fields = text[1:-1].split("|")
    state, colon, sub = head.partition(":")
    if state not in CONTROLLER_STATES or (colon and not _INT.fullmatch(sub)):
        return None
    found: dict[str, Any] = {"substate": int(sub) if colon else None}
    other: list[tuple[str, str | None]] = []
    for field in fields:
        values = _read_field(field)
        if values is None:
            return None
        for name, value in values:
            if name == "":
                other.append(value)
            elif name in found:
                return None
            else:
                found[name] = value
    return StatusReport(state, unknown_fields=tuple(other), **found)


def _lengths(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:.3f}" for value in values)


@lru_cache(maxsize=256)  # many fields of a report are those of the report before
def _read_field(field: str) -> _Values | None:
    """A field's values by attribute; of an unknown field by ""; None if it is malformed."""
    key, colon, value = field.partition(":")
    if key in _FIELDS:
        return _FIELDS[key](value) if colon else None
    return (("", (key, value if colon else None)),) if _KEY.fullmatch(key) else None


def _position(name: str, value: str) -> _Values | None:
    if not _POSITION.fullmatch(value):
        return None
    return ((name, tuple(map(float, value.split(",")))),)


def _integers(value: str, *names: str) -> _Values | None:
    parts = value.split(",")
    if len(parts) != len(names) or not all(map(_INT.fullmatch, parts)):
        return None
    return tuple(zip(names, map(int, parts), strict=True))


def _rates(value: str, names: tuple[str, ...], least: int) -> _Values | None:
    parts = value.split(",")
    if not least <= len(parts) <= len(names) or not all(map(_NUMBER.fullmatch, parts)):
        return None
    return tuple(zip(names, map(float, parts), strict=False))


def _overrides(value: str) -> _Values | None:
    percent = _integers(value, "feed", "rapid", "spindle_speed")
    return None if percent is None else (("override_percents", tuple(p for _, p in percent)),)


def _letters(name: str, value: str) -> _Values | None:
    return ((name, value),) if value == "" or (value.isascii() and value.isalnum()) else None


_FIELDS: dict[str, Callable[[str], _Values | None]] = {
    "MPos": lambda value: _position("machine_mm", value),
    "WPos": lambda value: _position("work_mm", value),
    "WCO": lambda value: _position("offset_mm", value),
    "Bf": lambda value: _integers(value, "planner_blocks_free", "rx_bytes_free"),
    "Ln": lambda value: _integers(value, "line_number"),
    "F": lambda value: _rates(value, ("feed_mm_min",), 1),
    "FS": lambda value: _rates(value, ("feed_mm_min", "spindle_speed", "spindle_speed_measured"),
                               2),
    "Ov": _overrides,
    "Pn": lambda value: _letters("active_pins", value),
    "A": lambda value: _letters("accessories", value),
}
