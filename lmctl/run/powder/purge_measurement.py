"""A purge over the catch scale: hoppers pulsed in turn, and what their powder shows of the hoses.

The scale is looked for while gas flows and no powder does. Where it is not there, not at rest, full
or bumped, the purge is an ordinary one: the journal says why, and nothing else changes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from lmctl.calibration.estimate import STANDARD_ERRORS_OF_95_PERCENT, Estimate
from lmctl.calibration.hose_fit import ScaleFacts, SharedScaleFit, fit_hoses
from lmctl.config.machine import HopperSettings
from lmctl.config.measuring import CalibrationUse, PurgeMeasuringSettings, ScaleSettings
from lmctl.errors import LmctlError, MachineError
from lmctl.machine.measuring.purge_pulses import (
    PurgePulses,
    SetpointChange,
    plan_pulses,
    setpoint_histories,
    shortest_pulses_s,
)
from lmctl.machine.measuring.record_checks import StandstillWatch
from lmctl.machine.scale.driver import CatchScaleDriver
from lmctl.machine.timer_wheel import align_to_tick
from lmctl.run.journal.recorder import RunRecorder
from lmctl.run.powder.hose_calibration import HoseCalibration
from lmctl.run.powder.setpoint_sender import SetpointSender

#: The display must be at rest so soon, at most, where the time of the purge allows it [s].
_REST_PATIENCE_S = 15.0
#: Whitened residuals are of variance 1: so far out is no noise.
_BUMP = 8.0
#: A fit with more than so many times the noise of the feeder tests, or with a slope beyond these,
#: is of something else than these hoppers' powder.
_MAX_NOISE = 6.0
_SLOPES = (0.7, 1.4)
#: Answers of the scale may make a purge so much longer than it was planned [s].
_LATE_S = 1.0
_LEAST_READINGS = 30


class PurgeMeasurement:
    """The measurements of one run, one a purge.

    hoses : what is in use, and receives what is measured
    """

    def __init__(
        self, settings: ScaleSettings, hoppers: Sequence[HopperSettings],
        use: CalibrationUse | None, hoses: HoseCalibration, recorder: RunRecorder,
    ) -> None:
        assert settings.purge is not None
        self._settings = settings
        self._purge: PurgeMeasuringSettings = settings.purge
        self._hoppers = tuple(hoppers)
        self._use = use
        self._hoses = hoses
        self._recorder = recorder
        self._loop = asyncio.get_running_loop()
        self._scale: CatchScaleDriver | None = None
        self._pulses: PurgePulses | None = None
        self._facts: ScaleFacts | None = None
        self._began_s = 0.0

    @property
    def low_flows_g_min(self) -> tuple[float, ...] | None:
        """Set-points to begin with, in the hoppers' order; None where this purge measures nothing.
        """
        return None if self._pulses is None else self._pulses.lows_g_min

    async def prepare(self) -> None:
        """See whether the scale is there and at rest, and plan the pulses. No powder flows yet."""
        self._pulses, self._began_s = None, self._loop.time()
        try:
            await self._prepare()
        except LmctlError as error:
            self._give_up(error.what)

    async def measure(self, feed: SetpointSender) -> None:
        """Powder runs at the low flows: pulse the hoppers, weigh, and use what that shows.

        It leaves the hoppers at their low flows.
        """
        pulses, scale, facts = self._pulses, self._scale, self._facts
        if pulses is None or scale is None or facts is None:
            return
        self._pulses = None
        try:
            async with asyncio.timeout(pulses.end_s + _LATE_S):
                changes, times, masses = await self._pulsed(feed, pulses, scale)
            found = await asyncio.to_thread(
                fit_hoses, setpoint_histories(pulses.lows_g_min, changes), np.array(times),
                np.array(masses), facts, self._hoses.beliefs())
            _refuse_other_powder(found, scale)
        except TimeoutError:
            self._give_up("the scale answers too late")
        except (LmctlError, ValueError, np.linalg.LinAlgError) as error:
            self._give_up(error.what if isinstance(error, LmctlError) else str(error))
        else:
            self._hoses.take(found.hoses, self._loop.time() - self._began_s)

    async def close(self) -> None:
        """Disconnect from the scale."""
        scale, self._scale = self._scale, None
        if scale is not None:
            with suppress(LmctlError, TimeoutError):
                async with asyncio.timeout(_LATE_S):
                    await scale.close()

    # --- before powder ------------------------------------------------------------------------

    async def _prepare(self) -> None:
        """Raises MachineError, ConfigError where nothing can be measured."""
        lag_s, rsd, correlation_s = self._known()
        if self._scale is None:
            self._scale = await CatchScaleDriver.open(self._settings)
        scale = self._scale
        self._facts = facts = ScaleFacts(lag_s, rsd, correlation_s, scale.resolution_g)
        beliefs = self._hoses.beliefs()
        shortest_s = shortest_pulses_s(self._hoppers, beliefs, facts)
        left_s = self._purge.max_s - _LATE_S - (self._loop.time() - self._began_s)
        if shortest_s > left_s:
            raise scale.error(
                f"a pulse of each hopper takes {shortest_s:.0f} s, and scale.purge.max_s leaves "
                f"{left_s:.0f} s", "raise max_s")
        await self._until_at_rest(scale, min(_REST_PATIENCE_S, left_s - shortest_s))
        left_s = self._purge.max_s - _LATE_S - (self._loop.time() - self._began_s)
        self._pulses = plan_pulses(
            self._hoppers, beliefs, facts, period_s=scale.period_s, within_s=left_s,
            wanted_half_s=self._purge.precision_s)

    def _known(self) -> tuple[Estimate, float, float]:
        """Lag of the scale; deviation and correlation time of the noise, the greatest of all."""
        tests = {} if self._use is None else self._use.feeder_tests
        mine = [tests[hopper.name] for hopper in self._hoppers if hopper.name in tests]
        if not mine:
            raise MachineError(
                "the lag of the scale is not known", hint="`lmctl machine feeder-test` measures it")
        value_s, half_s = mine[0].scale_lag_s
        return (Estimate(value_s, half_s / STANDARD_ERRORS_OF_95_PERCENT),
                max(one.noise_rsd for one in mine), max(one.noise_correlation_s for one in mine))

    async def _until_at_rest(self, scale: CatchScaleDriver, patience_s: float) -> None:
        deadline_s = self._loop.time() + patience_s
        while True:
            reading = await scale.read()
            if reading is not None and reading.is_overloaded:
                raise scale.error("it is full", "empty its pan")
            if reading is not None and reading.is_stable and reading.mass_g is not None:
                return
            if self._loop.time() + scale.period_s > deadline_s:
                raise scale.error("its display does not come to rest", "shield it from draught")
            await asyncio.sleep(scale.period_s)

    # --- under powder -------------------------------------------------------------------------

    async def _pulsed(
        self, feed: SetpointSender, pulses: PurgePulses, scale: CatchScaleDriver
    ) -> tuple[list[SetpointChange], list[float], list[float]]:
        """Carry the pulses out; returns them as they were made, and the readings, from now on."""
        start_s = self._loop.time()
        weigh_from_s, end_s = start_s + pulses.weigh_from_s, start_s + pulses.end_s
        watch = StandstillWatch(scale, sum(pulses.lows_g_min))
        flows = list(pulses.lows_g_min)
        due = [(align_to_tick(start_s + change.at_s, -1.0), change) for change in pulses.changes]
        made: list[SetpointChange] = []
        times: list[float] = []
        masses: list[float] = []
        while (now_s := self._loop.time()) < end_s - 1e-6:
            while due and due[0][0] <= now_s + 1e-6:
                _, change = due.pop(0)
                flows[change.hopper] = change.flow_g_min
                feed.hold_flows(tuple(flows))
                made.append(SetpointChange(now_s - start_s, change.hopper, change.flow_g_min))
            if now_s >= weigh_from_s:
                reading = await scale.read()
                if reading is not None and reading.mass_g is not None:
                    watch.check(reading)
                    at_s = reading.time_s - start_s
                    if not times or at_s > times[-1]:
                        times.append(at_s)
                        masses.append(reading.mass_g)
            next_s = min(align_to_tick(now_s + scale.period_s, now_s), end_s,
                         due[0][0] if due else end_s)
            await asyncio.sleep(max(next_s - self._loop.time(), 0.0))
        if len(times) < _LEAST_READINGS:
            raise scale.error("it gave too few readings", "check its cable")
        return made, times, masses

    def _give_up(self, reason: str) -> None:
        """An ordinary purge: journaled with its reason."""
        self._recorder.record_hose_response(
            source="not measured", reason=reason,
            took_s=round(self._loop.time() - self._began_s, 1))


def _refuse_other_powder(found: SharedScaleFit, scale: CatchScaleDriver) -> None:
    """Raise MachineError where the record is not that of these pulses."""
    worst = float(np.abs(found.whitened_residual).max())
    if worst > _BUMP:
        raise scale.error("its display jumped", "it was knocked, or a lump fell")
    if found.more_noise > _MAX_NOISE:
        raise scale.error("what it shows does not follow the pulses",
                          "is it at the purge position, and shielded?")
    low, high = _SLOPES
    wrong = [slope.value for slope in found.slopes if not low < slope.value < high]
    if wrong:
        raise scale.error(f"it catches {wrong[0]:.2f} of what is fed",
                          "does all powder fall onto its pan?")
