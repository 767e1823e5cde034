"""The PMX register map of powder feeders with one to four hoppers, as a table.

Source: docs/explanation/powder-delivery.md, Feeders.

Map 1.1 adds one thing to 1.0: from holding register `MIRROR` on, the input registers can be read
too, without the gaps between their blocks: the device's, then each hopper's. So one FC 23 request
writes heartbeat and recipe and reads back as much as is wanted, up to everything.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from functools import cache

from firmware_protocol.registers import Register, RegisterMap, RegisterSpace, RegisterType

DEVICE_ID = 0x504D
MAP_MAJOR_VERSION = 1
#: First map (minor version) with the mirror.
FIRST_MINOR_VERSION_WITH_MIRROR = 1
MIRROR_ADDRESS = 500
MAX_HOPPERS = 4
#: Input registers of one hopper.
HOPPER_WORDS = 20
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


_I, _H = RegisterSpace.INPUT, RegisterSpace.HOLDING

_SYSTEM = (
    Register("DEVICE_ID", _I, 0, description="0x504D; anything else is no PMX feeder"),
    Register("MAP_VERSION", _I, 1, description="high byte major, low byte minor"),
    Register("FW_VERSION", _I, 2, description="high byte major, low byte minor"),
    Register("N_HOPPERS", _I, 3),
    Register("SERIAL", _I, 4, RegisterType.U32),
    Register("STATUS", _I, 6, RegisterType.BITS, description="see Status"),
    Register("ALARM", _I, 7, RegisterType.BITS,
             description="latched; bits 0..5: alarms 101..106, 8..11: hoppers"),
    Register("WARNING", _I, 8, RegisterType.BITS,
             description="bits 0..4: x51..x55 of any hopper, not latched"),
    Register("FIRST_ALARM_CODE", _I, 9, description="first-out; 0 for none"),
    Register("ALARM_COUNT", _I, 10, description="modulo 65536: shows missed alarms"),
    Register("HEARTBEAT_ECHO", _I, 11, description="the last heartbeat written"),
    Register("HEARTBEAT_AGE", _I, 12, unit="ms", description="stays at 65535 when older"),
    Register("UPTIME", _I, 13, RegisterType.U32, unit="s",
             description="goes back when the device restarts"),
    Register("MODE", _I, 15, description="see Mode"),
    Register("STATE", _I, 16, description="see State"),
    Register("TOTAL_FLOW", _I, 17, counts_per_unit=100, unit="g/min", may_be_unavailable=True),
    Register("MIXER_PRESSURE", _I, 18, RegisterType.I16, unit="mbar", may_be_unavailable=True,
             description="over ambient; rises when the nozzle clogs"),
    Register("TOTAL_GAS", _I, 19, counts_per_unit=100, unit="L/min", may_be_unavailable=True),
    Register("SUPPLY_PRESSURE", _I, 20, counts_per_unit=100, unit="bar", may_be_unavailable=True),
    Register("SEQ_APPLIED", _I, 21, description="the SEQ of the recipe that is really running"),
    Register("LAST_REFUSAL", _I, 22, description="see Refusal"),
    Register("TICK", _I, 23, unit="ms", description="modulo 65536: time stamp of this sample"),
)

#: Rows of one hopper: (offset from 100·h, name, type, counts per unit, unit)
_HOPPER = (
    (0, "STATUS", RegisterType.BITS, 1, ""),
    (1, "ALARM", RegisterType.BITS, 1, ""),  # bits 0..9: alarms x01..x10 of this hopper
    (2, "DISC_ACT", RegisterType.U16, 100, "rpm"),
    (3, "DISC_RAMPED", RegisterType.U16, 100, "rpm"),
    (4, "FLOW_EST", RegisterType.U16, 100, "g/min"),
    (5, "FLOW_LIW", RegisterType.U16, 100, "g/min"),
    (6, "WEIGHT", RegisterType.I32, 10, "g"),
    (8, "LEVEL", RegisterType.U16, 10, "%"),
    (9, "STIRRER_ACT", RegisterType.U16, 10, "rpm"),
    (10, "CARRIER_ACT", RegisterType.U16, 100, "L/min"),
    (11, "PRESSURE", RegisterType.I16, 1, "mbar"),
    (12, "MOTOR_CURRENT", RegisterType.U16, 100, "A"),
    (13, "TORQUE", RegisterType.U16, 10, "%"),
    (14, "TEMP", RegisterType.I16, 10, "°C"),
    (15, "TOTALISER", RegisterType.U32, 10, "g"),
    (17, "FEED_FACTOR_ACT", RegisterType.U16, 1000, "g/rev"),
    (18, "FLOW_RSD_60S", RegisterType.U16, 100, "%"),
    (19, "RUN_HOURS", RegisterType.U16, 1, "h"),
)

_CONTROL = (
    Register("COMMAND", _H, 0, RegisterType.BITS, writable=True, description="see Command"),
    Register("HEARTBEAT", _H, 1, writable=True,
             description="host changes it at least every timeout/4"),
    Register("WD_TIMEOUT", _H, 2, unit="ms", writable=True, minimum=0, maximum=60_000,
             description="0: off, allowed in LOCAL and SERVICE only; else 100..60000"),
    Register("WD_ACTION", _H, 3, writable=True, minimum=0, maximum=2,
             description="see WatchdogAction"),
    Register("WD_RESET", _H, 4, writable=True, description="0xBECF resets a latched trip"),
    Register("ALARM_RESET", _H, 5, writable=True, minimum=0, maximum=1,
             description="1 clears alarms whose cause is gone"),
    Register("SEQ", _H, 6, writable=True,
             description="any change commits the shadow block at once"),
    Register("RAMP", _H, 7, counts_per_unit=10, unit="s", writable=True, minimum=0, maximum=600,
             description="time in which discs go evenly to a new recipe"),
    Register("STABILISE", _H, 8, counts_per_unit=10, unit="s", writable=True, minimum=0,
             maximum=600),
    Register("POSTFLOW", _H, 9, counts_per_unit=10, unit="s", writable=True, minimum=0,
             maximum=600),
    Register("SETPOINT_MODE", _H, 10, writable=True, minimum=0, maximum=1,
             description="see SetpointMode"),
    Register("AT_SPEED_TOL", _H, 11, counts_per_unit=10, unit="%", writable=True, minimum=0.1,
             maximum=100),
    # Reserved, so that heartbeat, SEQ and shadow block fit one FC 16 write: written 0, read 0.
    *(Register(f"RESERVED_{a}", _H, a, writable=True, minimum=0, maximum=0) for a in range(12, 20)),
)

#: Rows of one hopper's shadow block: (offset from 20 + 4·(h − 1), name, counts per unit, unit)
_SHADOW = (
    (0, "DISC_SP", 100, "rpm"),
    (1, "CARRIER_SP", 100, "L/min"),
    (2, "STIRRER_SP", 10, "rpm"),
    (3, "FLOW_SP", 100, "g/min"),
)

#: Rows of one hopper's stored configuration: (offset from 1000 + 100·h, name, type, …, words).
#: They live in EEPROM: written only when changed, never streamed.
_CONFIG = (
    (0, "FEED_FACTOR", RegisterType.U16, 1000, "g/rev", 0),
    (1, "N_MIN", RegisterType.U16, 100, "rpm", 0),
    (2, "N_MAX", RegisterType.U16, 100, "rpm", 0),
    (3, "CARRIER_MIN", RegisterType.U16, 100, "L/min", 0),
    (4, "CARRIER_MAX", RegisterType.U16, 100, "L/min", 0),
    (5, "LEVEL_WARN", RegisterType.U16, 10, "%", 0),
    (6, "LEVEL_STOP", RegisterType.U16, 10, "%", 0),
    (7, "POWDER_ID", RegisterType.U32, 1, "", 0),
    (9, "RESERVED_CONFIG", RegisterType.U16, 1, "", 0),
    (10, "LOT", RegisterType.ASCII, 1, "", 16),
)


@cache
def hopper_register_name(channel: int, name: str) -> str:
    """Name of a hopper's row in the map: channel 2, "FLOW_SP" gives "H2.FLOW_SP"."""
    return f"H{channel}.{name}"


