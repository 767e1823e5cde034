"""Orders to a feeder, given once or repeated until they take effect.

An order that switches something on is given once; one that only switches something off is repeated.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from firmware_protocol.pmx import PMX_MAP, FeederCommandBits
from lmctl.config.machine import FeederSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.feeder_link import FeederLink
from lmctl.machine.feeder.polling import FeederPolling
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.modbus.client import ModbusExceptionError, NoReplyError
from lmctl.machine.modbus.opening_retries import answer_with_retries

#: An order that switches something off is repeated after this interval, for at most this time [s].
_AGAIN_S = 0.1
ORDER_TIMEOUT_S = 5.0
_CLOSE_PATIENCE_S = 1.0

_COMMAND = PMX_MAP.wire_address("COMMAND")


class FeederOrders:
    """Gives orders over a link whose cycle reads the device's status."""

    def __init__(self, link: FeederLink, cycle: FeederPolling, feeder: FeederSettings) -> None:
        self._link = link
        self._cycle = cycle
        #: After this silence the device's own watchdog has stopped it.
        self._silent_s = feeder.watchdog_s + cycle.period_s
        self._loop = asyncio.get_running_loop()

    async def set_command(self, command: FeederCommandBits, what: str) -> None:
        """The whole command word. Raises MachineError where it is refused or not answered."""
        await self._give(command, self._write(command), what)

    async def take_remote_control(self) -> None:
        """Take commands from this host; the device's watchdog runs from here on.

        Repeated while answers get lost: it starts neither disc nor gas.
        Raises MachineError where it is refused or not answered.
        """
        command = FeederCommandBits.ENABLE_REMOTE
        request = answer_with_retries(lambda: self._write(command), _AGAIN_S)
        await self._give(command, request, "take commands")

    async def add_command_bits(self, bits: FeederCommandBits, what: str) -> None:
        """Put bits into the command. Raises as `set_command` does."""
        await self.set_command(self._cycle.command | bits, what)

    async def remove_command_bits(
        self, bits: FeederCommandBits, is_done: Callable[[FeederStatus], bool], failure: str
    ) -> None:
        """Take bits out of the command, again and again until the status shows that it worked."""
        command = self._cycle.command & ~bits
        self._cycle.command = command  # the cycle itself repeats it for as long as it must
        await self.repeat_until_done(lambda: self._write(command), is_done, failure)

    async def repeat_until_done(
        self, order: Callable[[], Awaitable[None]], is_done: Callable[[FeederStatus], bool],
        failure: str,
    ) -> None:
        """Repeat an order that only switches something off until it has taken effect.

        A lost answer leaves open whether the device acted, and a device that refuses may act by
        itself: its status decides. A device that has been silent for longer than its watchdog has
        stopped its discs by itself and is not waited for.
        Raises MachineError after PATIENCE_S.
        """
        begun_s = self._loop.time()
        deadline_s = begun_s + ORDER_TIMEOUT_S
        while True:
            failed: MachineError | None = None
            try:
                await order()
            except (NoReplyError, ModbusExceptionError) as error:
                failed = error
            self._cycle.read_status_now()
            left_s = deadline_s - self._loop.time()
            if await self._cycle.is_condition_met_within(is_done, min(_AGAIN_S, left_s)):
                return
            is_dead = (isinstance(failed, NoReplyError)
                       and self._cycle.status_age_s >= self._silent_s)
            if is_dead or self._loop.time() >= deadline_s:
                raise self._cycle.errors.status_timeout_error(
                    failure, self._loop.time() - begun_s, self._cycle.status, failed
                ) from failed

    async def release_command(self) -> None:
        """Everything off, repeated until it is answered.

        A device that is gone, or at LOCAL, stops by its own watchdog.
        """
        deadline_s = self._loop.time() + _CLOSE_PATIENCE_S
        while True:
            try:
                await self._write(FeederCommandBits(0))
            except NoReplyError:
                if self._loop.time() >= deadline_s:
                    return
                await asyncio.sleep(_AGAIN_S)
            except MachineError:
                return
            else:
                return

    async def _give(
        self, command: FeederCommandBits, request: Awaitable[None], what: str
    ) -> None:
        await self._cycle.errors.request_answer(request, what)
        self._cycle.command = command
        self._cycle.read_status_now()

    async def _write(self, command: FeederCommandBits) -> None:
        await self._link.write(_COMMAND, [int(command)])
