"""How long to wait until the beam comes back to places that are cool enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.plan.heat.heat_steps import NO_LINES
from lmctl.plan.heat.part_temperature import PartTemperature

#: No wait is longer; what needs more needs another recipe [s].
LONGEST_WAIT_S = 3600.0
#: Temperature is read at so many times in each stretch of cooling; stretches double from here [s].
_TIMES, _FIRST_S = 12, 4.0
#: A place whose limit is nearer to what its own pass leaves than this is past waiting for [K],
_HOPELESS_K = 3.0
#: and while the pass can still be divided, one whose own pass leaves more than this part of the
#: rise that the limit allows: to cool to the rest, all that was there before would take long.
_OWN_SHARE = 0.5


@dataclass(frozen=True)
class PassReadings:
    """What places read during a pass, without a wait before it; r places.

    place_mm : (r, 2); at_s : (r,) when each is read, from the beginning of the pass; found_C : (r,)
    """

    place_mm: FloatArray
    at_s: FloatArray
    found_C: FloatArray


@dataclass(frozen=True)
class HottestPlace:
    """What the longest wait leaves: (2,) where, and what it would read [°C]."""

    place_mm: FloatArray
    found_C: float


def wait_for_limit_s(
    before: PartTemperature, readings: PassReadings, limit_C: float, plate_C: float,
    *, can_divide: bool,
) -> float | HottestPlace:
    """Wait before a pass after which no place reads more than the limit [s].

    before : the part when the pass would begin; it is not changed
    can_divide : whether the pass may be done in two, with a wait between them
    A reading is what was there before the pass and cools, and what the pass itself adds, which does
    not depend on the wait (heat conduction is linear). Places that the pass itself heats too much
    are left out: no wait helps them. The hottest place where `LONGEST_WAIT_S` is not long enough.
    """
    spare_K = max(_HOPELESS_K, (1 - _OWN_SHARE) * (limit_C - plate_C) if can_divide else 0.0)
    cooling, start_s = before.copy(), before.time_s
    times, read = np.empty(0), np.empty((0, len(readings.at_s)))
    horizon_s = 0.0
    lasting_s = float(readings.at_s.max(initial=0.0))
    stretch_s = max(_FIRST_S, lasting_s)
    while horizon_s < LONGEST_WAIT_S + lasting_s:
        new = horizon_s + stretch_s * np.arange(1 if len(times) else 0, _TIMES + 1) / _TIMES
        found = cooling.advance(
            start_s + new[-1], NO_LINES, np.repeat(start_s + new, len(readings.at_s)),
            np.tile(readings.place_mm, (len(new), 1)))
        times, read = np.append(times, new), np.vstack([read, found.reshape(len(new), -1)])
        horizon_s, stretch_s = float(new[-1]), 2 * stretch_s
        if horizon_s <= lasting_s:
            continue
        wait_s = _first_wait_s(times, read, readings, limit_C, limit_C - plate_C - spare_K,
                               horizon_s - lasting_s)
        if wait_s is not None:
            return wait_s
    last_C = [readings.found_C[place] + np.interp(at + LONGEST_WAIT_S, times, read[:, place])
              - np.interp(at, times, read[:, place]) for place, at in enumerate(readings.at_s)]
    hottest = int(np.nanargmax(last_C))
    return HottestPlace(readings.place_mm[hottest], float(last_C[hottest]))


def _first_wait_s(
    times: FloatArray, read: FloatArray, readings: PassReadings, limit_C: float, most_own_K: float,
    longest_s: float,
) -> float | None:
    """The least wait up to `longest_s` that keeps the limit, to a tenth of a second; None if none.

    times : (k,); read : (k, r) temperatures of the places while the beam stays off
    most_own_K : places to which the pass itself adds more are left out
    """
    waits = np.linspace(0.0, longest_s, max(2, int(longest_s / 0.1) + 1))
    worst = np.full(len(waits), -np.inf)
    for place in range(len(readings.at_s)):
        at = readings.at_s[place]
        own = readings.found_C[place] - np.interp(at, times, read[:, place])
        if not np.isfinite(own) or own > most_own_K:
            continue
        worst = np.maximum(worst, own + np.interp(at + waits, times, read[:, place]))
    enough = np.flatnonzero(worst <= limit_C)
    return float(waits[enough[0]]) if len(enough) else None
