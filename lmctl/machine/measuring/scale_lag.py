"""The lag of the catch scale, measured with a known weight before any powder is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import Estimate
from lmctl.calibration.step_fit import fit_scale_lag
from lmctl.machine.scale.driver import CatchScaleDriver
from lmctl.machine.scale.reading import ScaleReading

#: The weight is waited for so long [s], and watched for so long once it lies on the pan.
_PATIENCE_S = 120.0
_WATCHED_S = 6.0
#: The scale is read so often meanwhile [s]: most have a cycle of a tenth.
_PERIOD_S = 0.05
#: A scale that shows the weight wrong by more than this share is not calibrated.
_WRONG_WEIGHT = 0.01


class ScaleOperator(Protocol):
    """Who stands at the scale."""

    async def put_on_weight(self, weight_g: float) -> None:
        """Put the known weight onto the pan, at once."""

    async def take_off_weight(self, weight_g: float) -> None:
        """Take it off again."""


async def measure_scale_lag(
    scale: CatchScaleDriver, operator: ScaleOperator, weight_g: float
) -> Estimate:
    """Tare, have the weight put on and taken off, tare again; returns the scale's lag [s].

    Raises MachineError where no weight comes, the scale shows it wrong, or cannot hold it.
    """
    if weight_g > 0.9 * scale.capacity_g:
        raise scale.error(f"{weight_g:g} g are too much for its {scale.capacity_g:g} g",
                          "take a lighter weight, and name it in [scale] as weight_g")
    await scale.tare()
    times, masses = await _watched_weight(scale, operator, weight_g)
    try:
        lag_s, shown = fit_scale_lag(times, masses, weight_g, scale.resolution_g)
    except ValueError as error:
        raise scale.error(str(error), "put the weight on at once, and let go of it") from None
    if abs(shown - 1.0) > _WRONG_WEIGHT:
        raise scale.error(
            f"it shows {shown * weight_g:.2f} g for the weight of {weight_g:g} g",
            "is it this weight? Else have the scale calibrated")
    await operator.take_off_weight(weight_g)
    await _until(scale, lambda mass_g: mass_g < 0.1 * weight_g, "the weight is still on it",
                 "take the weight off")
    await scale.tare()
    return lag_s


async def _watched_weight(
    scale: CatchScaleDriver, operator: ScaleOperator, weight_g: float
) -> tuple[FloatArray, FloatArray]:
    """Readings from before the weight to long after it: times and masses, each stamp once."""
    readings: dict[float, float] = {}

    def keep(reading: ScaleReading) -> float:
        assert reading.mass_g is not None
        readings[reading.time_s] = reading.mass_g
        return reading.mass_g

    putting = asyncio.create_task(operator.put_on_weight(weight_g))
    try:
        loop = asyncio.get_running_loop()
        deadline_s, seen_s = loop.time() + _PATIENCE_S, float("inf")
        while loop.time() < min(deadline_s, seen_s + _WATCHED_S):
            reading = await scale.read()
            if reading is not None and reading.mass_g is not None:
                if keep(reading) > 0.5 * weight_g:
                    seen_s = min(seen_s, loop.time())
                elif seen_s == float("inf"):
                    readings = dict(sorted(readings.items())[-100:])
            await asyncio.sleep(_PERIOD_S)
        if seen_s == float("inf"):
            raise scale.error(f"no weight of {weight_g:g} g came within {_PATIENCE_S:.0f} s",
                              "put it on when the test asks for it")
    finally:
        putting.cancel()
        await asyncio.gather(putting, return_exceptions=True)
    times = np.array(sorted(readings))
    return times, np.array([readings[at] for at in times.tolist()])


async def _until(
    scale: CatchScaleDriver, condition: Callable[[float], bool], what: str, hint: str
) -> None:
    deadline_s = asyncio.get_running_loop().time() + _PATIENCE_S
    while True:
        reading = await scale.read()
        if reading is not None and reading.mass_g is not None and condition(reading.mass_g):
            return
        if asyncio.get_running_loop().time() > deadline_s:
            raise scale.error(what, hint)
        await asyncio.sleep(scale.period_s)
