"""The SIO device: inputs, watchdog relay, laser-enable output, and operator and fault actions.

Nothing runs between requests. `advance_to_now` opens the relay at its exact due time, whenever the
next request comes. The wiring checks the relay at `next_due_s`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from firmware_protocol.registers import RegisterValue
from firmware_protocol.safety_io import (
    DEVICE_ID,
    FULL_BLOCK,
    GREATEST_TIMEOUT_MS,
    LEAST_TIMEOUT_MS,
    MAP_MAJOR,
    MAP_MINOR,
    MIRROR_ADDRESS,
    RELAY_FIRST_OUT_CODE,
    RELAY_RESET_KEY,
    SIO_MAP,
    SafetyInputBits,
    SafetyStatusBits,
)
from simulators.modbus_errors import (
    BUSY,
    ILLEGAL_ADDRESS,
    ILLEGAL_VALUE,
    REFUSED,
    ExceptionReplyError,
    RequestIgnoredError,
)
from simulators.safety.config import SafetyConfig
from simulators.safety.inputs import InputCard
from simulators.safety.laser_output import LaserEnableOutput

_FIRMWARE = 0x0100
_SERIAL = 1
_MAX_AGE_MS = 0xFFFF
_DEFAULT_TIMEOUT_MS = 500
_SLACK_S = 1e-9  # a timer may come early by the clock's resolution

_HEARTBEAT, _RELAY_TIMEOUT, _RELAY_RESET, _LASER_ENABLE = (
    SIO_MAP.wire_address(name)
    for name in ("HEARTBEAT", "RELAY_TIMEOUT", "RELAY_RESET", "LASER_ENABLE")
)
#: Words the communication side still updates while the input side is frozen.
_ALIVE = [SIO_MAP.wire_address(name) for name in ("HEARTBEAT_ECHO", "HEARTBEAT_AGE")]


class SimulatedSafetyDevice:
    """One device. now : the simulation's clock.

    on_change : called whenever door, e-stop chain, relay or output may have changed, or
        `next_due_s` has
    relay_opened_s : when the relay opened by itself, oldest first
    """

    def __init__(self, config: SafetyConfig, now: Callable[[], float]) -> None:
        self.config = config
        self._block = FULL_BLOCK.with_word_order(config.word_order)
        self.now = now
        self.card = InputCard(config)
        self._output = LaserEnableOutput()
        self.on_change: Callable[[], None] = _no_listener
        self.relay_opened_s: list[float] = []
        self._frozen: list[int] | None = None
        self._silent = False
        self._exception: int | None = None
        self._power_up()

    def _power_up(self) -> None:
        self._powered_s = self.now()
        self._control = [0, _DEFAULT_TIMEOUT_MS, 0, *[0] * self.config.laser_enable]
        self._output.power_cycle()
        self._heartbeat_s = -math.inf
        self.relay_closed = False
        self.card.power_cycle()

    @property
    def device_id(self) -> int:
        return self.config.device_id

    # --- what is wired to other devices

    @property
    def is_estop_open(self) -> bool:
        return SafetyInputBits.ESTOP_CLOSED not in self.card.good

    @property
    def is_door_open(self) -> bool:
        return SafetyInputBits.DOOR_CLOSED not in self.card.good

    @property
    def is_relay_open(self) -> bool:
        """Whether a relay is fitted and open."""
        return self.config.watchdog_relay and not self.relay_closed

    @property
    def is_laser_enable_off(self) -> bool:
        """Whether a laser-enable output is fitted and off."""
        return self.config.laser_enable and not self._output.is_on

    def next_due_s(self) -> float:
        """Return when the relay opens by itself without a further write; inf for never."""
        if not self.relay_closed:
            return math.inf
        return self._heartbeat_s + self._control[_RELAY_TIMEOUT] / 1000.0

    def advance_to_now(self) -> float:
        """Carry out what is due until now; returns now."""
        now_s = self.now()
        if (due_s := self.next_due_s()) <= now_s + _SLACK_S:
            self.relay_closed = False
            self._output.drop()
            self.relay_opened_s.append(due_s)
            self.card.record_first_out(RELAY_FIRST_OUT_CODE)
            self.on_change()
        return now_s

    # --- operator and fault actions

    def set_input(self, one: SafetyInputBits, good: bool) -> None:
        """Open or close any input."""
        self.advance_to_now()
        self.card.set_input(one, good)
        self.on_change()

    def set_door_open(self, is_open: bool = True) -> None:
        self.set_input(SafetyInputBits.DOOR_CLOSED, not is_open)

    def set_estop_open(self, is_open: bool = True) -> None:
        self.set_input(SafetyInputBits.ESTOP_CLOSED, not is_open)

    def set_analyser_invalid(self, invalid: bool = True) -> None:
        self.set_input(SafetyInputBits.OXYGEN_VALID, not invalid)

    def set_shield_gas(self, flow_L_min: float | None) -> None:
        """None: "not available". Below 5 L/min its own switch opens too."""
        self._set_values(SHIELD_GAS=flow_L_min)

    def set_chiller(self, temperature_C: float | None, flow_L_min: float | None) -> None:
        """Outside 5 to 35 °C, or below 4 L/min, its own switch opens too."""
        self._set_values(CHILLER_TEMP=temperature_C, CHILLER_FLOW=flow_L_min)

    def set_oxygen(self, ppm: float | None) -> None:
        self._set_values(OXYGEN=ppm)

    def set_extraction(self, pressure_Pa: int | None) -> None:
        """Outside 200 to 2000 Pa its own switch opens too."""
        self._set_values(EXTRACTION_DP=pressure_Pa)

    def set_output_stuck(self, stuck: bool = True) -> None:
        """Hold the laser-enable output in its state regardless of commands, or release it."""
        self.advance_to_now()
        self._output.set_stuck(stuck)
        self.on_change()

    def weld_output(self) -> None:
        """The laser-enable contact closes and stays so; `set_output_stuck(False)` frees it."""
        self.advance_to_now()
        self._output.weld_closed()
        self.on_change()

    def drop_output(self) -> None:
        """The laser-enable output drops by itself."""
        self.advance_to_now()
        self._output.drop()
        self.on_change()

    def set_frozen(self, frozen: bool = True) -> None:
        """Freeze the input side and TICK; heartbeats are still echoed."""
        self._frozen = self._fresh_words() if frozen else None

    def set_silent(self, silent: bool = True) -> None:
        """The device neither receives nor answers."""
        self._silent = silent

    def reply_with_exception(self, code: int | None) -> None:
        """Answer every request with this Modbus exception and execute none; None ends this."""
        self._exception = code

    def restart(self) -> None:
        """Switch power off and on: the relay opens, volatile state is lost."""
        self.advance_to_now()
        self._power_up()
        self.on_change()

    def _set_values(self, **values: RegisterValue) -> None:
        self.advance_to_now()
        self.card.set_values(values)
        self.on_change()

    # --- requests

    def read_input(self, address: int, count: int) -> list[int]:
        self._meet()
        words = self._words()
        if address + count > len(words):
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        return words[address : address + count]

    def read_holding(self, address: int, count: int) -> list[int]:
        if address >= MIRROR_ADDRESS:
            return self.read_input(address - MIRROR_ADDRESS, count)
        self._meet()
        if address + count > len(self._control):
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        return self._control[address : address + count]

    def write(self, address: int, words: Sequence[int]) -> None:
        """All of them, or none."""
        time_s = self._meet()
        if time_s < self._powered_s + self.config.boot_s:
            raise ExceptionReplyError(BUSY)
        new = dict(enumerate(words, address))
        if not new.keys() <= set(range(len(self._control))):
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        if not LEAST_TIMEOUT_MS <= new.get(_RELAY_TIMEOUT, LEAST_TIMEOUT_MS) <= GREATEST_TIMEOUT_MS:
            raise ExceptionReplyError(ILLEGAL_VALUE)
        if new.get(_LASER_ENABLE, 0) > 1:
            raise ExceptionReplyError(ILLEGAL_VALUE)
        reset = new.pop(_RELAY_RESET, 0) == RELAY_RESET_KEY
        heartbeat = self._control[_HEARTBEAT]
        is_new_heartbeat = new.get(_HEARTBEAT, heartbeat) != heartbeat
        timeout_s = new.get(_RELAY_TIMEOUT, self._control[_RELAY_TIMEOUT]) / 1000.0
        fresh = is_new_heartbeat or time_s < self._heartbeat_s + timeout_s
        if reset and self.config.watchdog_relay and not fresh:
            raise ExceptionReplyError(REFUSED)
        sooner = timeout_s * 1000.0 < self._control[_RELAY_TIMEOUT]
        was_cut = self.is_laser_enable_off
        for at, word in new.items():
            self._control[at] = word
        if _LASER_ENABLE in new:
            self._output.command(new[_LASER_ENABLE], self.relay_closed)
        if is_new_heartbeat:
            self._heartbeat_s = time_s
        if reset:
            self.relay_closed = self.config.watchdog_relay
            self.card.reset_first_out()
        if reset or sooner or self.is_laser_enable_off != was_cut:
            self.on_change()

    def _meet(self) -> float:
        """Handle an incoming request: raise the error of an injected fault, or return now."""
        time_s = self.advance_to_now()
        if self._silent:
            raise RequestIgnoredError
        if self._exception is not None:
            raise ExceptionReplyError(self._exception)
        return time_s

    def _words(self) -> list[int]:
        words = self._fresh_words()
        if self._frozen is None:
            return words
        return [word if at in _ALIVE else old
                for at, (old, word) in enumerate(zip(self._frozen, words, strict=True))]

    def _fresh_words(self) -> list[int]:
        time_s = self.advance_to_now()
        age_s = time_s - self._heartbeat_s
        timeout_s = self._control[_RELAY_TIMEOUT] / 1000.0
        status = SafetyStatusBits.SELF_TEST_OK
        if self.config.watchdog_relay:
            status |= SafetyStatusBits.RELAY_FITTED
        if self.relay_closed:
            status |= SafetyStatusBits.RELAY_CLOSED
        if self.config.laser_enable:
            status |= SafetyStatusBits.LASER_ENABLE_FITTED
        if self._output.is_on:
            status |= SafetyStatusBits.LASER_ENABLED
        if age_s < timeout_s:
            status |= SafetyStatusBits.HEARTBEAT_FRESH
        return self._block.encode({
            "DEVICE_ID": DEVICE_ID,
            "MAP_VERSION": MAP_MAJOR << 8 | MAP_MINOR,
            "FW_VERSION": _FIRMWARE,
            "RESERVED_3": 0,
            "SERIAL": _SERIAL,
            "INPUTS": int(self.card.good),
            "STATUS": int(status),
            "FIRST_OUT": self.card.first_out,
            "TRIP_COUNT": self.card.trips & 0xFFFF,
            "HEARTBEAT_ECHO": self._control[_HEARTBEAT],
            "HEARTBEAT_AGE": int(min(_MAX_AGE_MS, age_s * 1000)),
            "UPTIME": int(time_s - self._powered_s),
            "TICK": int(time_s * 1000) & 0xFFFF,
            **self.card.values,
        })


def _no_listener() -> None:
    pass
