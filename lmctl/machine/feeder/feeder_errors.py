"""What goes wrong with a feeder, in words that name it."""

from __future__ import annotations

from collections.abc import Awaitable
from typing import TypeVar

from firmware_protocol.pmx import PMX_MAP, WriteRefusalCode
from firmware_protocol.pmx_alarms import describe_refusal
from firmware_protocol.registers import RegisterError
from lmctl.config.machine import FeederSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.feeder_link import FeederLink
from lmctl.machine.feeder.status import FeederStatus
from lmctl.machine.modbus.client import FAILURE, ModbusExceptionError, NoReplyError

T = TypeVar("T")

REFUSED_HINT = "see the feeder's own display; clear what it complains of"
_LAST_REFUSAL = PMX_MAP.wire_address("LAST_REFUSAL")


class FeederErrors:
    """Errors of one feeder, from its own words where it gives any."""

    def __init__(self, feeder: FeederSettings, link: FeederLink) -> None:
        self._name = feeder.name
        self._place = f"{feeder.endpoint}, device {feeder.device_id}"
        self._link = link

    def error(self, reason: str, hint: str) -> MachineError:
        """A MachineError about this feeder."""
        return MachineError(f"feeder {self._name}: {reason}", where=self._place, hint=hint)

    def status_timeout_error(
        self, failure: str, waited_s: float, status: FeederStatus | None,
        error: MachineError | None = None,
    ) -> MachineError:
        """The expected status did not come in time. error : of the order that should cause it"""
        state = "unknown" if status is None else status.state.name
        why, hint = ("", "") if error is None else (f": {error.what}", error.hint)
        return self.error(f"{failure} within {waited_s:.0f} s{why}",
                          hint or f"its state is {state}: see its display")

    async def request_answer(self, request: Awaitable[T], what: str) -> T:
        """The request's answer, or a MachineError that names the feeder and what was wanted."""
        try:
            return await request
        except NoReplyError as error:
            raise self.error(error.what, error.hint) from error
        except RegisterError as error:
            raise self.error(f"its answer makes no sense: {error}", "is it a PMX?") from error
        except ModbusExceptionError as error:
            reason = await self.refusal_reason(error)
            raise self.error(f"it refuses to {what}: {reason}", REFUSED_HINT) from error

    async def refusal_reason(self, refused: ModbusExceptionError) -> str:
        """Why the feeder refused, in its own words where it gives any."""
        if refused.code == FAILURE:
            try:
                given = (await self._link.read_input(_LAST_REFUSAL, 1))[0]
                if given != WriteRefusalCode.NONE:
                    return describe_refusal(given)
            except MachineError:
                pass  # then the bare code has to do
        return refused.what
