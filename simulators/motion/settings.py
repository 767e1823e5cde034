"""The `$` settings of both firmwares: defaults, formats and permitted values.

Defaults are those of the transcribed builds before `$30`, `$32`, `$110`-`$122` were set.
Sources: Grbl 1.1 `doc/markdown/settings.md`, `settings.c`; grblHAL core `settings.h`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from firmware_protocol.dialect import GRBLHAL, Dialect
from simulators.motion.planner import Kinematics, Vector

_AXES = (0, 1, 2)

UNKNOWN, NEGATIVE, SHORT_PULSE, NEEDS_HOMING, OUT_OF_RANGE = 3, 4, 6, 10, 52


class SettingError(Exception):
    """The firmware refuses a setting with `error:code`."""

    def __init__(self, code: int, number: int) -> None:
        super().__init__(f"${number}: error:{code}")
        self.code = code


@dataclass(frozen=True)
class _Row:
    default: float
    decimals: int = 0
    most: float = math.inf


def _rows(text: str) -> dict[int, _Row]:
    """`number=default` with as many decimals as the firmware prints; `<=` gives a maximum."""
    rows = {}
    for entry in text.split():
        assignment, _, most = entry.partition("<=")
        number, _, default = assignment.partition("=")
        decimals = len(default.partition(".")[2])
        rows[int(number)] = _Row(float(default), decimals, float(most) if most else math.inf)
    return rows


_GRBL = _rows(
    "0=10<=255 1=25<=255 2=0<=255 3=0<=255 4=0<=1 5=0<=1 6=0<=1 10=1<=255 11=0.010 12=0.002 "
    "13=0<=1 20=0<=1 21=0<=1 22=0<=1 23=0<=255 24=25.000 25=500.000 26=250<=65535 27=1.000 "
    "30=1000<=100000 31=0<=100000 32=0<=1 "
    "100=250.000 101=250.000 102=250.000 110=500.000 111=500.000 112=500.000 "
    "120=10.000 121=10.000 122=10.000 130=200.000 131=200.000 132=200.000"
)
_GRBLHAL = _rows(
    "0=5.0 1=25<=65535 2=0<=7 3=0<=7 4=7<=7 5=0<=7 6=0<=1 9=1<=7 10=511<=8191 11=0.010 12=0.002 "
    "13=0<=1 14=0<=255 15=0<=15 17=0<=15 18=0<=15 19=0<=1 20=0<=1 21=0<=7 22=0<=511 23=0<=7 "
    "24=25.0 25=500.0 26=250<=1000 27=1.000 28=0.100 29=0.0<=20 30=1000.000 31=0.000 32=0<=2 "
    "33=5000.0 34=0.0<=100 35=0.0<=100 36=100.0<=100 37=0<=7 39=1<=1 40=0<=1 41=0<=7 42=2<=2 "
    "43=1<=128 44=4<=7 45=3<=7 46=0<=7 56=5.0 57=100.0 58=-5.0 59=500.0 60=0<=1 61=0<=3 62=0<=1 "
    "63=3<=3 64=0<=1 65=0<=3 100=250.00000 101=250.00000 102=250.00000 "
    "110=500.000 111=500.000 112=500.000 120=10.000 121=10.000 122=10.000 "
    "130=200.000 131=200.000 132=200.000 341=0<=4 342=30.0 343=25.0 344=200.0 345=200.0 346=1<=7 "
    "370=0<=255 372=0<=255 384=0<=1 392=4.0<=20 393=1.0<=20 394=0.0<=20 398=100<=1000 "
    "481=0<=1000 485=0<=1 486=0<=1 539=0.0<=20 673=0.0<=20 676=15<=15 680=0<=10000"
)
_NEGATIVE_ALLOWED = frozenset((58,))
_ABOVE_ZERO = frozenset((11, 12, 30, 100, 101, 102, 110, 111, 112, 120, 121, 122))


class FirmwareSettings:
    """The settings table of one controller."""

    def __init__(self, dialect: Dialect, overrides: Mapping[int, float]) -> None:
        """raises: SettingError for an override the firmware would refuse"""
        self._hal = dialect is GRBLHAL
        self._rows = _GRBLHAL if self._hal else _GRBL
        self._overrides = dict(overrides)
        self._values: dict[int, float] = {}
        self.restore_defaults()

    def restore_defaults(self) -> None:
        """Restore the defaults with the configuration's overrides on top (`$RST=$`)."""
        self._values = {number: row.default for number, row in self._rows.items()}
        # homing before soft limits, which require homing
        for number in sorted(self._overrides, key=lambda number: (number != 22, number)):
            self.store(number, self._overrides[number])

    def __getitem__(self, number: int) -> float:
        return self._values[number]

    def store(self, number: int, value: float) -> None:
        """`$number=value`. raises: SettingError with the firmware's error number"""
        row = self._rows.get(number)
        if row is None:
            raise SettingError(UNKNOWN, number)
        if not math.isfinite(value) or (value < 0.0 and number not in _NEGATIVE_ALLOWED):
            raise SettingError(NEGATIVE, number)
        if number == 0 and value < 3.0:
            raise SettingError(SHORT_PULSE, number)
        if number == 20 and value and not int(self._values[22]) & 1:
            raise SettingError(NEEDS_HOMING, number)
        if value > row.most or (number in _ABOVE_ZERO and value <= 0.0):
            raise SettingError(OUT_OF_RANGE if self._hal else NEGATIVE, number)
        self._values[number] = value if row.decimals else float(int(value))
        if number == 22 and not int(value) & 1:
            self._values[20] = 0.0

    def listing(self) -> list[tuple[int, str]]:
        """`$$`: every number with its value as the firmware prints it."""
        return [
            (number, f"{self._values[number]:.{row.decimals}f}")
            for number, row in self._rows.items()
        ]

    def kinematics(self) -> Kinematics:
        return Kinematics(
            steps_per_mm=self._axes(100),
            max_rate_mm_s=self._axes(110, 1.0 / 60.0),
            acceleration_mm_s2=self._axes(120),
            junction_deviation_mm=self._values[11],
        )

    @property
    def travel_mm(self) -> Vector:
        return self._axes(130)

    @property
    def is_laser_mode(self) -> bool:
        return self._values[32] == 1.0

    @property
    def is_homing_enabled(self) -> bool:
        return bool(int(self._values[22]) & 1)

    @property
    def is_laser_off_in_hold(self) -> bool:
        return bool(int(self._values[63]) & 1) if self._hal else True

    def _axes(self, first: int, factor: float = 1.0) -> Vector:
        x, y, z = (self._values[first + axis] * factor for axis in _AXES)
        return (x, y, z)
