"""What is wrong with a scale's record: it drifts, sticks, was bumped, or nothing arrives.

Each check raises MachineError or returns; none of them corrects anything.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.step_fit import StepFit, WeighedSteps
from lmctl.machine.scale.driver import CatchScaleDriver
from lmctl.machine.scale.reading import ScaleReading

#: A scale at rest may move so far [g/min], and by so many steps of its display.
_MAX_DRIFT_G_MIN = 0.05
_REST_STEPS = 2.5
#: A display that stands still for so long under falling powder is stuck, or nothing falls [s].
_STANDS_S = 8.0
#: Whitened residuals are of variance 1: so far out is no noise.
_BUMP = 8.0
#: A slope that drifts by more than this in an hour, seen with certainty, is not settled.
_MAX_SLOPE_DRIFT_PER_H = 0.15
_SURE = 2.0  # half widths


class StandstillWatch:
    """Watches a scale under running powder. expected_g_min : least flow that is set"""

    def __init__(self, scale: CatchScaleDriver, expected_g_min: float) -> None:
        self._scale = scale
        self._expected_g_min = expected_g_min
        self._first_g: float | None = None
        self._last: deque[tuple[float, float]] = deque()
        self._has_risen = False

    def check(self, reading: ScaleReading) -> None:
        """Raises MachineError where the scale is full, stands still, or shows no powder."""
        scale = self._scale
        if reading.is_overloaded:
            raise scale.error("it is full", "empty its pan, and test again")
        if reading.mass_g is None:
            return
        self._first_g = reading.mass_g if self._first_g is None else self._first_g
        self._has_risen |= reading.mass_g > self._first_g + 5 * scale.resolution_g
        self._last.append((reading.time_s, reading.mass_g))
        while self._last[-1][0] - self._last[0][0] > _STANDS_S:
            self._last.popleft()
        (begin_s, begin_g), (end_s, end_g) = self._last[0], self._last[-1]
        due_g = self._expected_g_min / 60.0 * (end_s - begin_s)
        if end_s - begin_s < 0.9 * _STANDS_S or due_g < 4 * scale.resolution_g or (
            abs(end_g - begin_g) > 0.1 * due_g
        ):
            return
        if self._has_risen:
            raise scale.error(
                f"its display has stood at {end_g:.2f} g for {_STANDS_S:.0f} s with powder on",
                "is it stuck, or has powder stopped? See its own display and the nozzle")
        raise scale.error(
            "no powder arrives on it",
            "does carrier gas flow, is there powder in the hopper, is the scale under the nozzle?")


def check_rest(scale: CatchScaleDriver, time_s: FloatArray, mass_g: FloatArray, when: str) -> None:
    """Raise MachineError where a scale without powder does not stand still.

    time_s, mass_g : (n,) float64 readings
    """
    if len(time_s) < 4:
        raise scale.error(f"it gave too few readings {when}", "check its cable")
    drift_g_min = 60.0 * float(np.polyfit(time_s - time_s[0], mass_g, 1)[0])
    moved_g = abs(drift_g_min) / 60.0 * float(time_s[-1] - time_s[0])
    if abs(drift_g_min) > _MAX_DRIFT_G_MIN and moved_g > _REST_STEPS * scale.resolution_g:
        raise scale.error(
            f"it drifts by {drift_g_min:+.2f} g/min {when}, without powder",
            "let it warm up, shield it from draught; is the hose empty?")


def check_bumps(scale: CatchScaleDriver, steps: WeighedSteps, fit: StepFit) -> None:
    """Raise MachineError where the record jumps as no powder does."""
    white = np.abs(fit.whitened_residual)
    worst = int(np.argmax(white))
    if white[worst] > _BUMP:
        jump_g = float(steps.mass_g[worst + 1] - steps.mass_g[worst])
        at_s = float(steps.time_s[worst + 1] - steps.time_s[0])
        raise scale.error(
            f"its display jumped by {jump_g:+.2f} g at {at_s:.0f} s of the test",
            "it was knocked, or a lump fell: test again")


def feeder_doubts(fit: StepFit) -> list[str]:
    """What speaks against the feeder itself, in words; empty where nothing does."""
    doubts = []
    drift = fit.slope_drift_per_h
    if abs(drift.value) > max(_MAX_SLOPE_DRIFT_PER_H, _SURE * drift.half_width):
        doubts.append(f"it does not settle: its slope drifts by {100 * drift.value:+.0f} % an hour")
    if fit.noise.rsd > 0.1:
        doubts.append(f"its flow is unsteady by {100 * fit.noise.rsd:.0f} %")
    if not 0.8 < fit.slope.value < 1.25:
        doubts.append(f"it feeds {fit.slope.value:.2f} times what it is set to: calibrate the "
                      "feeder itself")
    return doubts
