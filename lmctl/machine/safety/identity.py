"""Check that this is the safety-input device of the profile, before anything is written."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from firmware_protocol.registers import WordOrder
from firmware_protocol.safety_io import (
    CYCLIC_BLOCK,
    DEVICE_ID,
    FULL_BLOCK,
    MAP_MAJOR,
    SIO_MAP,
    SafetyStatusBits,
)
from lmctl.config.machine import SafetySettings
from lmctl.errors import ConfigError, MachineError
from lmctl.machine.modbus.client import ModbusExceptionError, ModbusLink, NoReplyError
from lmctl.machine.modbus.endpoint import RtuEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus.opening_retries import answer_with_retries
from lmctl.machine.modbus.word_order import address_base_hint, detect_word_order

#: Characters beside the registers in an FC 23 request and its answer on a serial line, with the
#: silence after each; and those for which a line stays quiet after an answer that did not come.
_FRAME_CHARACTERS = 13 + 5 + 7
_QUIET_CHARACTERS = 256
#: Additional characters where the write is a request of its own: answer, second head and silence.
_SECOND_FRAME_CHARACTERS = 8 + 8 + 7
_UPTIME = SIO_MAP.contiguous_block(["UPTIME"])
_WRITTEN_REGISTERS = SIO_MAP.contiguous_block(["HEARTBEAT", "LASER_ENABLE"]).count


@dataclass(frozen=True)
class SafetyIdentity:
    """heartbeat : the last one written to the device, by this host or an earlier one"""

    map_version: tuple[int, int]
    firmware: tuple[int, int]
    serial: int
    heartbeat: int


def describe_device(safety: SafetySettings) -> str:
    return f"safety device: {safety.endpoint}, device {safety.device_id}"


def check_serial_line(safety: SafetySettings) -> None:
    """Raises ConfigError for a bad endpoint, or a serial line too slow for the period.

    One lost answer, and the quiet after it, must fit in the periods after which a device is silent.
    """
    where = parse_modbus_endpoint(safety.endpoint)
    if not isinstance(where, RtuEndpoint):
        return
    characters = _FRAME_CHARACTERS + 2 * (_WRITTEN_REGISTERS + CYCLIC_BLOCK.count)
    if 23 not in safety.function_codes:
        characters += _SECOND_FRAME_CHARACTERS
    least_s = (characters + _QUIET_CHARACTERS) * where.character_s
    if least_s > safety.period_s:
        raise ConfigError(
            f"the safety device cannot be read every {safety.period_s:g} s over its line",
            where=f"{safety.endpoint}: at {where.baud} baud an exchange takes "
                  f"{characters * where.character_s:.3f} s, and {least_s:.3f} s after a lost one",
            hint=f"raise period_s of [safety] to {math.ceil(100 * least_s) / 100:g}, or the line's "
                 "baud rate",
        )


async def identify_safety_device(link: ModbusLink, safety: SafetySettings) -> SafetyIdentity:
    """Read what the device is.

    Raises MachineError where it is no safety-input device of a known map, lacks the relay or the
    laser-enable output that the profile requires, or sends words in another order; NoReplyError
    and ModbusExceptionError as readings do.
    """
    words = await answer_with_retries(
        lambda: link.read_input(FULL_BLOCK.address, FULL_BLOCK.count), safety.period_s
    )
    order = WordOrder(safety.word_order)
    values: dict[str, Any] = FULL_BLOCK.with_word_order(order).decode(words)
    if values["DEVICE_ID"] != DEVICE_ID:
        raise MachineError(
            "the device for safety inputs is none",
            where=[describe_device(safety),
                   f"its DEVICE_ID is {values['DEVICE_ID']}, not {DEVICE_ID}"],
            hint=address_base_hint(words, DEVICE_ID, safety)
            or "check endpoint and device_id of [safety] in the machine profile",
        )
    version, firmware = divmod(values["MAP_VERSION"], 256), divmod(values["FW_VERSION"], 256)
    if version[0] != MAP_MAJOR:
        raise MachineError(
            "the safety device speaks another register map",
            where=[describe_device(safety),
                   f"map {version[0]}.{version[1]}; map {MAP_MAJOR} is known here"],
            hint="it needs another version of lmctl, or other firmware",
        )
    fitted = SafetyStatusBits(values["STATUS"])
    if safety.relay_timeout_s is not None and SafetyStatusBits.RELAY_FITTED not in fitted:
        raise MachineError(
            "the safety device has no watchdog relay",
            where=[describe_device(safety),
                   f"the profile says relay_timeout_s = {safety.relay_timeout_s:g}"],
            hint="take relay_timeout_s out of [safety], or fit the relay",
        )
    if safety.laser_enable and SafetyStatusBits.LASER_ENABLE_FITTED not in fitted:
        raise MachineError(
            "the safety device has no laser-enable output",
            where=[describe_device(safety), "the profile says laser_enable = true"],
            hint="take laser_enable out of [safety], or fit the output",
        )
    try:
        counted = await detect_word_order(link, _UPTIME, order)
    except (NoReplyError, ModbusExceptionError):
        counted = None  # the first exchange decides
    if counted not in (None, order):
        raise MachineError(
            "the safety device sends its 32-bit values in another word order",
            where=[describe_device(safety),
                   f"its uptime counts as {counted.value}, and {order.value} is expected"],
            hint=f'write word_order = "{counted.value}" into [safety] of the machine profile',
        )
    return SafetyIdentity(version, firmware, values["SERIAL"], values["HEARTBEAT_ECHO"])
