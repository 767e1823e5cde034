"""The safety-input device: facts about the cell's safety circuits, each with its age.

Other modules decide what the facts mean for a run. `polling` does the talking to the device.
"""

from __future__ import annotations

from firmware_protocol.safety_io import RELAY_RESET_KEY, SIO_MAP, mirror_address_of
from lmctl.config.machine import SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.safety.identity import (
    SafetyIdentity,
    check_serial_line,
    describe_device,
    identify_safety_device,
)
from lmctl.machine.safety.polling import SILENT_PERIODS, SafetyPolling
from lmctl.machine.safety.status import SafetyCallbacks, SafetyStatus

#: A device on a network may take this long to answer, however short the period [s].
_MIN_PATIENCE_S = 0.05
_RESET_PATIENCE_S = 1.0
#: Longer than an output takes to follow a command, and a failure to follow takes to show [s].
_OUTPUT_PATIENCE_S = 0.2

_RELAY_RESET = SIO_MAP.wire_address("RELAY_RESET")


class SafetyDriver:
    """One safety-input device, opened by `open`.

    status : the last good answer, with inputs that opened since (see SafetyPolling)
    fault : why it cannot be relied on, or None; callbacks : called with each event
    """

    def __init__(self, link: ModbusLink, safety: SafetySettings, identity: SafetyIdentity) -> None:
        self.identity = identity
        self._safety = safety
        self._link = link
        self._cycle = SafetyPolling(link, safety, identity.heartbeat)

    @classmethod
    async def open(cls, safety: SafetySettings) -> SafetyDriver:
        """Connect, see what it is, and begin its heartbeat; returns with a first status.

        An open relay stays open: see `reset_watchdog_relay`.
        Raises MachineError where it cannot be reached, is something else, or gives no good
        answer; ConfigError for a bad endpoint, or a line too slow for the period.
        """
        check_serial_line(safety)
        timeout_s = max(safety.period_s, _MIN_PATIENCE_S)
        try:
            link = await ModbusLink.open(safety, timeout_s=timeout_s, mirror=mirror_address_of)
        except MachineError as error:
            raise MachineError(
                f"safety device: {error.what}", where=error.where, hint=error.hint
            ) from error
        try:
            driver = cls(link, safety, await identify_safety_device(link, safety))
            await driver._cycle.read_first_status()
        except (NoReplyError, ModbusExceptionError) as error:
            await link.close()
            raise MachineError(
                f"safety device: {error.what}", where=describe_device(safety), hint=error.hint
            ) from error
        except BaseException:
            await link.close()
            raise
        driver._cycle.start()
        return driver

    @property
    def callbacks(self) -> SafetyCallbacks:
        return self._cycle.listener

    @callbacks.setter
    def callbacks(self, listener: SafetyCallbacks) -> None:
        self._cycle.listener = listener

    @property
    def period_s(self) -> float:
        """Between two answers."""
        return self._safety.period_s

    @property
    def status(self) -> SafetyStatus | None:
        return self._cycle.status

    @property
    def fault(self) -> MachineError | None:
        return self._cycle.fault

    @property
    def status_age_s(self) -> float:
        """Time since the last good answer; infinite before the first."""
        return self._cycle.status_age_s

    @property
    def has_laser_enable(self) -> bool:
        """Whether the profile names its laser-enable output."""
        return self._cycle.laser is not None

    async def reset_watchdog_relay(self) -> None:
        """Close an open watchdog relay and forget the first-out code, as an operator's act.

        Returns when the device shows it. An input that is still open becomes the first-out again.
        Raises MachineError where it refuses, or the relay does not close.
        """
        try:
            await self._link.write(_RELAY_RESET, [RELAY_RESET_KEY])
        except (NoReplyError, ModbusExceptionError) as error:
            reason = f"it does not reset its relay: {error.what}"
            raise self._cycle.device_error(reason, error.hint) from error
        wanted_s = self._cycle.now_s
        await self._cycle.wait_until(
            lambda good: good.time_s >= wanted_s and good.relay_closed is not False,
            _RESET_PATIENCE_S + SILENT_PERIODS * self._safety.period_s,
            "its watchdog relay does not close", "check the relay and its supply",
        )

    def request_laser_enable(self, on: bool) -> None:
        """Switch the laser-enable output off or on. Returns at once; no effect without an output.

        The command goes out in a request of its own, straight after any request under way, and
        again in every later request. Off comes first: on is sent only after off has been read
        back, and is ignored while the output cannot be relied on.
        """
        laser = self._cycle.laser
        if laser is not None and laser.wanted != on:
            laser.request(on)
            self._cycle.send_now()

    async def wait_for_laser_enable(self, on: bool) -> None:
        """Wait until the output reads back as commanded by `request_laser_enable`.

        Returns at once where there is no output. Raises MachineError where it does not follow
        within a few periods; it is then off, or commanded off.
        """
        if (laser := self._cycle.laser) is None:
            return

        def shown(_: SafetyStatus) -> bool:
            if (fault := laser.fault_against(on)) is not None:
                raise self._cycle.device_error(fault.reason, fault.hint)
            return laser.is_confirmed(on)

        try:
            await self._cycle.wait_until(
                shown, _OUTPUT_PATIENCE_S + SILENT_PERIODS * self._safety.period_s,
                f"its laser-enable output does not {'come on' if on else 'drop'}",
                "check the device, its cable and the output's wiring",
            )
        except MachineError:
            self.request_laser_enable(False)
            raise

    async def close(self) -> None:
        """Drop the output, end the heartbeat, disconnect; a relay opens by itself in its time."""
        try:
            await self._cycle.stop()
        finally:
            await self._link.close()
