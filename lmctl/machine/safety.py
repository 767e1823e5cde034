"""The safety-input device: facts about the cell's safety circuits, each with its age.

Every period one request (FC 23) writes the heartbeat, which keeps the watchdog relay closed, and
reads all inputs back. What the facts mean for a run is decided elsewhere.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from firmware_protocol.safety_io import CYCLE_BLOCK, MIRROR, RELAY_RESET_KEY, SIO
from lmctl.config.machine import Safety
from lmctl.errors import MachineError
from lmctl.machine.beat import on_beat
from lmctl.machine.modbus import ModbusLink, NoAnswerError, RefusedError
from lmctl.machine.safety_identity import SafetyIdentity, check_line, identify, place
from lmctl.machine.safety_status import SafetyListener, SafetyStatus, safety_status

#: Periods without a good answer before the device is given up.
_SILENT_PERIODS = 3
#: A device on a network may take this long to answer, however short the period [s].
_LEAST_PATIENCE_S = 0.05
_RESET_PATIENCE_S = 1.0
_ROUNDING_S = 1e-6

_HEARTBEAT = SIO.wire_address("HEARTBEAT")
_RELAY_RESET = SIO.wire_address("RELAY_RESET")

#: Words of the cycle block that are bits of good things: INPUTS and STATUS.
_BIT_WORDS = 2


class SafetyDriver:
    """One safety-input device.

    An answer is *good* when it echoes the heartbeat just written and its time stamp has moved:
    one that is frozen, or comes from some buffer on the way, is no answer. Such an answer may
    still make things worse (an input it shows open is open in `status`), never better.
    """

    def __init__(self, link: ModbusLink, safety: Safety, identity: SafetyIdentity) -> None:
        self.identity = identity
        self.listener = SafetyListener()
        self.status: SafetyStatus | None = None
        self.fault: MachineError | None = None
        self._safety = safety
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._control = (
            [] if safety.relay_timeout_s is None else [round(safety.relay_timeout_s * 1000)]
        )
        self._heartbeat = 0
        self._words: Sequence[int] = ()  # of the last status
        self._good: SafetyStatus | None = None  # the last good answer
        self._why = ("no answer", "check its power and cable")
        self._waiting: list[asyncio.Future[None]] = []
        self._task: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None

    @classmethod
    async def open(cls, safety: Safety) -> SafetyDriver:
        """Connect, see what it is, and begin its heartbeat; returns with a first status.

        An open relay stays open: see `reset_relay`.
        Raises MachineError where it cannot be reached, is something else, or gives no good
        answer; ConfigError for a bad endpoint, or a line too slow for the period.
        """
        check_line(safety)
        timeout_s = max(safety.period_s, _LEAST_PATIENCE_S)
        try:
            link = await ModbusLink.open(safety.endpoint, safety.device_id, timeout_s=timeout_s)
        except MachineError as error:
            raise MachineError(
                f"safety device: {error.what}", where=error.where, hint=error.hint
            ) from error
        try:
            driver = cls(link, safety, await identify(link, safety))
            await driver._turn()
            if driver._good is None:
                raise driver._error(*driver._why)
        except BaseException:
            await link.close()
            raise
        driver._start()
        return driver

    @property
    def status_age_s(self) -> float:
        """Time since the last good answer; infinite before the first."""
        return self._loop.time() - self._good.time_s if self._good else float("inf")

    async def reset_relay(self) -> None:
        """Close an open watchdog relay and forget the first-out code, as an operator's act.

        Returns when the device shows it. An input that is still open becomes the first-out again.
        Raises MachineError where it refuses, or the relay does not close.
        """
        try:
            await self._link.write(_RELAY_RESET, [RELAY_RESET_KEY])
        except (NoAnswerError, RefusedError) as error:
            raise self._error(f"it does not reset its relay: {error.what}", error.hint) from error
        wanted_s = self._loop.time()
        await self._until(
            lambda good: good.time_s >= wanted_s and good.relay_closed is not False,
            _RESET_PATIENCE_S + _SILENT_PERIODS * self._safety.period_s,
            "its watchdog relay does not close", "check the relay and its supply",
        )

    async def close(self) -> None:
        """End the heartbeat and disconnect; a watchdog relay opens by itself in its time."""
        if self._timer is not None:
            self._timer.cancel()
        try:
            if self._task is not None:
                self._task.cancel()
                await asyncio.gather(self._task, return_exceptions=True)
        finally:
            await self._link.close()

    def _start(self) -> None:
        self._task = asyncio.create_task(self._run(), name="safety device")
        self._task.add_done_callback(self._ended)
        self._watch()

    async def _run(self) -> None:
        period_s, started_s = self._safety.period_s, self._loop.time()
        while True:
            due_s = on_beat(started_s + period_s, started_s)
            await asyncio.sleep(due_s - self._loop.time())
            started_s = self._loop.time()
            await self._turn()

    async def _turn(self) -> None:
        """One heartbeat and what comes back."""
        self._heartbeat = self._heartbeat % 0xFFFF + 1  # never 0, which a dead device would echo
        try:
            words = await self._link.exchange(
                _HEARTBEAT, [self._heartbeat, *self._control],
                MIRROR + CYCLE_BLOCK.address, CYCLE_BLOCK.count,
            )
        except NoAnswerError:
            self._why = ("no answer", "check its power and cable")
        except RefusedError as error:
            self._why = (f"it refuses to answer: {error.what}", "see the device's manual")
        else:
            self._answered(words)

    def _answered(self, words: Sequence[int]) -> None:
        status, last = self._read(words), self._good
        if status.heartbeat_echo != self._heartbeat:
            self._why = (
                "it does not repeat the heartbeat", "restart it, and any gateway before it"
            )
            self._worse(words)
        elif last is not None and status.tick_ms == last.tick_ms:
            self._why = (
                "it answers, but with the same data", "restart it, and any gateway before it"
            )
            self._worse(words)
        else:
            self._words, self.status, self._good, self.fault = words, status, status, None
            self.listener.on_status(status)
            if last is not None and status.uptime_s < last.uptime_s:
                self._tell("the device restarted", "check its power supply")
            self._tell_waiting()

    def _worse(self, words: Sequence[int]) -> None:
        """Take from an answer that proves nothing only what has opened."""
        known = self._words
        if not known:
            return
        bits = [old & new for old, new in zip(known, words[:_BIT_WORDS], strict=False)]
        merged = (*bits, *known[_BIT_WORDS:])
        if merged != tuple(known):
            self._words, self.status = merged, self._read(merged)
            self.listener.on_status(self.status)

    def _read(self, words: Sequence[int]) -> SafetyStatus:
        return safety_status(
            words, self._loop.time(), self._safety.fitted,
            has_relay=self._safety.relay_timeout_s is not None,
        )

    def _watch(self) -> None:
        """Give the device up when its last good answer is too old; look again until it is."""
        limit_s = _SILENT_PERIODS * self._safety.period_s
        age_s = self.status_age_s
        if age_s >= limit_s - _ROUNDING_S:
            if self.fault is None:
                reason, hint = self._why
                self.fault = self._error(f"{reason} for {age_s:.1f} s", hint)
                self._tell(f"{reason} for {age_s:.1f} s", hint)
            age_s = limit_s - self._safety.period_s
        self._timer = self._loop.call_later(limit_s - age_s, self._watch)

    def _tell(self, reason: str, hint: str) -> None:
        self.listener.on_fault(reason, hint)

    async def _until(
        self, condition: Callable[[SafetyStatus], bool], timeout_s: float, failure: str, hint: str
    ) -> None:
        """Wait for a good answer as wanted. Raises MachineError after timeout_s."""
        try:
            async with asyncio.timeout(timeout_s):
                while self._good is None or not condition(self._good):
                    news = self._loop.create_future()
                    self._waiting.append(news)
                    await news
        except TimeoutError:
            raise self._error(f"{failure} within {timeout_s:.1f} s", hint) from None

    def _tell_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for news in waiting:
            if not news.done():
                news.set_result(None)

    def _error(self, reason: str, hint: str) -> MachineError:
        return MachineError(f"safety device: {reason}", where=place(self._safety), hint=hint)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A task that dies of a bug leaves no run without its facts unnoticed."""
        if not task.cancelled() and task.exception() is not None:
            self._why = ("its driver failed", "this is a bug: please report it")
