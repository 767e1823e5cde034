"""Steps of a feeder test: levels, how long each is held, and how long the test goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from lmctl.calibration.step_fit import FeederResponse
from lmctl.config.machine import HopperSettings
from lmctl.errors import ConfigError

#: Steps go from the least level to so many times of it, or more.
LEAST_RATIO = 8.0
_RATIO = 10.0
#: The least level stands so far above the hopper's least steady flow.
_ABOVE_LEAST = 1.25
#: A hopper whose profile names no least flow is tested up to this share of its greatest.
_SHARE_OF_MOST = 0.5
#: Each level is held so long at least [s], and a first fit is made after so many steps.
_LEAST_HOLD_S = 20.0
_FIRST_STEPS = 8
#: The end of what is planned may be missed by chance: a little more than predicted.
_MORE = 1.1


@dataclass(frozen=True)
class WantedPrecision:
    """Half widths of the 95 % intervals that a test goes on for.

    dead_time_s [s]; lag, slope : as shares of the value
    """

    dead_time_s: float = 0.05
    lag: float = 0.06
    slope: float = 0.006

    def duration_factor(self, response: FeederResponse) -> float:
        """By what a test has to be longer: errors fall with the square root of its length.

        At most 1 where every interval is as narrow as wanted.
        """
        fit = response.one_lag
        ratios = (fit.dead_time_s.half_width / self.dead_time_s,
                  fit.lag_s.relative_half_width / self.lag,
                  response.slope.relative_half_width / self.slope)
        return max(ratios) ** 2


@dataclass(frozen=True)
class StepPlan:
    """low_g_min, high_g_min : the two levels, as set-points of the feeder
    settle_s : powder runs at the lower one for so long before the first step
    hold_s : between steps
    limit_s : longest test, from the first powder on
    """

    low_g_min: float
    high_g_min: float
    settle_s: float
    hold_s: float
    limit_s: float

    @property
    def max_steps(self) -> int:
        """Steps that fit into the limit, the last level held whole."""
        return int((self.limit_s - self.settle_s) / self.hold_s)

    @property
    def powder_g(self) -> float:
        """Powder that a test of the full length takes."""
        return self.limit_s / 60.0 * (self.low_g_min + self.high_g_min) / 2.0

    def steps_for(self, done: int, factor: float) -> int:
        """Steps in all that make a test `factor` times as long as `done` steps, to the limit."""
        return min(max(math.ceil(done * factor * _MORE), done + 2), self.max_steps)

    @property
    def steps_before_first_fit(self) -> int:
        """Steps after which the first fit is made."""
        return min(_FIRST_STEPS, self.max_steps)


def step_levels_g_min(hopper: HopperSettings) -> tuple[float, float]:
    """Set-points between which a hopper is stepped, the greater of them last.

    Raises ConfigError where its range does not hold steps of 1:8.
    """
    most = hopper.max_flow_g_min
    least = hopper.min_flow_g_min
    low = least * _ABOVE_LEAST if least > 0 else _SHARE_OF_MOST * most / _RATIO
    if low * LEAST_RATIO > most:
        low = max(least, most / LEAST_RATIO)
    low = math.ceil(100.0 * low) / 100.0
    high = math.floor(100.0 * min(_RATIO * low, most)) / 100.0
    if high < LEAST_RATIO * low - 0.05:
        raise ConfigError(
            f"hopper {hopper.name} cannot be tested with steps of 1:{LEAST_RATIO:g}",
            where=f"it feeds {least:g} to {most:g} g/min",
            hint="correct min_flow_g_min and max_flow_g_min in the profile, or test it by hand")
    return low, high


def plan_steps(hopper: HopperSettings, limit_s: float = 600.0) -> StepPlan:
    """The steps of a hopper's test.

    Raises ConfigError where its range does not hold steps of 1:8, or the limit no four steps.
    """
    low, high = step_levels_g_min(hopper)
    settling_s = hopper.dead_time_s + 5.0 * hopper.lag_s
    plan = StepPlan(low, high, max(20.0, 2.0 * settling_s + 5.0),
                    max(_LEAST_HOLD_S, 2.0 * settling_s), limit_s)
    if plan.max_steps < 4:
        raise ConfigError(f"{limit_s:g} s are too short for a test of hopper {hopper.name}",
                          where=f"four steps take {plan.settle_s + 4 * plan.hold_s:.0f} s",
                          hint="allow it more time")
    return plan
