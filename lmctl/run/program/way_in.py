"""Straight dark legs as lines short enough for the send horizon, each with its time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Leg:
    """One line to be sent. in_one : it is passed at speed, not begun and ended at rest."""

    start_mm: FloatArray
    end_mm: FloatArray
    speed_mm_s: float
    lasting_s: float
    in_one: bool


def legs(
    start_mm: FloatArray, corners_mm: Sequence[FloatArray], speed_mm_s: float,
    acceleration_mm_s2: float, longest_s: float, least_mm: float, *, in_one: bool = False,
) -> list[Leg]:
    """Lines from a start through corners, at rest in each unless they are passed `in_one` go.

    longest_s : most time of one line
    least_mm : corners nearer than this to the one before are left out
    in_one : the corners lie on a smooth curve that is entered from rest and left at speed
    """
    made: list[Leg] = []
    at_mm = start_mm
    resting = True
    for corner_mm in corners_mm:
        away_mm = corner_mm - at_mm
        length_mm = float(np.linalg.norm(away_mm))
        if length_mm < least_mm:
            continue
        if in_one:
            lasting_s = length_mm / speed_mm_s
            if resting:
                lasting_s += speed_mm_s / acceleration_mm_s2 / 2.0
            parts = max(1, math.ceil(lasting_s / longest_s))
            shares = [k / parts for k in range(1, parts + 1)]
        else:
            lasting_s = _from_rest_to_rest_s(length_mm, speed_mm_s, acceleration_mm_s2)
            parts = max(1, math.ceil(lasting_s / longest_s))
            shares = [
                _gone_mm(lasting_s * k / parts, lasting_s, length_mm, speed_mm_s,
                         acceleration_mm_s2) / length_mm
                for k in range(1, parts)
            ] + [1.0]
        resting = not in_one
        before_mm = at_mm
        for share in shares:
            end_mm = np.round(at_mm + share * away_mm, 3)
            made.append(Leg(before_mm, end_mm, speed_mm_s, lasting_s / parts, in_one))
            before_mm = end_mm
        at_mm = corner_mm
    return made


def _from_rest_to_rest_s(length_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    if length_mm < speed_mm_s**2 / acceleration_mm_s2:
        return 2.0 * math.sqrt(length_mm / acceleration_mm_s2)
    return length_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def _gone_mm(
    t_s: float, lasting_s: float, length_mm: float, speed_mm_s: float, acceleration_mm_s2: float
) -> float:
    """Way made after t_s of a leg from rest to rest."""
    if t_s > lasting_s / 2.0:
        return length_mm - _gone_mm(lasting_s - t_s, lasting_s, length_mm, speed_mm_s,
                                    acceleration_mm_s2)
    rising_s = min(speed_mm_s / acceleration_mm_s2, lasting_s / 2.0)
    if t_s <= rising_s:
        return acceleration_mm_s2 * t_s**2 / 2.0
    return acceleration_mm_s2 * rising_s**2 / 2.0 + speed_mm_s * (t_s - rising_s)
