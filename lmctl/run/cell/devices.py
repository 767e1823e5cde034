"""The devices of a cell, opened together and commanded together. Knows no job."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from firmware_protocol.status import StatusReport
from lmctl.config.machine import (
    FeederSettings,
    HopperSettings,
    MachineProfile,
    MotionSettings,
    SafetySettings,
)
from lmctl.errors import LmctlError, MachineError
from lmctl.machine.feeder.driver import FeederDriver
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.motion.driver import MotionDriver
from lmctl.machine.safety.driver import SafetyDriver

#: A nozzle within this of a place is there [mm]: a step of any common machine is finer.
_THERE_MM = 0.05

_CLOSE_S = 2.0


class ReportAges(NamedTuple):
    """How old the last report of each device is [s]; None where there is none, or no device.

    hoppers : {hopper: age of its last reading}
    """

    motion_s: float | None = None
    safety_s: float | None = None
    hoppers: Mapping[str, float] = MappingProxyType({})


class Cell:
    """One motion controller, the feeders a job uses, and the safety inputs where there are any.

    hoppers : those of the profile that the job uses, in the job's order
    offset_mm : the work offset it was accepted with; empty before
    """

    def __init__(
        self, motion: MotionDriver, feeders: Sequence[FeederDriver],
        safety: SafetyDriver | None, hoppers: Sequence[HopperSettings],
    ) -> None:
        self.motion = motion
        self.feeders = tuple(feeders)
        self.safety = safety
        self.hoppers = tuple(hoppers)
        self.offset_mm: tuple[float, ...] = ()
        self._feeder_of = {
            hopper.name: feeder
            for hopper in self.hoppers for feeder in self.feeders if feeder.name == hopper.feeder
        }
        self._waiting: list[asyncio.Future[None]] = []

    @classmethod
    async def connect(cls, profile: MachineProfile, hoppers: Sequence[HopperSettings]) -> Cell:
        """Open motion, the hoppers' feeders and the safety inputs, all at once.

        Raises MachineError: one report however many devices fail; those that answered are closed.
        """
        names = {hopper.feeder for hopper in hoppers}
        feeders = [feeder for feeder in profile.feeder if feeder.name in names]
        safety_first: list[asyncio.Future[Any]] = []
        if profile.safety is not None:
            safety_first.append(asyncio.ensure_future(_open_safety(profile.safety)))
        opening: list[asyncio.Future[Any]] = [
            asyncio.ensure_future(_open_motion(profile.motion, safety_first)),
            *(asyncio.ensure_future(_open_feeder(feeder, hoppers)) for feeder in feeders),
            *safety_first,
        ]
        try:
            await asyncio.wait(opening)
            if failures := [error for one in opening if (error := one.exception())]:
                raise _one_report(failures)
            motion, *others = (one.result() for one in opening)
            safety = others.pop() if profile.safety is not None else None
            return cls(motion, others, safety, hoppers)
        except BaseException:  # cancellation included
            await _close_all(opening)
            raise

    async def close(self) -> None:
        """Close every link; the devices are left as they are."""
        devices: list[MotionDriver | FeederDriver | SafetyDriver] = [self.motion, *self.feeders]
        if self.safety is not None:
            devices.append(self.safety)
        await asyncio.gather(*map(_close, devices), return_exceptions=True)

    def notify_report(self) -> None:
        """A device has reported: wake the waiting callers to check again."""
        waiting, self._waiting = self._waiting, []
        for future in waiting:
            if not future.done():
                future.set_result(None)

    async def wait_until(
        self, condition: Callable[[], bool], timeout_s: float, what: str, hint: str = ""
    ) -> None:
        """Wait for a condition on the devices' reports. Raises MachineError after the time-out."""
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    future = asyncio.get_running_loop().create_future()
                    self._waiting.append(future)
                    await future
        except TimeoutError:
            raise MachineError(
                f"{what} did not come about within {timeout_s:.0f} s", hint=hint
            ) from None

    async def wait_at_position(self, place_mm: Iterable[float | None], timeout_s: float) -> None:
        """Wait until the machine is idle at a place (None: wherever in that axis)."""
        wanted = tuple(place_mm)

        def there() -> bool:
            report, at = self.motion.status, self.motion.position_mm
            return is_idle(report) and at is not None and all(
                want is None or abs(want - have) < _THERE_MM
                for want, have in zip(wanted, at, strict=False)
            )

        try:
            await self.wait_until(there, timeout_s, "the move to the purge position")
        except MachineError as error:
            at_mm = self.motion.position_mm
            if at_mm is None or not is_idle(self.motion.status):
                raise
            position = " ".join(f"{axis}{at:.3f}" for axis, at in zip("XYZ", at_mm, strict=False))
            raise MachineError(
                f"the machine is at {position}, not at the purge position: a line was damaged "
                "on its way", where=error.what,
                hint="check cable and earthing of the controller",
            ) from None

    def set_flows(self, flows_g_min: dict[str, float]) -> None:
        """Hand each feeder the set-points of its hoppers, by hopper name."""
        for feeder in self.feeders:
            feeder.set_flows({
                hopper.name: flows_g_min[hopper.name]
                for hopper in self.hoppers if hopper.feeder == feeder.name
            })

    @property
    def shield_gas_L_min(self) -> float | None:
        """As the safety device last reported it; None where it has none, or measures none."""
        status = None if self.safety is None else self.safety.status
        return None if status is None else status.shield_gas_L_min

    def correct_slope(self, hopper: str, correction: float) -> None:
        """Take a hopper's slope to have changed, so that its set-points follow."""
        self._feeder_of[hopper].correct_slope(hopper, correction)

    def hopper_readings(self) -> tuple[HopperReading | None, ...]:
        """The last reading of each hopper, in the hoppers' order; None before the first."""
        return tuple([self.hopper_reading(name) for name in self._feeder_of])

    def hopper_reading(self, hopper: str) -> HopperReading | None:
        """The last feeder report of a hopper; None before the first."""
        status = self._feeder_of[hopper].status
        return None if status is None else status.hoppers.get(hopper)

    def report_ages(self) -> ReportAges:
        """How old the devices' last reports are."""
        t, safety = asyncio.get_running_loop().time(), self.safety
        return ReportAges(
            None if self.motion.status is None else self.motion.status_age_s,
            None if safety is None or safety.status is None else safety.status_age_s,
            {hopper.name: t - reading.time_s
             for hopper, reading in zip(self.hoppers, self.hopper_readings(), strict=True)
             if reading is not None})

    def hopper_levels(self) -> list[dict[str, Any]]:
        """How full the hoppers are that report it: hopper, level_percent, weight_g, as JSON."""
        return [
            {"hopper": hopper.name, "level_percent": reading.level_percent,
             "weight_g": reading.weight_g}
            for hopper, reading in zip(self.hoppers, self.hopper_readings(), strict=True)
            if reading is not None and not (reading.level_percent is reading.weight_g is None)
        ]

    async def for_each_feeder(
        self, act: Callable[[FeederDriver], Awaitable[None]],
        those: Iterable[FeederDriver] | None = None,
    ) -> None:
        """Have every feeder (or `those`) do the same at once; a dead one does not stop the others.

        Raises MachineError, one report for all that failed.
        """
        feeders = self.feeders if those is None else tuple(those)
        done = await asyncio.gather(*map(act, feeders), return_exceptions=True)
        if failures := [one for one in done if isinstance(one, BaseException)]:
            raise _one_report(failures)


