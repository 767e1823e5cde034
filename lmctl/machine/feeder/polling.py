"""The one task that talks to a feeder: heartbeat, recipes, status, and a watch on the answers.

Every quarter of the device's watchdog it writes the heartbeat (with the recipe, where flows have
changed) and reads the status, in one request where the map allows. Changed flows do not wait for
their turn.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

from firmware_protocol.pmx import (
    MIRROR_ADDRESS,
    PMX_MAP,
    SYSTEM_BLOCK,
    FeederCommandBits,
    FeederMode,
)
from firmware_protocol.registers import RegisterError, WordOrder
from lmctl.config.machine import FeederSettings, HopperSettings
from lmctl.errors import MachineError
from lmctl.machine.feeder.fault_detection import FeederFault, FeederMonitor
from lmctl.machine.feeder.feeder_errors import REFUSED_HINT, FeederErrors
from lmctl.machine.feeder.feeder_link import FeederLink
from lmctl.machine.feeder.identity import FeederIdentity
from lmctl.machine.feeder.readings import HopperReader, HopperReading
from lmctl.machine.feeder.recipe import PreviousFlows, RecipeWriter
from lmctl.machine.feeder.status import (
    GAS_ORDERED_STATES,
    FeederCallbacks,
    FeederStatus,
    read_feeder_status,
)
from lmctl.machine.feeder.warnings import WarningReader
from lmctl.machine.modbus.client import ModbusExceptionError, NoReplyError
from lmctl.machine.timer_wheel import align_to_tick

#: Longest interval between status reads while a caller waits [s], however long the cycle is.
_IMPATIENT_S = 2.0

#: Hoppers are read once in this many cycles.
_HOPPER_CYCLES = 4

_COMMAND = PMX_MAP.wire_address("COMMAND")


class FeederPolling:
    """Talks over a link that is open, from `start` to `stop`.

    errors : in words, of this feeder
    status, fault, listener : as FeederDriver has them
    command : the last command to the device; an order that switches something off is repeated
        with each status that shows it has not worked
    watching : whether what is wrong is a fault; feeding : whether discs were asked to turn
    """

    def __init__(
        self, link: FeederLink, feeder: FeederSettings, hoppers: Sequence[HopperSettings],
        identity: FeederIdentity,
    ) -> None:
        self.listener = FeederCallbacks()
        self.status: FeederStatus | None = None
        self.fault: MachineError | None = None
        self.watching = self.feeding = False
        self.command = FeederCommandBits(0)
        self.period_s = feeder.watchdog_s / 4.0
        self.errors = FeederErrors(feeder, link)
        self._name = feeder.name
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._word_order = WordOrder(feeder.word_order)
        self._has_mirror = identity.has_mirror
        self._recipe = RecipeWriter(feeder, hoppers, identity.n_hoppers)
        self._watch = FeederMonitor(self.period_s)
        self._heartbeat = identity.heartbeat
        self._sequence = 0
        self._wanted = (0,) * len(hoppers)
        self._sent: tuple[int, ...] | None = None
        self._former = PreviousFlows([self._recipe.laws[h.name] for h in hoppers])
        self._flows_g_min: Mapping[str, float] = {h.name: 0.0 for h in hoppers}
        self._readers = {
            h.name: HopperReader(h, identity.feed_factor_g_rev[h.name], self._word_order,
                                 self._recipe.laws[h.name])
            for h in hoppers
        }
        self._readings: Mapping[str, HopperReading] = {}
        self._mirrored = max(reader.mirrored.stop for reader in self._readers.values())
        self._warnings = WarningReader(
            feeder.name, {h.channel: h.name for h in hoppers}, identity.n_hoppers,
            alarms=identity.alarms, substitutions=identity.substitutions,
        )
        self._due_s = self._status_due_s = self._hoppers_due_s = self._loop.time()
        self._news = self._ask_status = False
        self._wake_up: asyncio.Future[None] | None = None
        self._waiting: list[asyncio.Future[None]] = []
        self._task: asyncio.Task[None] | None = None

    @property
    def status_age_s(self) -> float:
        return self._loop.time() - self.status.time_s if self.status else float("inf")

    def set_flows(self, flows_g_min: Mapping[str, float]) -> None:
        wanted = self._recipe.flow_counts(flows_g_min)
        self._flows_g_min = dict(flows_g_min)
        if wanted != self._wanted:
            self._wanted = wanted
            self._end_sleep()

    def correct_slope(self, hopper: str, correction: float) -> None:
        self._recipe.laws[hopper].correction = correction
        self.set_flows(self._flows_g_min)

    async def read_first_status(self) -> FeederStatus:
        """A status without heartbeat; recipes are then numbered on from the one that runs."""
        words = await self._link.read_input(SYSTEM_BLOCK.address, SYSTEM_BLOCK.count)
        status = self._understood(words)
        self._sequence = status.seq_applied
        return status

    async def poll_once(self) -> None:
        """Heartbeat, recipe where it changed, and the status where it is due.

        That is one request; with a status, two on an old map. The next status shows whether the
        device has taken the recipe over.
        Raises NoReplyError, ModbusExceptionError; RegisterError for an answer without meaning.
        """
        self._news = False
        now_s = self._loop.time()
        # A recipe that goes out in the second half of a cycle is the next heartbeat and status too.
        with_status = self._ask_status or now_s >= self._status_due_s - self.period_s / 2.0
        if with_status:
            self._due_s = align_to_tick(now_s + self.period_s, now_s)
        else:
            self._due_s = self._status_due_s
        self._heartbeat = (self._heartbeat + 1) & 0xFFFF
        wanted = self._wanted
        if wanted == self._sent:
            words = [self._heartbeat]
        else:
            # A new number at every attempt: after a lost answer the device may hold either.
            self._sequence = self._sequence % 0xFFFF + 1
            if self._sent is not None:
                self._former.record_replaced(self._sent, now_s)
            words = self._recipe.recipe_words(
                wanted, sequence=self._sequence, heartbeat=self._heartbeat
            )
        if not with_status:
            await self._link.write(self._recipe.address, words)
            self._sent = wanted
            return
        self._ask_status, self._status_due_s = False, self._due_s
        hoppers_due = now_s >= self._hoppers_due_s
        if self._has_mirror:
            count = self._mirrored if hoppers_due else SYSTEM_BLOCK.count
            answer = await self._link.exchange(self._recipe.address, words, MIRROR_ADDRESS, count)
            if hoppers_due:
                self._on_words({n: answer[r.mirrored] for n, r in self._readers.items()})
        else:
            await self._link.write(self._recipe.address, words)
            answer = await self._link.read_input(SYSTEM_BLOCK.address, SYSTEM_BLOCK.count)
        self._sent = wanted
        self._answered(self._understood(answer[: SYSTEM_BLOCK.count]))
        if hoppers_due and not self._has_mirror:
            self._on_words({
                name: await self._link.read_input(reader.address, reader.count)
                for name, reader in self._readers.items()
            })

    def start(self) -> None:
        self._task = asyncio.create_task(self._run(), name=f"feeder {self._name}")
        self._task.add_done_callback(self._ended)

    async def stop(self) -> None:
        """Stop talking. Raises what the task died of, if it was a bug."""
        if self._task is not None:
            self._task.cancel()
            (ended,) = await asyncio.gather(self._task, return_exceptions=True)
            if isinstance(ended, Exception):
                raise ended

    def read_status_now(self) -> None:
        """Read the status at once, because a caller is waiting for it."""
        self._ask_status = True
        self._end_sleep()

    def request_hopper_readings(self) -> None:
        """Read the hoppers with the next status."""
        self._hoppers_due_s = self._loop.time()

    def reset_fault(self) -> None:
        """Clear the fault and the last command: the recipe goes out again."""
        self.watching = self.feeding = False
        self.fault = None
        self._watch = FeederMonitor(self.period_s)
        self._sent = None

    async def wait_until(
        self, condition: Callable[[FeederStatus], bool], timeout_s: float, failure: str, *,
        faulty: bool = False,
    ) -> None:
        """Wait for a status read from now on that meets the condition.

        failure : what to say after timeout_s; faulty : a fault does not end the waiting
        Raises MachineError.
        """
        if not await self.is_condition_met_within(condition, timeout_s, faulty=faulty):
            raise self.errors.status_timeout_error(failure, timeout_s, self.status)

    async def is_condition_met_within(
        self, condition: Callable[[FeederStatus], bool], timeout_s: float, *, faulty: bool = True
    ) -> bool:
        """Whether a status read from now on meets the condition before timeout_s has passed."""
        asked_s = self._loop.time()
        try:
            async with asyncio.timeout(timeout_s):
                while self.status is None or self.status.time_s < asked_s or (
                    not condition(self.status)
                ):
                    if self.fault is not None and not faulty:
                        raise self.fault
                    news = self._loop.create_future()
                    self._waiting.append(news)
                    timer = self._loop.call_later(_IMPATIENT_S, self.read_status_now)
                    try:
                        await news
                    finally:
                        timer.cancel()
        except TimeoutError:
            return False
        return True

    async def _run(self) -> None:
        while True:
            await self._pause()
            try:
                await self.poll_once()
                if self._does_more_than_ordered():
                    await self._link.write(_COMMAND, [int(self.command)])
            except (NoReplyError, RegisterError):
                pass  # the age of the last good answer shows it
            except ModbusExceptionError as error:
                await self._refused(error)
            if found := self._watch.silence_fault(self.status_age_s,
                                                      self._link.wire_observation):
                self._set_fault(found)

    async def _refused(self, error: ModbusExceptionError) -> None:
        """Read the status after a refusal: it gives the reason, since the device still answers."""
        reason = await self.errors.refusal_reason(error)
        with suppress(MachineError, RegisterError):
            self._answered(self._understood(
                await self._link.read_input(SYSTEM_BLOCK.address, SYSTEM_BLOCK.count)))
        self._set_fault(FeederFault(f"it refuses a request: {reason}", REFUSED_HINT))

    def _does_more_than_ordered(self) -> bool:
        """Whether it feeds, or gas flows, although commanded off: an order was lost."""
        status = self.status
        if status is None or status.mode is not FeederMode.REMOTE:
            return False
        return (status.feeding and FeederCommandBits.FEED_ON not in self.command) or (
            status.state in GAS_ORDERED_STATES and FeederCommandBits.GAS_ON not in self.command
        )

    async def _pause(self) -> None:
        """Wait until the next cycle, or until there is something new to send."""
        if self._news:
            return
        self._wake_up = self._loop.create_future()
        timer = self._loop.call_at(self._due_s, self._end_sleep)
        try:
            await self._wake_up
        finally:
            timer.cancel()

    def _end_sleep(self) -> None:
        self._news = True
        if self._wake_up is not None and not self._wake_up.done():
            self._wake_up.set_result(None)

    def _on_words(self, words: Mapping[str, Sequence[int]]) -> None:
        """Take the reading of each hopper, by its name."""
        now_s = self._loop.time()
        self._hoppers_due_s = now_s + _HOPPER_CYCLES * self.period_s
        self._readings = {
            name: reader.decode_reading(words[name], now_s,
                                        self._former.recent_setpoints_g_min(at, now_s))
            for at, (name, reader) in enumerate(self._readers.items())
        }

    def _understood(self, words: Sequence[int]) -> FeederStatus:
        """Raises RegisterError for words without meaning."""
        try:
            return read_feeder_status(
                words, self._loop.time(), self._readings, self._warnings, self._word_order)
        except ValueError as error:
            raise RegisterError(str(error)) from error

    def _answered(self, status: FeederStatus) -> None:
        self.status = status
        self.listener.on_status(status)
        found = self._watch.find_fault(status, sequence=self._sequence, feeding=self.feeding)
        if found is not None:
            self._set_fault(found)
        self._notify_waiting()

    def _set_fault(self, found: FeederFault) -> None:
        if not self.watching or self.fault is not None:
            return
        self.fault = self.errors.error(found.reason, found.hint)
        self.listener.on_fault(found.reason)
        self._notify_waiting()

    def _notify_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for news in waiting:
            if not news.done():
                news.set_result(None)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """A task that dies of a bug must not leave the run waiting for it."""
        if not task.cancelled() and task.exception() is not None:
            self.watching = True
            self._set_fault(FeederFault("its driver failed", "this is a bug: please report it"))
