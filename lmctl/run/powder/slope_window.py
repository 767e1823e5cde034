"""A hopper's loss in weight against what it was commanded to feed, over windows of a run."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from lmctl.config.measuring import FeederCorrectionSettings

#: A load cell's step is a tenth of a gram: standard deviation by rounding.
_ROUNDING_G = 0.1 / math.sqrt(12.0)
#: A window that has fed too little to be this sure goes on, up to its longest.
_WANTED_ERROR = 0.01
_LONGEST_S = 300.0
_LEAST_READINGS = 6
_DRIFT_WINDOWS = 30


@dataclass(frozen=True)
class SlopeMeasurement:
    """Loss in weight over commanded mass, in one window [from_s, to_s] of machine time.

    ratio : 1 where the hopper feeds what it is commanded; standard_error : of it
    fed_g : commanded mass
    """

    ratio: float
    standard_error: float
    from_s: float
    to_s: float
    fed_g: float


class SlopeWindow:
    """Collects readings of one hopper until they make a measurement.

    window_s : shortest window
    """

    def __init__(self, window_s: float) -> None:
        self._window_s = window_s
        self._readings: list[tuple[float, float, float]] = []

    def restart(self) -> None:
        """Forget what was collected: the weight, or the flow, was disturbed."""
        self._readings.clear()

    def add(self, time_s: float, weight_g: float, fed_g: float) -> SlopeMeasurement | None:
        """Add a reading; returns a measurement where it completes a window, which then begins anew.

        fed_g : commanded mass fed until time_s, since any moment
        """
        if self._readings and time_s <= self._readings[-1][0]:
            return None
        self._readings.append((time_s, weight_g, fed_g))
        span_s = time_s - self._readings[0][0]
        if span_s < self._window_s or len(self._readings) < _LEAST_READINGS:
            return None
        found = self._measurement()
        too_long = span_s >= _LONGEST_S
        if found is None or found.standard_error > _WANTED_ERROR:
            if too_long:
                self.restart()
            return None
        self._readings = [self._readings[-1]]
        return found

    def _measurement(self) -> SlopeMeasurement | None:
        """Least squares of weight lost against mass commanded; None where nothing was."""
        n = len(self._readings)
        times, weights, feds = zip(*self._readings, strict=True)
        middle_w, middle_f = sum(weights) / n, sum(feds) / n
        spread = sum((f - middle_f) ** 2 for f in feds)
        if spread <= 0.0:
            return None
        both = sum((f - middle_f) * (w - middle_w) for f, w in zip(feds, weights, strict=True))
        ratio = -both / spread
        over = sum((w - middle_w + ratio * (f - middle_f)) ** 2
                   for f, w in zip(feds, weights, strict=True)) / max(n - 2, 1)
        error = max(math.sqrt(over), _ROUNDING_G) / math.sqrt(spread)
        return SlopeMeasurement(ratio, error, times[0], times[-1], feds[-1] - feds[0])


class SlopeCorrection:
    """The slow integrator behind a hopper's set-points.

    value : by which its slope is taken to have changed; 1 at first
    """

    def __init__(self, settings: FeederCorrectionSettings) -> None:
        self.value = 1.0
        self._gain = 1.0 - math.exp(-1.0 / settings.time_constant_windows)
        self._most = settings.max_share

    def take(self, measured: SlopeMeasurement) -> float:
        """Move by a share of what a window has shown; returns the new value, within its limits.

        measured : against set-points that held the present value
        """
        wanted = self.value * (1.0 + self._gain * (measured.ratio - 1.0))
        self.value = min(max(wanted, 1.0 - self._most), 1.0 + self._most)
        return self.value

    @property
    def is_at_limit(self) -> bool:
        return abs(self.value - 1.0) >= self._most * (1.0 - 1e-9)


class SlopeDrift:
    """Change of a hopper's slope in an hour, from its last windows."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=_DRIFT_WINDOWS)

    def add(self, time_s: float, slope: float) -> float | None:
        """Add a window's slope, over that measured before the run; the drift per hour, or None."""
        self._points.append((time_s, slope))
        n = len(self._points)
        if n < 3:
            return None
        middle_t = sum(t for t, _ in self._points) / n
        middle = sum(value for _, value in self._points) / n
        spread = sum((t - middle_t) ** 2 for t, _ in self._points)
        both = sum((t - middle_t) * (value - middle) for t, value in self._points)
        return 3600.0 * both / spread