def is_idle(report: StatusReport | None) -> bool:
    """Whether a report shows that nothing moves and nothing is held."""
    return report is not None and report.state == "Idle"


async def _close_all(opening: Sequence[asyncio.Future[Any]]) -> None:
    """Close the devices that have been opened, and stop opening the others."""
    for one in opening:
        one.cancel()
    for device in await asyncio.gather(*opening, return_exceptions=True):
        if not isinstance(device, BaseException):
            await device.close()


async def _close(device: MotionDriver | FeederDriver | SafetyDriver) -> None:
    """Close a link; one that will not close must not keep a run from ending."""
    async with asyncio.timeout(_CLOSE_S):
        await device.close()


async def _open_safety(safety: SafetySettings) -> SafetyDriver:
    """An open watchdog relay is closed: starting a run is the deliberate act for it."""
    driver = await SafetyDriver.open(safety)
    try:
        if safety.relay_timeout_s is not None:
            await driver.reset_watchdog_relay()
    except BaseException:
        await driver.close()
        raise
    return driver


async def _open_motion(
    motion: MotionSettings, safety_first: Sequence[asyncio.Future[Any]]
) -> MotionDriver:
    """The controller is held by its door input for as long as the watchdog relay is open."""
    if safety_first:
        await asyncio.wait(safety_first)
    return await MotionDriver.open(
        motion.endpoint, baud=motion.baud, status_period_s=motion.status_period_s
    )


async def _open_feeder(feeder: FeederSettings, hoppers: Sequence[HopperSettings]) -> FeederDriver:
    return await FeederDriver.open(feeder, [h for h in hoppers if h.feeder == feeder.name])


def _one_report(failures: Sequence[BaseException]) -> BaseException:
    """One error for several devices; a bug or a cancellation among them goes first, as it is."""
    expected = [one for one in failures if isinstance(one, LmctlError)]
    if len(expected) < len(failures):
        return next(one for one in failures if not isinstance(one, LmctlError))
    if len(expected) == 1:
        return expected[0]
    where = [
        line
        for error in expected
        for line in (error.what, *(f"  {place}" for place in error.where))
    ]
    return MachineError(
        f"{len(expected)} devices of the cell failed", where=where,
        hint="; ".join(dict.fromkeys(error.hint for error in expected if error.hint)),
    )
