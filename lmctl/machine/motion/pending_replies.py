"""Replies the host is still waiting for: a command's answer, the next report, a restart.

Each wait begins before its query is sent, since sending may already find the link lost. It ends
with the reply, at its deadline, or with the reason why no reply will come. The connection reports
what arrives, in the order of the byte stream.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

from firmware_protocol.status import StatusReport
from lmctl.errors import MachineError

T = TypeVar("T")


class PendingReplies:
    """The pending replies of one connection.

    error : makes the exception from a reason and a hint
    command : the command still unanswered, or None; one at a time
    reports : waits for the next report
    """

    def __init__(self, error: Callable[[str, str], MachineError]) -> None:
        self.command: asyncio.Future[list[str]] | None = None
        self.reports: list[asyncio.Future[StatusReport]] = []
        self._restart: asyncio.Future[None] | None = None
        self._text = ""
        self._said: list[str] = []
        self._error = error
        self._loop = asyncio.get_running_loop()

    # --- those who wait -----------------------------------------------------------------------

    async def command_reply(self, line: str, ask: Callable[[], None],
                            timeout_s: float) -> list[str]:
        """The messages before a command's `ok`; `ask` sends it. Raises MachineError."""
        self._text, self._said = line, []
        self.command = self._loop.create_future()
        try:
            ask()
            return await _within(timeout_s, self.command)
        except TimeoutError:
            raise self._error(
                f"no answer to {line!r} within {timeout_s:g} s",
                "check what the controller is doing (`lmctl machine status`), or reset it",
            ) from None
        finally:
            self.command = None

    async def next_report(self, ask: Callable[[], None], timeout_s: float) -> StatusReport | None:
        """The next report; None if none comes in time."""
        waiter: asyncio.Future[StatusReport] = self._loop.create_future()
        self.reports.append(waiter)
        try:
            ask()
            return await _within(timeout_s, waiter)
        except TimeoutError:
            return None
        finally:
            self.reports.remove(waiter)

    async def wait_for_restart(self, ask: Callable[[], None], timeout_s: float) -> None:
        """Return when the controller has restarted. Raises MachineError."""
        waiter = self._restart = self._loop.create_future()
        try:
            ask()
            await _within(timeout_s, waiter)
        except TimeoutError:
            raise self._error(
                f"no restart within {timeout_s:g} s of a reset",
                "switch the machine off at its emergency stop, then look at the controller",
            ) from None
        finally:
            self._restart = None

    # --- what comes ---------------------------------------------------------------------------

    def on_message(self, text: str) -> None:
        """A message that is no answer: a command's `ok` follows."""
        self._said.append(text)

    def on_ok(self) -> None:
        """The command was answered `ok`."""
        _resolve(self.command, self._said)

    def on_refused(self, why: str, hint: str, how: str = "was refused") -> None:
        """There will be no `ok` for the command, if there is one."""
        if self.command is not None and not self.command.done():
            self.command.set_exception(self._error(f"{self._text!r} {how}: {why}", hint))

    def on_report(self, report: StatusReport) -> None:
        """A report has come."""
        for waiter in self.reports:
            _resolve(waiter, report)

    def on_restart(self) -> None:
        """The controller has restarted."""
        _resolve(self._restart, None)

    def on_lost(self, error: MachineError) -> None:
        """Nothing will come any more."""
        for waiter in (self.command, self._restart, *self.reports):
            if waiter is not None and not waiter.done():
                waiter.set_exception(error)


async def _within(timeout_s: float, waiter: asyncio.Future[T]) -> T:
    async with asyncio.timeout(timeout_s):
        return await waiter


def _resolve(waiter: asyncio.Future[T] | None, result: T) -> None:
    if waiter is not None and not waiter.done():
        waiter.set_result(result)
