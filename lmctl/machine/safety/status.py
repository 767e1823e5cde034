"""The cell's safety status as the safety-input device reports it, in plain words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any

from firmware_protocol.registers import RegisterBlock, WordOrder
from firmware_protocol.safety_io import (
    ALL_INPUTS_OK,
    CYCLIC_BLOCK,
    FirstOutCause,
    SafetyInputBits,
    SafetyStatusBits,
    describe_first_out,
    first_out_code_of_input,
)
from lmctl.config.machine import SafetyInput, SafetySettings
from lmctl.config.modbus_device import WordOrderName

#: The bit of each input a cell may have, by its name in the machine profile.
INPUT_BITS: dict[SafetyInput, SafetyInputBits] = {
    "estop": SafetyInputBits.ESTOP_CLOSED,
    "door": SafetyInputBits.DOOR_CLOSED,
    "laser_ready": SafetyInputBits.LASER_READY,
    "laser_fault": SafetyInputBits.LASER_HEALTHY,
    "back_reflection": SafetyInputBits.NO_BACK_REFLECTION,
    "chiller": SafetyInputBits.CHILLER_OK,
    "shield_gas": SafetyInputBits.SHIELD_GAS_OK,
    "extraction": SafetyInputBits.EXTRACTION_OK,
    "oxygen": SafetyInputBits.OXYGEN_VALID,
    "key": SafetyInputBits.KEY_ON,
}


@dataclass(frozen=True)
class SafetyStatus:
    """One answer. True is good; None: not fitted, or the device reports "not available".

    time_s : loop time it arrived
    relay_closed, laser_enabled : watchdog relay, and laser-enable output as read back; None where
        the profile has none
    oxygen_ppm : also None while the analyser reports itself invalid
    open_inputs : every fitted input that is not good, in words and with advice
    first_out : what opened first since the last reset, None where nothing did
    trip_count : modulo 65536, of inputs that opened: one that opened and closed between two
        answers shows here
    self_test_ok : of the device
    """

    time_s: float
    estop_closed: bool | None
    door_closed: bool | None
    laser_ready: bool | None
    laser_healthy: bool | None
    no_back_reflection: bool | None
    chiller_ok: bool | None
    shield_gas_ok: bool | None
    extraction_ok: bool | None
    oxygen_valid: bool | None
    key_on: bool | None
    relay_closed: bool | None
    laser_enabled: bool | None
    shield_gas_L_min: float | None
    chiller_C: float | None
    chiller_L_min: float | None
    oxygen_ppm: float | None
    extraction_Pa: float | None
    open_inputs: tuple[FirstOutCause, ...]
    first_out: FirstOutCause | None
    trip_count: int
    self_test_ok: bool
    heartbeat_echo: int
    heartbeat_age_s: float
    uptime_s: int
    tick_ms: int


def read_safety_status(
    words: Sequence[int], time_s: float, safety: SafetySettings
) -> SafetyStatus:
    """The cycle block's words as a status of the cell that the profile describes.

    Raises RegisterError where their number is wrong.
    """
    values: dict[str, Any] = _cycle_block(safety.word_order).decode(words)
    facts, open_inputs = _inputs(values["INPUTS"], safety.fitted)
    estop, door, ready, healthy, no_reflection, chiller, gas, extraction, oxygen, key = facts
    status, code = values["STATUS"], values["FIRST_OUT"]
    return SafetyStatus(
        time_s=time_s,
        estop_closed=estop,
        door_closed=door,
        laser_ready=ready,
        laser_healthy=healthy,
        no_back_reflection=no_reflection,
        chiller_ok=chiller,
        shield_gas_ok=gas,
        extraction_ok=extraction,
        oxygen_valid=oxygen,
        key_on=key,
        relay_closed=(
            None if safety.relay_timeout_s is None else bool(
                status & SafetyStatusBits.RELAY_CLOSED.value)
        ),
        laser_enabled=(
            bool(status & SafetyStatusBits.LASER_ENABLED.value) if safety.laser_enable else None),
        shield_gas_L_min=values["SHIELD_GAS"],
        chiller_C=values["CHILLER_TEMP"],
        chiller_L_min=values["CHILLER_FLOW"],
        oxygen_ppm=values["OXYGEN"] if oxygen else None,
        extraction_Pa=values["EXTRACTION_DP"],
        open_inputs=open_inputs,
        first_out=describe_first_out(code) if code else None,
        trip_count=values["TRIP_COUNT"],
        self_test_ok=bool(status & SafetyStatusBits.SELF_TEST_OK.value),
        heartbeat_echo=values["HEARTBEAT_ECHO"],
        heartbeat_age_s=values["HEARTBEAT_AGE"] / 1000.0,
        uptime_s=values["UPTIME"],
        tick_ms=values["TICK"],
    )


@cache
def _cycle_block(word_order: WordOrderName) -> RegisterBlock:
    return CYCLIC_BLOCK.with_word_order(WordOrder(word_order))


@lru_cache(maxsize=64)  # called ten times a second, and the result rarely changes
def _inputs(
    word: int, fitted: tuple[SafetyInput, ...]
) -> tuple[tuple[bool | None, ...], tuple[FirstOutCause, ...]]:
    """The inputs' facts, in the order of BITS, and those that are open in words."""
    good = SafetyInputBits(word & ALL_INPUTS_OK)
    facts = tuple(bit in good if name in fitted else None for name, bit in INPUT_BITS.items())
    return facts, tuple(
        describe_first_out(
            first_out_code_of_input(
                INPUT_BITS[name])) for name in fitted if INPUT_BITS[name] not in good
    )


def _ignore_status(status: SafetyStatus) -> None:
    pass


def _ignore_fault(reason: str, hint: str) -> None:
    pass


@dataclass
class SafetyCallbacks:
    """Callables that receive the device's events; each returns at once.

    on_status : every answer; see SafetyDriver for which of them count as good
    on_fault : why the device, or its laser-enable output, cannot be relied on, once at the
        beginning of each such time, and what to do
    """

    on_status: Callable[[SafetyStatus], None] = field(default=_ignore_status)
    on_fault: Callable[[str, str], None] = field(default=_ignore_fault)
