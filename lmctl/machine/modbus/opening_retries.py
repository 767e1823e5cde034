"""Retries while a device is being opened: it may be starting up, and answers get lost."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from lmctl.errors import MachineError
from lmctl.machine.modbus.client import NoReplyError, PassingExceptionError

T = TypeVar("T")

#: Requests that may go without an answer, and how long a device may answer that it is busy [s].
_OPENING_TRIES = 3
_BUSY_PATIENCE_S = 15.0


class OpeningRetries:
    """How long a device that is being opened may stay without an answer: see `may_retry`.

    Lost answers are few where a device is alive; one that is starting up is busy for longer.
    """

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._until_s = self._loop.time() + _BUSY_PATIENCE_S
        self._tries = _OPENING_TRIES

    def may_retry(self, error: MachineError | None) -> bool:
        """Whether to ask again after an error; None : an answer that was not good."""
        if isinstance(error, PassingExceptionError):
            return self._loop.time() < self._until_s
        self._tries -= 1
        return self._tries > 0


async def answer_with_retries(request: Callable[[], Awaitable[T]], every_s: float) -> T:
    """The answer to a request that may be repeated, such as a reading, while a device is opened.

    Raises NoReplyError when no retry is left, ModbusExceptionError at once.
    """
    patience = OpeningRetries()
    while True:
        try:
            return await request()
        except NoReplyError as error:
            if not patience.may_retry(error):
                raise
            if isinstance(error, PassingExceptionError):
                await asyncio.sleep(every_s)
