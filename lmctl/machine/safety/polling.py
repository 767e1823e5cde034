"""The one task that talks to the safety-input device: heartbeats, answers, and their age.

Every period one request (FC 23) writes the heartbeat, which keeps the watchdog relay closed, and
reads all inputs back. A command to the laser-enable output does not wait for the next period: it
goes out straight after any request under way.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from firmware_protocol.safety_io import (
    ALL_INPUTS_OK,
    CYCLIC_BLOCK,
    MIRROR_ADDRESS,
    SIO_MAP,
    SafetyStatusBits,
    first_out_code_of_input,
)
from lmctl.config.machine import SafetySettings
from lmctl.errors import MachineError
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.modbus.opening_retries import OpeningRetries
from lmctl.machine.safety.identity import describe_device
from lmctl.machine.safety.laser_enable import CONTACT_SETTLE_S, LaserEnable
from lmctl.machine.safety.status import (
    INPUT_BITS,
    SafetyCallbacks,
    SafetyStatus,
    read_safety_status,
)
from lmctl.machine.timer_wheel import align_to_tick

#: Periods without a good answer before the device is given up.
SILENT_PERIODS = 3

_WITH_THE_RELAY = "it drops with the watchdog relay, which is open: see what opened that"
_ROUNDING_S = 1e-6
_DROP_PATIENCE_S = 0.5

_HEARTBEAT = SIO_MAP.wire_address("HEARTBEAT")

#: Words of the cycle block whose set bits mean "good": INPUTS and STATUS. LASER_ENABLED is not one
#: of them.
_BIT_WORDS = 2
_NEVER_WORSE = (0, SafetyStatusBits.LASER_ENABLED.value)

#: The bits, in the same two words, whose openings TRIP_COUNT counts; and where it restarts.
_COUNTED = (ALL_INPUTS_OK.value, SafetyStatusBits.RELAY_CLOSED.value)
_COUNTS = 65_536


class SafetyPolling:
    """Talks over a link that is open, from `start` to `stop`.

    status, fault, listener : as SafetyDriver has them
    laser : the laser-enable output, or None
    heartbeat : the last one the device has received; the first one of this host differs from it,
        since a device counts only a change as a heartbeat

    An answer is *good* when it echoes the heartbeat just written, its time stamp has moved and the
    device's self-test has passed. A frozen answer, or one from a buffer on the way, is not good.
    Such an answer can only make `status` worse, never better: an input that it shows open is open
    in `status`.
    """

    def __init__(self, link: ModbusLink, safety: SafetySettings, heartbeat: int) -> None:
        self.listener = SafetyCallbacks()
        self.status: SafetyStatus | None = None
        self.fault: MachineError | None = None
        self.laser = LaserEnable() if safety.laser_enable else None
        self._safety = safety
        self._unfitted = {
            first_out_code_of_input(bit) for name,
            bit in INPUT_BITS.items() if name not in safety.fitted
        }
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._control = (
            [] if safety.relay_timeout_s is None else [round(safety.relay_timeout_s * 1000)]
        )
        self._heartbeat = heartbeat
        self._words: Sequence[int] = ()  # of the last status
        self._good: SafetyStatus | None = None  # the last good answer
        self._good_words: Sequence[int] = ()  # and its words
        self._why = ("no answer", "check its power and cable")
        self._seen = ""  # on the wire, where there is no answer
        self._waiting: list[asyncio.Future[None]] = []
        self._task: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._rest: asyncio.Future[None] | None = None  # between two requests
        self._urgent = False  # the next request is not to wait for its period

    @property
    def now_s(self) -> float:
        """The current time on the clock of `time_s` in a status."""
        return self._loop.time()

    @property
    def status_age_s(self) -> float:
        """Time since the last good answer; infinite before the first."""
        return self._loop.time() - self._good.time_s if self._good else float("inf")

    async def read_first_status(self) -> None:
        """The first good answer. Raises MachineError where none comes."""
        patience = OpeningRetries()
        while True:
            error = await self._turn()
            if self._good is not None:
                return
            if not patience.may_retry(error):
                reason, hint = self._why
                raise self.device_error(f"{reason}{self._seen}", hint)
            await asyncio.sleep(self._safety.period_s)

    def start(self) -> None:
        self._task = asyncio.create_task(self._run(), name="safety device")
        self._task.add_done_callback(self._ended)
        self._watch()

    async def stop(self) -> None:
        """Stop polling; first command the output off until it reads back as off."""
        if self._timer is not None:
            self._timer.cancel()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        laser, until_s = self.laser, self._loop.time() + _DROP_PATIENCE_S
        if laser is None:
            return
        laser.request(False)
        while not laser.is_confirmed(False) and laser.fault is None and self._loop.time() < until_s:
            await self._turn()
            if not laser.is_confirmed(False):
                await asyncio.sleep(CONTACT_SETTLE_S)

    def send_now(self) -> None:
        """Send the next request without waiting for its period."""
        self._urgent = True
        if self._rest is not None:
            _end_sleep(self._rest)

    async def _run(self) -> None:
        period_s, started_s = self._safety.period_s, self._loop.time()
        while True:
            due_s = align_to_tick(started_s + period_s, started_s)
            if self.laser is not None and self.laser.is_pending:
                due_s = min(due_s, started_s + CONTACT_SETTLE_S)
            if not self._urgent:
                await self._until_due(due_s)
            self._urgent = False
            started_s = self._loop.time()
            await self._turn()

    async def _until_due(self, due_s: float) -> None:
        """Wait until due_s, or until an urgent request."""
        self._rest = self._loop.create_future()
        timer = self._loop.call_at(due_s, _end_sleep, self._rest)
        try:
            await self._rest
        finally:
            timer.cancel()

    async def _turn(self) -> MachineError | None:
        """Send one heartbeat and read the answer; returns the error where there is none."""
        self._heartbeat = self._heartbeat % 0xFFFF + 1  # never 0, which a dead device would echo
        try:
            words = await self._link.exchange(
                _HEARTBEAT, self._written(),
                MIRROR_ADDRESS + CYCLIC_BLOCK.address, CYCLIC_BLOCK.count,
            )
        except NoReplyError as error:
            self._why = ("no answer", self._link.wire_observation.hint)
            self._seen = f": {self._link.wire_observation.description}"
            return error
        except ModbusExceptionError as error:
            self._why, self._seen = (
                (f"it refuses to answer: {error.what}", "see the device's manual"), "")
            return error
        self._seen = ""
        self._answered(words)
        return None

    def _written(self) -> list[int]:
        """From HEARTBEAT on; a RELAY_RESET of 0 does nothing."""
        if self.laser is None:
            return [self._heartbeat, *self._control]
        return [self._heartbeat, *self._control, 0, self.laser.output_word()]

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
        elif not status.self_test_ok:
            self._why = ("its self-test failed", "see the device's own display")
            self._worse(words)
        else:
            before, self._good_words = self._good_words, words
            self._words, self.status, self._good, self.fault = words, status, status, None
            self.listener.on_status(status)
            if last is not None and status.uptime_s < last.uptime_s:
                self._set_fault("the device restarted", "check its power supply")
                if self.laser is not None:
                    self.laser.on_restart()
            elif last is not None:
                self._look_for_missed(last, before, status, words)
            if self.laser is not None:
                self._look_at_output(self.laser, status)
            self._notify_waiting()

    def _look_for_missed(
        self, last: SafetyStatus, before: Sequence[int], status: SafetyStatus, words: Sequence[int]
    ) -> None:
        """Report inputs that opened and closed again since the last good answer.

        The device only counts them, and names the one that opened first since the last reset.
        """
        opened = (status.trip_count - last.trip_count) % _COUNTS
        seen = sum(
            (old & ~new & mask).bit_count()
            for old, new, mask in zip(before, words, _COUNTED, strict=False)
        )
        first = status.first_out
        if opened > seen and (first is None or first.code not in self._unfitted):
            self._set_fault(
                "something opened and closed again between two answers"
                + ("" if first is None else f"; what opened first: {first.text}"),
                "look at the cell and its wiring; then resume" if first is None else first.remedy,
            )

    def _look_at_output(self, laser: LaserEnable, status: SafetyStatus) -> None:
        fault = laser.on_read_back(status.laser_enabled is True, status.time_s)
        if fault is not None:
            dropped = status.relay_closed is False
            self._set_fault(fault.reason, _WITH_THE_RELAY if dropped else fault.hint)
        if laser.has_unsent_change:
            self._urgent = True

    def _worse(self, words: Sequence[int]) -> None:
        """Take only newly opened inputs from an answer that is not good."""
        known = self._words
        if not known:
            return
        bits = [
            old & (new | kept)
            for old, new, kept in zip(known, words[:_BIT_WORDS], _NEVER_WORSE, strict=False)
        ]
        merged = (*bits, *known[_BIT_WORDS:])
        if merged != tuple(known):
            self._words, self.status = merged, self._read(merged)
            self.listener.on_status(self.status)

    def _read(self, words: Sequence[int]) -> SafetyStatus:
        return read_safety_status(words, self._loop.time(), self._safety)

    def _watch(self) -> None:
        """Give the device up when its last good answer is too old; check again until then."""
        limit_s = SILENT_PERIODS * self._safety.period_s
        age_s = self.status_age_s
        if age_s >= limit_s - _ROUNDING_S:
            if self.fault is None:
                reason, hint = self._why
                what = f"{reason} for {age_s:.1f} s{self._seen}"
                self.fault = self.device_error(what, hint)
                self._set_fault(what, hint)
            age_s = limit_s - self._safety.period_s
        self._timer = self._loop.call_later(limit_s - age_s, self._watch)

    def _set_fault(self, reason: str, hint: str) -> None:
        self.listener.on_fault(reason, hint)

    async def wait_until(
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
            raise self.device_error(f"{failure} within {timeout_s:.1f} s", hint) from None

    def _notify_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        for news in waiting:
            if not news.done():
                news.set_result(None)

    def device_error(self, reason: str, hint: str) -> MachineError:
        """A MachineError about this device."""
        return MachineError(f"safety device: {reason}", where=describe_device(self._safety),
                            hint=hint)

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Report a task that ended with a bug, so that no run goes on without safety status."""
        if not task.cancelled() and task.exception() is not None:
            self._why = ("its driver failed", "this is a bug: please report it")


def _end_sleep(rest: asyncio.Future[None]) -> None:
    if not rest.done():
        rest.set_result(None)