def _hopper_rows(channel: int) -> list[Register]:
    rows = [
        Register(hopper_register_name(channel, name), _I, 100 * channel + at, kind, per_unit, unit,
                 may_be_unavailable=kind is not RegisterType.BITS)
        for at, name, kind, per_unit, unit in _HOPPER
    ]
    rows += [
        Register(hopper_register_name(channel, name), _H, 20 + 4 * (channel - 1) + at,
                 RegisterType.U16, per_unit,
                 unit, writable=True)
        for at, name, per_unit, unit in _SHADOW
    ]
    rows += [
        Register(hopper_register_name(channel, name), _H, 1000 + 100 * channel + at, kind, per_unit,
                 unit,
                 writable=True, length=length)
        for at, name, kind, per_unit, unit, length in _CONFIG
    ]
    return rows


def register_map(n_hoppers: int = MAX_HOPPERS) -> RegisterMap:
    """The map of a device with n_hoppers hoppers (1 to 4)."""
    rows = list(_SYSTEM + _CONTROL)
    for channel in range(1, n_hoppers + 1):
        rows += _hopper_rows(channel)
    return RegisterMap(rows)


PMX_MAP = register_map()

SYSTEM_BLOCK = PMX_MAP.contiguous_block(row.name for row in _SYSTEM)


def hopper_input_names(channel: int) -> tuple[str, ...]:
    """Names of a hopper's input rows, in address order."""
    return tuple(hopper_register_name(channel, name) for _, name, *_ in _HOPPER)


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
        hopper_register_name(channel, name)
        for channel in range(1, n_hoppers + 1)
        for _, name, *_ in _SHADOW
    )
