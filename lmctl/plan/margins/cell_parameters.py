"""The values of a cell that a calibration knows within intervals, and cells at their ends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.config.machine import HopperSettings
from lmctl.config.measuring import HopperIntervals, Interval
from lmctl.plan.sequence.nozzle_flow import CellValues

ParameterKind = Literal[
    "dead time", "lag", "drive lag", "slope", "offset", "catch efficiency", "dilution"]
#: Of a parameter: the low end of its interval, the value planned with, the high end.
Level = Literal[-1, 0, 1]

#: A drive lag is no more than this share of the whole lag: the rest is the hose's.
_MOST_OF_LAG = 0.98


@dataclass(frozen=True)
class CellParameter:
    """One value of one hopper, or the dilution. planned : the value that planning uses

    hopper, hopper_name : its number and name; -1 and "" for the dilution, whose values are how far
        it is from the planned one
    """

    hopper: int
    hopper_name: str
    kind: ParameterKind
    low: float
    planned: float
    high: float

    def at(self, level: Level) -> float:
        """The value at an end of the interval, or the planned one."""
        return (self.low, self.planned, self.high)[level + 1]

    def narrowed(self, share: float) -> CellParameter:
        """The same known better: ends so much nearer to the planned value."""
        return replace(self, low=self.planned + share * (self.low - self.planned),
                       high=self.planned + share * (self.high - self.planned))

    @property
    def name(self) -> str:
        """In words, as "hopper B's dead time"."""
        return f"hopper {self.hopper_name}'s {self.kind}" if self.hopper_name else self.kind

    def deviation_text(self, level: Level) -> str:
        """How far an end is from the planned value, as "0.09 s longer"."""
        off = self.at(level) - self.planned
        if self.kind in ("dead time", "lag", "drive lag"):
            return f"{abs(off):.2f} s {'longer' if off > 0 else 'shorter'}"
        if self.kind == "offset":
            return f"{abs(off):.2f} g/min {'higher' if off > 0 else 'lower'}"
        if self.kind == "dilution":
            return f"{abs(off):.3f} {'higher' if off > 0 else 'lower'}"
        return f"{abs(off) / self.planned:.1%} {'higher' if off > 0 else 'lower'}"


def cell_parameters(
    hoppers: Sequence[HopperSettings], catch_efficiency: FloatArray,
    intervals: Mapping[str, HopperIntervals], dilution_half_width: float = 0.0,
) -> tuple[CellParameter, ...]:
    """Every value of which an interval is known, for the hoppers of a job; empty where none is.

    dilution_half_width : of its interval; 0 where none is known, or no plan makes up for it
    """
    found = []
    for number, hopper in enumerate(hoppers):
        known = intervals.get(hopper.name)
        if known is None:
            continue
        ends: dict[ParameterKind, tuple[Interval, float]] = {
            "dead time": (known.dead_time_s, hopper.dead_time_s),
            "lag": (known.lag_s, hopper.lag_s),
            "drive lag": (known.drive_lag_s, 0.0),
            "slope": (known.slope, hopper.slope),
            "offset": (known.offset_g_min, hopper.offset_g_min),
            "catch efficiency": (known.catch_efficiency, float(catch_efficiency[number])),
        }
        for kind, (interval, planned) in ends.items():
            if interval is None:
                continue
            low, high = interval
            if kind == "drive lag":
                low, planned = max(low, 0.0), max((low + high) / 2.0, 0.0)
            elif kind in ("dead time", "lag"):
                low = max(low, 0.0)
            found.append(CellParameter(number, hopper.name, kind, min(low, planned), planned,
                                       max(high, planned)))
    if dilution_half_width > 0.0:
        found.append(CellParameter(-1, "", "dilution", -dilution_half_width, 0.0,
                                   dilution_half_width))
    return tuple(found)


def cell_values(
    planned: CellValues, parameters: Sequence[CellParameter], values: Sequence[float],
    intervals: Sequence[HopperIntervals | None],
) -> CellValues:
    """The cell with these values of the parameters; what was not measured is as planned.

    Dead time and lags together stay within the interval of the whole response, which a test knows
    better than each of them. A drive lag takes its share of the whole lag: the hose's lag is what
    gives both the same spread in time, and the dead time what gives the same mean delay.
    intervals : of each hopper
    """
    columns = {
        "dead time": planned.dead_time_s.copy(), "lag": planned.lag_s.copy(),
        "drive lag": planned.drive_lag_s.copy(), "slope": planned.slope.copy(),
        "offset": planned.offset_g_min.copy(), "catch efficiency": planned.catch_efficiency.copy(),
    }
    dilution_off = planned.dilution_off
    for parameter, value in zip(parameters, values, strict=True):
        if parameter.kind == "dilution":
            dilution_off = value
            continue
        columns[parameter.kind][parameter.hopper] = value
    dead, lag, drive = columns["dead time"], columns["lag"], columns["drive lag"]
    for number, known in enumerate(intervals):
        whole = dead[number] + lag[number]
        if known is not None and known.response_s is not None:
            low, high = known.response_s
            dead[number] = max(dead[number] + min(max(whole, low), high) - whole, 0.0)
        if drive[number] > 0.0:
            drive[number] = min(drive[number], _MOST_OF_LAG * lag[number])
            hose = math.sqrt(lag[number] ** 2 - drive[number] ** 2)
            dead[number] = max(dead[number] + lag[number] - hose - drive[number], 0.0)
            lag[number] = hose
    return CellValues(dead, lag, drive, columns["slope"], columns["offset"],
                      np.clip(columns["catch efficiency"], 1e-3, None), dilution_off)
