"""The catch scale: opened, tared and read; every reading carries the time it was weighed."""

from __future__ import annotations

import asyncio
from typing import Any

from firmware_protocol.catch_scale import (
    CSC_MAP,
    DEVICE_ID,
    FULL_BLOCK,
    MAP_MAJOR,
    TARE_KEY,
    mirror_address_of,
)
from firmware_protocol.registers import RegisterError, WordOrder
from lmctl.config.measuring import ScaleSettings
from lmctl.errors import MachineError
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.modbus.opening_retries import answer_with_retries
from lmctl.machine.modbus.word_order import address_base_hint, detect_word_order
from lmctl.machine.scale.reading import ScaleReader, ScaleReading

_TIMEOUT_S = 1.0
_BUSY_PAUSE_S = 0.2
_TARE_PATIENCE_S = 20.0
#: Readings that may be lost in a row before the scale is given up.
_LOST_READINGS = 5

_TARE = CSC_MAP.wire_address("TARE")
_UPTIME = CSC_MAP.contiguous_block(["UPTIME"])


class CatchScaleDriver:
    """One scale, opened by `open`.

    resolution_g, capacity_g : as it states them
    """

    def __init__(
        self, link: ModbusLink, settings: ScaleSettings, resolution_g: float, capacity_g: float
    ) -> None:
        self.resolution_g = resolution_g
        self.capacity_g = capacity_g
        self.period_s = settings.period_s
        self._settings = settings
        self._link = link
        self._reader = ScaleReader(WordOrder(settings.word_order))
        self._loop = asyncio.get_running_loop()
        self._lost = 0

    @classmethod
    async def open(cls, settings: ScaleSettings) -> CatchScaleDriver:
        """Connect and see what it is.

        Raises MachineError where it cannot be reached, is something else, or sends its words in
        another order; ConfigError for a bad endpoint.
        """
        try:
            link = await ModbusLink.open(settings, timeout_s=_TIMEOUT_S, mirror=mirror_address_of)
        except MachineError as error:
            raise MachineError(f"catch scale: {error.what}", where=error.where,
                               hint=error.hint) from error
        try:
            return await _identified(link, settings)
        except (NoReplyError, ModbusExceptionError) as error:
            await link.close()
            raise MachineError(f"catch scale: {error.what}", where=_place(settings),
                               hint=error.hint) from error
        except BaseException:
            await link.close()
            raise

    async def read(self) -> ScaleReading | None:
        """One reading; None where an answer was lost.

        Raises MachineError where several answers in a row are lost, the scale refuses, or says
        that it is not well.
        """
        asked_s = self._loop.time()
        try:
            words = await self._link.read_input(self._reader.address, self._reader.count)
            reading = self._reader.decode(words, asked_s, self._loop.time())
        except (NoReplyError, RegisterError) as error:
            self._lost += 1
            if self._lost < _LOST_READINGS:
                return None
            raise self.error(f"it gives no readings: {error}", "check its cable and supply"
                             ) from error
        except ModbusExceptionError as error:
            raise self.error(error.what, error.hint) from error
        self._lost = 0
        if not reading.is_healthy:
            raise self.error("its self-test failed", "see its own display")
        return reading

    async def tare(self) -> ScaleReading:
        """Wait until the display stands still, and make it zero; returns a reading after that.

        Raises MachineError where it does not come to rest, or does not tare.
        """
        before = await self._when_stable("before the tare")
        try:
            await self._link.write(_TARE, [TARE_KEY])
        except (NoReplyError, ModbusExceptionError) as error:
            raise self.error(f"it does not tare: {error.what}", error.hint) from error
        after = await self._when_stable("after the tare")
        if after.tare_count == before.tare_count or after.mass_g is None or (
            abs(after.mass_g) > 3 * self.resolution_g
        ):
            raise self.error(
                f"it was commanded to tare and shows {after.mass_g} g",
                "tare it at its own display, or take off what lies on it; then test again")
        return after

    async def _when_stable(self, when: str) -> ScaleReading:
        deadline_s = self._loop.time() + _TARE_PATIENCE_S
        while True:
            reading = await self.read()
            if reading is not None and reading.is_overloaded:
                raise self.error("it is overloaded", "empty its pan")
            if reading is not None and reading.is_stable and reading.mass_g is not None:
                return reading
            if self._loop.time() >= deadline_s:
                raise self.error(f"its display does not come to rest {when}",
                                 "shield it from draught and vibration, and wait until no powder "
                                 "falls")
            await asyncio.sleep(self.period_s)

    def error(self, what: str, hint: str) -> MachineError:
        """A MachineError about this scale."""
        return MachineError(f"catch scale: {what}", where=_place(self._settings), hint=hint)

    async def close(self) -> None:
        """Disconnect; the scale is left as it is."""
        await self._link.close()


def _place(settings: ScaleSettings) -> str:
    return f"{settings.endpoint}, device {settings.device_id}"


async def _identified(link: ModbusLink, settings: ScaleSettings) -> CatchScaleDriver:
    order = WordOrder(settings.word_order)
    words = await answer_with_retries(
        lambda: link.read_input(FULL_BLOCK.address, FULL_BLOCK.count), _BUSY_PAUSE_S)
    values: dict[str, Any] = FULL_BLOCK.with_word_order(order).decode(words)
    if values["DEVICE_ID"] != DEVICE_ID:
        raise MachineError(
            "the device for the catch scale is no CSC scale",
            where=[_place(settings), f"its DEVICE_ID is {values['DEVICE_ID']}, not {DEVICE_ID}"],
            hint=address_base_hint(words, DEVICE_ID, settings)
            or "check endpoint and device_id of [scale] in the machine profile",
        )
    major, minor = divmod(values["MAP_VERSION"], 256)
    if major != MAP_MAJOR:
        raise MachineError(
            "the catch scale speaks another register map",
            where=[_place(settings), f"map {major}.{minor}; map {MAP_MAJOR} is known here"],
            hint="it needs another version of lmctl, or other firmware",
        )
    counted = await detect_word_order(link, _UPTIME, order)
    if counted not in (None, order):
        raise MachineError(
            "the catch scale sends its 32-bit values in another word order",
            where=[_place(settings),
                   f"its uptime counts as {counted.value}, and {order.value} is expected"],
            hint=f'write word_order = "{counted.value}" into [scale] of the machine profile',
        )
    return CatchScaleDriver(link, settings, values["RESOLUTION"] / 1000.0, values["CAPACITY"])
