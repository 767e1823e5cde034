"""The PMX register map of powder feeders with one to four hoppers.

The registers are those of the map file that ships; here is what their bits and codes mean to a
program. Source: docs/explanation/powder-delivery.md, Feeders.

Map 1.1 adds one thing to 1.0: from holding register `MIRROR` on, the input registers can be read
too, without the gaps between their blocks: the device's, then each hopper's. So one FC 23 request
writes heartbeat and recipe and reads back as much as is wanted, up to everything.
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum, IntFlag
from functools import cache

from firmware_protocol.map_file import shipped_map
from firmware_protocol.registers import Register, RegisterMap, RegisterSpace

DEVICE_ID = 0x504D
MAP_MAJOR_VERSION = 1
#: First map (minor version) with the mirror.
FIRST_MINOR_VERSION_WITH_MIRROR = 1
MIRROR_ADDRESS = 500
MAX_HOPPERS = 4
#: Input registers of one hopper.
HOPPER_WORDS = 20
#: Stored configuration begins here; nothing below it survives a restart.
FIRST_CONFIGURATION_REGISTER = 1000
#: The deliberate word that resets a latched watchdog trip.
WATCHDOG_RESET_KEY = 0xBECF
ALARM_RESET_KEY = 1


class FeederStatusBits(IntFlag):
    """STATUS, input register 6."""

    READY = 1 << 0
    REMOTE = 1 << 1
    GAS_OK = 1 << 2
    FEEDING = 1 << 3
    AT_SETPOINT = 1 << 4
    STABLE = 1 << 5
    WARNING = 1 << 6
    ALARM = 1 << 7
    WATCHDOG_TRIPPED = 1 << 8
    ESTOP_CHAIN_OK = 1 << 9
    LID_CLOSED = 1 << 10
    PURGING = 1 << 11
    RAMPING = 1 << 12
    REFILLING = 1 << 13
    CONFIG_VALID = 1 << 14
    TOGGLE = 1 << 15


class HopperStatusBits(IntFlag):
    """STATUS_H, input register 100·h."""

    PRESENT = 1 << 0
    ENABLED = 1 << 1
    RUNNING = 1 << 2
    AT_SETPOINT = 1 << 3
    STABLE = 1 << 4
    LEVEL_LOW = 1 << 5
    LEVEL_EMPTY = 1 << 6
    REFILLING = 1 << 7
    LID_CLOSED = 1 << 8
    PRESSURISED = 1 << 9
    HEATED_OK = 1 << 10
    LIW_VALID = 1 << 11
    STIRRER_ON = 1 << 12
    LIMITED = 1 << 13
    BELOW_N_MIN = 1 << 14
    FAULT = 1 << 15


class FeederCommandBits(IntFlag):
    """COMMAND, holding register 0: each bit acts by its level."""

    ENABLE_REMOTE = 1 << 0
    GAS_ON = 1 << 1
    FEED_ON = 1 << 2
    STIR_ON = 1 << 3
    STOP = 1 << 4
    PURGE = 1 << 5
    REFILL_HOLD = 1 << 6


class FeederStateCode(IntEnum):
    """STATE, input register 16."""

    BOOT = 0
    NOT_READY = 1
    READY = 2
    GAS_PREFLOW = 3
    STABILISING = 4
    FEEDING = 5
    STOPPING = 6
    FAULT = 7
    ESTOP = 8


class FeederMode(IntEnum):
    LOCAL = 0
    REMOTE = 1
    SERVICE = 2


class WatchdogAction(IntEnum):
    """What a tripped watchdog does."""

    HOLD = 0
    DISCS_STOP = 1
    ALL_STOP = 2


class SetpointMode(IntEnum):
    RPM = 0
    G_MIN = 1


class WriteRefusalCode(IntEnum):
    """LAST_REFUSAL: why the last write was answered by exception 04."""

    NONE = 0
    NOT_REMOTE = 1
    FAULTED = 2
    NO_GAS = 3
    POWDER_RUNNING = 4
    CAUSE_REMAINS = 5
    WATCHDOG_NEEDED = 6


#: The map file, without hoppers beyond those of a device: rows of the device and of one hopper.
_FILE = shipped_map("pmx")
_SYSTEM = tuple(row for row in _FILE.rows if row.space is RegisterSpace.INPUT)
_CONTROL = tuple(row for row in _FILE.rows if row.space is RegisterSpace.HOLDING)
_HOPPER = tuple(one for one in _FILE.hopper_rows if one.register.space is RegisterSpace.INPUT)
#: A hopper's part of the shadow block lies below its stored configuration.
_SHADOW = tuple(one for one in _FILE.hopper_rows if one.register.space is RegisterSpace.HOLDING
                and one.register.address < FIRST_CONFIGURATION_REGISTER)


@cache
def hopper_register_name(channel: int, name: str) -> str:
    """Name of a hopper's row in the map: channel 2, "FLOW_SP" gives "H2.FLOW_SP"."""
    return f"H{channel}.{name}"


def _own_name(name: str) -> str:
    """A hopper's row as it is called here: the file tells it from the device's by a suffix."""
    return name.removesuffix("_H")


def _hopper_rows(channel: int) -> list[Register]:
    return [
        replace(one.register, name=hopper_register_name(channel, _own_name(one.register.name)),
                address=one.register.address + (channel - 1) * one.step)
        for one in _FILE.hopper_rows
    ]


def register_map(n_hoppers: int = MAX_HOPPERS) -> RegisterMap:
    """The map of a device with n_hoppers hoppers (1 to 4)."""
    rows = list(_FILE.rows)
    for channel in range(1, n_hoppers + 1):
        rows += _hopper_rows(channel)
    return RegisterMap(rows)


PMX_MAP = register_map()

SYSTEM_BLOCK = PMX_MAP.contiguous_block(row.name for row in _SYSTEM)


def hopper_input_names(channel: int) -> tuple[str, ...]:
    """Names of a hopper's input rows, in address order."""
    return tuple(hopper_register_name(channel, _own_name(one.register.name)) for one in _HOPPER)


def mirror_offset(channel: int) -> int:
    """Where the mirror shows a hopper's input registers, counted from `MIRROR`.

    The device's own are at 0. A hopper that is not there shows zeros.
    """
    return SYSTEM_BLOCK.count + HOPPER_WORDS * (channel - 1)


def mirror_register(address: int) -> int:
    """The holding register that shows an input register, by its wire address; map 1.1."""
    channel, offset = divmod(address, 100)
    return MIRROR_ADDRESS + offset + (mirror_offset(channel) if channel else 0)


def recipe_register_names(n_hoppers: int) -> tuple[str, ...]:
    """Names of the rows one write of a recipe holds: HEARTBEAT to the last shadow register."""
    control = tuple(row.name for row in _CONTROL if row.name != "COMMAND")
    return control + tuple(
        hopper_register_name(channel, one.register.name)
        for channel in range(1, n_hoppers + 1)
        for one in _SHADOW
    )
