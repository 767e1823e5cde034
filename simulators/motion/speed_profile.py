"""Speed over one block in closed form: at most one acceleration, cruise and braking phase."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple


class SpeedRamp(NamedTuple):
    """A phase of constant acceleration [mm/s², s, mm, mm/s at its end]."""

    acceleration: float
    duration: float
    distance: float
    exit_speed: float


_TINY_MM = 1e-12
_ALIKE = 1e-9  # relative difference of squared speeds that counts as rounding


def fastest_profile(
    speed: float, left_mm: float, acceleration: float, nominal: float, exit_sqr: float
) -> list[SpeedRamp]:
    """Fastest profile over left_mm from `speed`, at most `nominal`, to exit_sqr [mm²/s²].

    Where `speed` is above `nominal` (an override was lowered) it brakes to it first; where the
    exit speed cannot be reached, the block brakes or accelerates over its whole length to end as
    near to it as possible.

    returns : ramps, the *last* to be executed first, so that they can be popped
    """
    nominal_sqr = nominal * nominal
    if speed == nominal and exit_sqr == nominal_sqr:
        return [SpeedRamp(0.0, left_mm / nominal, left_mm, nominal)]
    speed_sqr = speed * speed
    twice = 2.0 * acceleration
    if speed_sqr > nominal_sqr * (1.0 + _ALIKE):
        brake_mm = (speed_sqr - nominal_sqr) / twice
        if brake_mm >= left_mm:
            return [_single_ramp(speed, speed_sqr - twice * left_mm, exit_sqr, left_mm)]
        ramps = fastest_profile(nominal, left_mm - brake_mm, acceleration, nominal, exit_sqr)
        ramps.append(_ramp(speed, nominal, brake_mm))
        return ramps
    peak_sqr = 0.5 * (speed_sqr + exit_sqr + twice * left_mm)
    if peak_sqr >= nominal_sqr:
        peak, peak_sqr = nominal, nominal_sqr
    elif peak_sqr <= speed_sqr:
        return [_single_ramp(speed, speed_sqr - twice * left_mm, exit_sqr, left_mm)]
    elif peak_sqr <= exit_sqr:
        return [_single_ramp(speed, speed_sqr + twice * left_mm, exit_sqr, left_mm)]
    else:
        peak = sqrt(peak_sqr)
    up_mm = (peak_sqr - speed_sqr) / twice
    down_mm = (peak_sqr - exit_sqr) / twice
    flat_mm = left_mm - up_mm - down_mm
    ramps = []
    if down_mm > _TINY_MM:
        ramps.append(_ramp(peak, sqrt(exit_sqr), down_mm))
    if flat_mm > _TINY_MM:
        ramps.append(SpeedRamp(0.0, flat_mm / peak, flat_mm, peak))
    if up_mm > _TINY_MM:
        ramps.append(_ramp(speed, peak, up_mm))
    return ramps


def braking_profile(speed: float, left_mm: float, acceleration: float) -> list[SpeedRamp]:
    """Braking to rest, or over all of left_mm where that does not suffice. `speed` above 0."""
    rest_mm = speed * speed / (2.0 * acceleration)
    if rest_mm > left_mm:
        end_sqr = speed * speed - 2.0 * acceleration * left_mm
        return [_single_ramp(speed, end_sqr, 0.0, left_mm)]
    return [_ramp(speed, 0.0, rest_mm)]


def _single_ramp(speed: float, end_sqr: float, wanted_sqr: float, left_mm: float) -> SpeedRamp:
    if abs(end_sqr - wanted_sqr) <= _ALIKE * (speed * speed + wanted_sqr):
        end_sqr = wanted_sqr
    return _ramp(speed, sqrt(max(end_sqr, 0.0)), left_mm)


def _ramp(speed: float, end: float, distance: float) -> SpeedRamp:
    duration = 2.0 * distance / (speed + end)
    return SpeedRamp((end - speed) / duration, duration, distance, end)
