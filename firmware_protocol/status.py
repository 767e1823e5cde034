"""The status report `<State|field|field...>`: parsed strictly, written as the firmware writes it.

Every field is optional and may stand in any order; fields not known here are kept as they came.
A report in which a *known* field is malformed or stands twice is not believed at all: it was
damaged on the line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

STATES = frozenset(
    ("Idle", "Run", "Hold", "Jog", "Alarm", "Door", "Check", "Home", "Sleep", "Tool")
)

_INT = re.compile(r"[0-9]{1,9}")
_SIGNED = re.compile(r"-?[0-9]{1,9}(?:\.[0-9]{1,9})?")
_KEY = re.compile(r"[A-Za-z][A-Za-z0-9]{0,15}")


@dataclass(frozen=True, slots=True)
class StatusReport:
    """One status report. None means: not in this report.

    machine_mm, work_mm : MPos, WPos, one value an axis (work = machine - offset)
    offset_mm : WCO
    blocks_free, rx_free : Bf
    line_number : Ln, the N word of the block being executed
    feed_mm_min, spindle : F or FS, actual feed and S; spindle_measured: grblHAL's third value
    overrides : Ov, feed, rapid, spindle [%]
    pins, accessories : Pn, A, the letters as they came ("" is not None)
    other : fields not known here, (key, value), in the order they came
    """

    state: str
    substate: int | None = None
    machine_mm: tuple[float, ...] | None = None
    work_mm: tuple[float, ...] | None = None
    offset_mm: tuple[float, ...] | None = None
    blocks_free: int | None = None
    rx_free: int | None = None
    line_number: int | None = None
    feed_mm_min: float | None = None
    spindle: float | None = None
    spindle_measured: float | None = None
    overrides: tuple[int, int, int] | None = None
    pins: str | None = None
    accessories: str | None = None
    other: tuple[tuple[str, str], ...] = ()

    def format(self) -> str:
        """The report as text without line end, fields in the order both firmwares use.

        Lengths with three decimals, rates as whole numbers ($13=0). Which fields appear, and
        when, is the firmware's choice and so the caller's.
        """
        parts = [self.state if self.substate is None else f"{self.state}:{self.substate}"]
        if self.machine_mm is not None:
            parts.append(f"MPos:{_lengths(self.machine_mm)}")
        if self.work_mm is not None:
            parts.append(f"WPos:{_lengths(self.work_mm)}")
        if self.blocks_free is not None:
            parts.append(f"Bf:{self.blocks_free},{self.rx_free}")
        if self.line_number is not None:
            parts.append(f"Ln:{self.line_number}")
        if self.feed_mm_min is not None and self.spindle is None:
            parts.append(f"F:{self.feed_mm_min:.0f}")
        elif self.feed_mm_min is not None:
            rates = f"FS:{self.feed_mm_min:.0f},{self.spindle:.0f}"
            measured = self.spindle_measured
            parts.append(rates if measured is None else f"{rates},{measured:.0f}")
        if self.pins is not None:
            parts.append(f"Pn:{self.pins}")
        if self.offset_mm is not None:
            parts.append(f"WCO:{_lengths(self.offset_mm)}")
        if self.overrides is not None:
            parts.append("Ov:{},{},{}".format(*self.overrides))
        if self.accessories is not None:
            parts.append(f"A:{self.accessories}")
        parts += [f"{key}:{value}" for key, value in self.other]
        return f"<{'|'.join(parts)}>"


def parse_status(text: str) -> StatusReport | None:
    """A report from its text `<...>` without line end, or None where it is not a sound report.

    >>> parse_status("<Run|MPos:1.000,0.000,0.000|Ln:7>").line_number
    7
    """
    if len(text) < 3 or text[0] != "<" or text[-1] != ">":
        return None
    head, *fields = text[1:-1].split("|")
    state, _, sub = head.partition(":")
    if state not in STATES or (sub and not _INT.fullmatch(sub)) or head.endswith(":"):
        return None
    found: dict[str, object] = {"state": state, "substate": int(sub) if sub else None}
    other: list[tuple[str, str]] = []
    seen: set[str] = set()
    for field in fields:
        key, colon, value = field.partition(":")
        if not colon or key in seen or not _KEY.fullmatch(key):
            return None
        seen.add(key)
        read = _FIELDS.get(key)
        if read is None:
            other.append((key, value))
            continue
        values = read(value)
        if values is None or not found.keys().isdisjoint(values):
            return None
        found.update(values)
    return StatusReport(other=tuple(other), **found)  # type: ignore[arg-type]


def _lengths(values: tuple[float, ...]) -> str:
    return ",".join(f"{value:.3f}" for value in values)


def _numbers(value: str) -> tuple[float, ...] | None:
    parts = value.split(",")
    return tuple(map(float, parts)) if all(map(_SIGNED.fullmatch, parts)) else None


def _integers(value: str) -> tuple[int, ...] | None:
    parts = value.split(",")
    return tuple(map(int, parts)) if all(map(_INT.fullmatch, parts)) else None


def _position(name: str, value: str) -> dict[str, object] | None:
    axes = _numbers(value)
    return {name: axes} if axes is not None and 3 <= len(axes) <= 8 else None


def _buffers(value: str) -> dict[str, object] | None:
    free = _integers(value)
    if free is None or len(free) != 2:
        return None
    return {"blocks_free": free[0], "rx_free": free[1]}


def _line_number(value: str) -> dict[str, object] | None:
    return {"line_number": int(value)} if _INT.fullmatch(value) else None


def _feed(value: str) -> dict[str, object] | None:
    feed = _numbers(value)
    return {"feed_mm_min": feed[0]} if feed is not None and len(feed) == 1 else None


def _feed_and_spindle(value: str) -> dict[str, object] | None:
    rates = _numbers(value)
    if rates is None or len(rates) not in (2, 3):
        return None
    names = ("feed_mm_min", "spindle", "spindle_measured")
    return dict(zip(names, rates, strict=False))


def _overrides(value: str) -> dict[str, object] | None:
    percent = _integers(value)
    return {"overrides": percent} if percent is not None and len(percent) == 3 else None


def _letters(name: str, value: str) -> dict[str, object] | None:
    return {name: value} if value == "" or (value.isascii() and value.isalnum()) else None


_FIELDS = {
    "MPos": lambda value: _position("machine_mm", value),
    "WPos": lambda value: _position("work_mm", value),
    "WCO": lambda value: _position("offset_mm", value),
    "Bf": _buffers,
    "Ln": _line_number,
    "F": _feed,
    "FS": _feed_and_spindle,
    "Ov": _overrides,
    "Pn": lambda value: _letters("pins", value),
    "A": lambda value: _letters("accessories", value),
}
