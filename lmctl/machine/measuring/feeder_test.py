"""A hopper stepped over the catch scale, beam off, for as long as its intervals need.

The test sets two levels in turn, reads the scale all the while, fits, and goes on until the
intervals are as narrow as wanted or its time is over. It knows the devices' wires and nothing else.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lmctl.array_types import FloatArray
from lmctl.calibration.estimate import Estimate
from lmctl.calibration.step_fit import FeederResponse, WeighedSteps, fit_feeder_response
from lmctl.calibration.step_response import SetpointHistory
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.measuring.record_checks import (
    StandstillWatch,
    check_bumps,
    check_rest,
    feeder_doubts,
)
from lmctl.machine.measuring.step_plan import StepPlan, WantedPrecision
from lmctl.machine.scale.driver import CatchScaleDriver
from lmctl.machine.timer_wheel import align_to_tick

_REST_S = 6.0
#: Before the powder of the first level has come there is nothing to watch [s].
_NOT_YET_S = 15.0


@dataclass(frozen=True)
class FeederTestResult:
    """What a hopper's test has found.

    is_precise : every interval is as narrow as wanted
    more_s : how much longer the test would have to go on for that; 0 where it is
    doubts : what speaks against the feeder, in words
    """

    hopper: HopperSettings
    plan: StepPlan
    steps: WeighedSteps
    response: FeederResponse
    scale_lag_s: Estimate
    is_precise: bool
    more_s: float
    doubts: tuple[str, ...]


class FeederTest:
    """The test of one hopper.

    hopper : as in the profile; its slope and offset are left aside
    scale_lag_s : of the scale, as measured
    notice : called with a line of text as the test goes on
    """

    def __init__(
        self, feeder: FeederSettings, hopper: HopperSettings, scale: CatchScaleDriver,
        scale_lag_s: Estimate, plan: StepPlan, wanted: WantedPrecision,
        notice: Callable[[str], None],
    ) -> None:
        self._feeder = feeder
        self._hopper = hopper
        self._raw = hopper.model_copy(update={"slope": 1.0, "offset_g_min": 0.0})
        self._scale = scale
        self._scale_lag_s = scale_lag_s
        self._plan = plan
        self._wanted = wanted
        self._notice = notice
        self._loop = asyncio.get_running_loop()
        self._watch = StandstillWatch(scale, plan.low_g_min)
        self._times: list[float] = []
        self._masses: list[float] = []
        self._set_s: list[float] = []
        self._levels: list[float] = []

    async def run(self) -> FeederTestResult:
        """Gas, powder, steps, powder off and the hose emptied. Raises MachineError."""
        room_g = self._scale.capacity_g - self._plan.powder_g
        if room_g < 0:
            raise self._scale.error(
                f"the test takes up to {self._plan.powder_g:.0f} g of powder, and it holds "
                f"{self._scale.capacity_g:g} g", "take a greater scale, or a shorter test")
        driver = await FeederDriver.open(self._feeder, [self._raw])
        try:
            await driver.start_gas()
            await self._scale.tare()
            await self._rest("before the test")
            response = await self._stepped(driver)
            await driver.stop_powder()
            settling_s = response.response_s.value + 6.0 * response.one_lag.lag_s.value
            await asyncio.sleep(settling_s + 5.0 * self._scale_lag_s.value)
            await self._rest("after the test")
            await driver.stop_gas()
        finally:
            await driver.close()
        steps = self._weighed()
        check_bumps(self._scale, steps, (response.two_lags or response.one_lag))
        factor = self._wanted.duration_factor(response)
        more_s = max(factor - 1.0, 0.0) * steps.duration_s
        return FeederTestResult(self._hopper, self._plan, steps, response, self._scale_lag_s,
                                factor <= 1.0, more_s, tuple(feeder_doubts(response.one_lag)))

    async def _stepped(self, driver: FeederDriver) -> FeederResponse:
        """Steps until the intervals are narrow enough, or time is over; the fit of all of them."""
        plan = self._plan
        self._set(driver, plan.low_g_min)
        await driver.start_powder()
        start_s = self._loop.time()
        await self._weigh_until(driver, start_s + plan.settle_s, keep=False)
        due_s = self._loop.time()
        wanted_steps, done = plan.steps_before_first_fit, 0
        while True:
            self._notice(f"hopper {self._hopper.name}: steps {done + 1} to {wanted_steps}, "
                         f"{plan.low_g_min:g} and {plan.high_g_min:g} g/min in turn")
            while done < wanted_steps:
                done += 1
                self._set(driver, plan.high_g_min if done % 2 else plan.low_g_min)
                due_s += plan.hold_s
                await self._weigh_until(driver, due_s, keep=True)
            response = await asyncio.to_thread(self._fit)
            due_s = max(due_s, self._loop.time())
            factor = self._wanted.duration_factor(response)
            if factor <= 1.0 or done >= plan.max_steps:
                return response
            wanted_steps = plan.steps_for(done, factor)

    def _set(self, driver: FeederDriver, level_g_min: float) -> None:
        self._set_s.append(self._loop.time())
        self._levels.append(level_g_min)
        driver.set_flows({self._hopper.name: level_g_min})

    async def _weigh_until(self, driver: FeederDriver, end_s: float, *, keep: bool) -> None:
        """Read the scale until end_s. Raises MachineError where feeder or scale fail."""
        begin_s = self._loop.time()
        while (now_s := self._loop.time()) < end_s - 1e-6:
            if driver.fault is not None:
                raise driver.fault
            status = driver.status
            if status is not None and not status.gas_ok:
                raise MachineError(f"feeder {driver.name}: carrier gas has stopped",
                                   hint="check bottle, regulator and hose, then test again")
            reading = await self._scale.read()
            if reading is not None and reading.mass_g is not None:
                if keep or now_s - begin_s > _NOT_YET_S:
                    self._watch.check(reading)
                if keep and (not self._times or reading.time_s > self._times[-1]):
                    self._times.append(reading.time_s)
                    self._masses.append(reading.mass_g)
            next_s = align_to_tick(now_s + self._scale.period_s, now_s)
            await asyncio.sleep(max(min(next_s, end_s) - self._loop.time(), 0.0))

    async def _rest(self, when: str) -> None:
        """Readings without powder, which must stand still."""
        times: list[float] = []
        masses: list[float] = []
        end_s = self._loop.time() + _REST_S
        while self._loop.time() < end_s:
            reading = await self._scale.read()
            if reading is not None and reading.mass_g is not None:
                times.append(reading.time_s)
                masses.append(reading.mass_g)
            await asyncio.sleep(self._scale.period_s)
        check_rest(self._scale, _array(times), _array(masses), when)

    def _weighed(self) -> WeighedSteps:
        history = SetpointHistory(_array(self._set_s), _array(self._levels))
        return WeighedSteps(history, _array(self._times), _array(self._masses),
                            self._scale.resolution_g)

    def _fit(self) -> FeederResponse:
        return fit_feeder_response(self._weighed(), self._scale_lag_s,
                                   dead_time_guess_s=self._hopper.dead_time_s)


def _array(values: list[float]) -> FloatArray:
    return np.array(values, dtype=np.float64)
