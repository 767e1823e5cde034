"""One powder feeder: an order is complete when the device's own status confirms it."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence

from firmware_protocol.pmx import (
    ALARM_RESET_KEY,
    PMX_MAP,
    WATCHDOG_RESET_KEY,
    FeederCommandBits,
    FeederStateCode,
)
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.feeder_errors import REFUSED_HINT
from lmctl.machine.feeder.feeder_link import (
    FeederLink,
    IdentifiedFeederLink,
    identify_by_map,
    open_feeder_link,
)
from lmctl.machine.feeder.identity import FeederIdentity
from lmctl.machine.feeder.orders import ORDER_TIMEOUT_S, FeederOrders
from lmctl.machine.feeder.polling import FeederPolling
from lmctl.machine.feeder.readings import HopperReading
from lmctl.machine.feeder.recipe import post_flow_duration_s
from lmctl.machine.feeder.refill import HopperRefill
from lmctl.machine.feeder.status import GAS_ORDERED_STATES, FeederCallbacks, FeederStatus
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.modbus.opening_retries import answer_with_retries

_BOOT_PATIENCE_S = 15.0
_MAX_ANSWER_S = 1.0

_WD_RESET = PMX_MAP.wire_address("WD_RESET")
_POSTFLOW = PMX_MAP.wire_address("POSTFLOW")


class FeederDriver:
    """A feeder and those of its hoppers that are used."""

    def __init__(
        self, link: FeederLink, feeder: FeederSettings, hoppers: Sequence[HopperSettings],
        identity: FeederIdentity,
    ) -> None:
        self.name = feeder.name
        self.hoppers = tuple(hoppers)
        self.identity = identity
        self._feeder = feeder
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._cycle = FeederPolling(link, feeder, hoppers, identity)
        self._orders = FeederOrders(link, self._cycle, feeder)

    @classmethod
    async def open(cls, feeder: FeederSettings, hoppers: Sequence[HopperSettings]) -> FeederDriver:
        """Connect, identify it, set its watchdog and take remote control; discs are stopped.

        A latched alarm does not keep it from opening: `status` shows it, `start_gas` refuses.
        Raises MachineError where it cannot be reached, is no PMX feeder, lacks a hopper, or
        does not let itself be commanded; ConfigError for a bad endpoint.
        """
        timeout_s = min(_MAX_ANSWER_S, feeder.watchdog_s / 4.0)
        link = await _connect(feeder, hoppers, timeout_s)
        try:
            driver = cls(link, feeder, hoppers, await _identified(link, feeder, hoppers))
            await driver._take_command()
        except BaseException:
            await link.close()
            raise
        return driver

    @property
    def status(self) -> FeederStatus | None:
        """The last good answer."""
        return self._cycle.status

    @property
    def status_age_s(self) -> float:
        """Time since the last good answer; infinite before the first."""
        return self._cycle.status_age_s

    @property
    def wire_symptoms(self) -> str:
        """What came on the wire since the last good answer, in words; "" where nothing is wrong."""
        observation = self._link.wire_observation
        return observation.description if observation.has_anomalies else ""

    @property
    def period_s(self) -> float:
        """How often it is asked."""
        return self._cycle.period_s

    @property
    def fault(self) -> MachineError | None:
        """The first reason why the feeder cannot be relied on, from `start_gas` on."""
        return self._cycle.fault

    @property
    def callbacks(self) -> FeederCallbacks:
        """Callables that receive the answers and the first fault."""
        return self._cycle.listener

    @callbacks.setter
    def callbacks(self, listener: FeederCallbacks) -> None:
        self._cycle.listener = listener

    def set_flows(self, flows_g_min: Mapping[str, float]) -> None:
        """Set the flow of each hopper, by its name; the latest call counts.

        Returns at once; all hoppers change together, as one recipe. Flows equal at the device's
        resolution (0.01 g/min) are not sent again.
        Raises ValueError for a flow that is no number, out of range, or of an unknown hopper.
        """
        self._cycle.set_flows(flows_g_min)

    def correct_slope(self, hopper: str, correction: float) -> None:
        """From now on a hopper is taken to feed `correction` times its calibrated slope.

        Set-points change accordingly, at once; flows as reported too. Raises KeyError for an
        unknown hopper.
        """
        self._cycle.correct_slope(hopper, correction)

    def request_hopper_readings(self) -> None:
        """Read the hoppers with the next status, and not only with every fourth."""
        self._cycle.request_hopper_readings()

    async def complete_status(self) -> FeederStatus:
        """The last status, once each hopper in use has been read. Raises MachineError."""
        names = {hopper.name for hopper in self.hoppers}
        if self.status is None or names - self.status.hoppers.keys():
            await self._cycle.wait_until(
                lambda status: names <= status.hoppers.keys(), ORDER_TIMEOUT_S + 2 * self.period_s,
                "its hoppers were not read",
            )
        assert self.status is not None
        return self.status

    async def start_gas(self) -> None:
        """Carrier gas on; returns when its pre-flow is over.

        Raises MachineError where an alarm is latched, the device refuses, or gas does not come.
        """
        if self.status is not None and self.status.alarm is not None:
            alarm = self.status.alarm
            raise self._cycle.errors.error(alarm.text, f"{alarm.remedy}, then reset the alarm")
        self._cycle.watching = True
        started_s = self._loop.time()
        preflow_s = self._feeder.gas_preflow_s
        await self._orders.add_command_bits(FeederCommandBits.GAS_ON, "start gas")
        await self._cycle.wait_until(
            lambda status: status.gas_ok and status.time_s - started_s >= preflow_s,
            preflow_s + 2 * ORDER_TIMEOUT_S, "carrier gas did not come",
        )

    async def start_powder(self) -> None:
        """Discs on, at the flows last set; returns when they turn. See `stable` for the flow.

        Raises MachineError where the device refuses, or they do not start.
        """
        await self._orders.add_command_bits(FeederCommandBits.FEED_ON, "start powder")
        await self._cycle.wait_until(
            lambda status: status.feeding, ORDER_TIMEOUT_S, "powder did not start"
        )
        self._cycle.feeding = True

    async def wait_until_stable(self, timeout_s: float) -> None:
        """Return when the device calls its powder stable. Raises MachineError after timeout_s."""
        await self._cycle.wait_until(
            lambda status: status.stable, timeout_s, "powder did not get stable"
        )

    async def stop_powder(self) -> None:
        """Discs off; returns when they have stopped. Gas flows on. Raises MachineError.

        A device at LOCAL or in alarm may refuse: then it counts what its discs do.
        """
        self._cycle.feeding = False
        await self._orders.remove_command_bits(
            FeederCommandBits.FEED_ON, lambda status: not status.feeding, "powder did not stop"
        )

    async def stop_gas(self, *, post_flow: bool = True) -> None:
        """Gas (and powder) off, after the post-flow that empties the hose; without it, at once.

        Returns when gas has stopped. Raises MachineError.
        """
        self._cycle.watching = self._cycle.feeding = False
        everything = ~FeederCommandBits.ENABLE_REMOTE
        await self._orders.remove_command_bits(
            everything, lambda status: status.state not in GAS_ORDERED_STATES, "gas did not stop"
        )
        if not post_flow:
            await self._orders.repeat_until_done(
                lambda: self._link.write(_POSTFLOW, [0]), _gas_has_stopped, "gas did not stop"
            )
        await self._cycle.wait_until(
            _gas_has_stopped,
            post_flow_duration_s(self._feeder, self.hoppers) + 2 * ORDER_TIMEOUT_S,
            "gas did not stop", faulty=True,
        )

    async def open_hopper(self, hopper: str) -> HopperReading:
        """Powder and gas off, the hose emptied; returns when the hopper may be opened to refill it.

        Its weighing is frozen until `close_hopper`. Returns its reading before.
        Raises MachineError.
        """
        await self.stop_gas()
        return await HopperRefill(self._cycle, self._orders).open(hopper)

    async def close_hopper(self, hopper: str) -> HopperReading:
        """A hopper has been refilled and closed: returns its reading once the weight is steady.

        Raises MachineError.
        """
        return await HopperRefill(self._cycle, self._orders).close(hopper)

    async def reset_alarms(self) -> None:
        """Reset a latched watchdog trip and alarms, as an operator's deliberate act.

        Raises MachineError where a cause remains.
        """
        alarm = None if self.status is None else self.status.alarm
        reset = self._link.write(_WD_RESET, [WATCHDOG_RESET_KEY, ALARM_RESET_KEY])
        try:
            await reset
        except ModbusExceptionError as error:
            reason = await self._cycle.errors.refusal_reason(error)
            what = "" if alarm is None else f"{alarm.text}; "
            raise self._cycle.errors.error(
                f"{what}it refuses to reset its alarms: {reason}",
                REFUSED_HINT if alarm is None else alarm.remedy,
            ) from error
        except NoReplyError as error:
            raise self._cycle.errors.error(error.what, error.hint) from error
        self._cycle.reset_fault()
        await self._orders.take_remote_control()
        await self._cycle.wait_until(
            lambda status: status.alarm is None, ORDER_TIMEOUT_S, "its alarms did not clear"
        )

    async def close(self) -> None:
        """Stop the discs, give command back, and disconnect; a dead device is just left.

        The device runs its gas post-flow by itself.
        """
        self._cycle.watching = self._cycle.feeding = False
        try:
            await self._cycle.stop()
        finally:
            try:
                await self._orders.release_command()
            finally:
                await self._link.close()

    async def _take_command(self) -> None:
        """First status, settings and zero flows; then remote control, which arms its watchdog."""
        deadline_s = self._loop.time() + _BOOT_PATIENCE_S
        while True:
            status = await self._cycle.errors.request_answer(
                answer_with_retries(self._cycle.read_first_status, self._cycle.period_s),
                "show its status")
            if status.state is not FeederStateCode.BOOT or self._loop.time() >= deadline_s:
                break
            await asyncio.sleep(self._cycle.period_s)
        await self._cycle.errors.request_answer(
            answer_with_retries(self._cycle.poll_once, self._cycle.period_s), "take its settings")
        await self._orders.take_remote_control()
        self._cycle.start()


def _gas_has_stopped(status: FeederStatus) -> bool:
    return status.state not in (*GAS_ORDERED_STATES, FeederStateCode.STOPPING)


async def _connect(
    feeder: FeederSettings, hoppers: Sequence[HopperSettings], timeout_s: float
) -> ModbusLink | IdentifiedFeederLink:
    try:
        return await open_feeder_link(feeder, hoppers, timeout_s)
    except MachineError as error:
        raise MachineError(
            f"feeder {feeder.name}: {error.what}", where=error.where, hint=error.hint
        ) from error


async def _identified(
    link: ModbusLink | IdentifiedFeederLink, feeder: FeederSettings,
    hoppers: Sequence[HopperSettings],
) -> FeederIdentity:
    try:
        return await identify_by_map(link, feeder, hoppers)
    except (NoReplyError, ModbusExceptionError) as error:
        raise MachineError(
            f"feeder {feeder.name}: {error.what}",
            where=f"{feeder.endpoint}, device {feeder.device_id}", hint=error.hint,
        ) from error
