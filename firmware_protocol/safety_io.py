"""The SIO register map of safety-input devices, and what its bits and codes mean to a program.

It covers what the host may read of a cell's safety circuits, the watchdog relay that its heartbeat
keeps closed, and the laser-enable output.

The circuits themselves are hardware; this device only reports their state. Its laser-enable
output is an additional contact in the laser's circuit, for a host that wants the beam off before
motion has come to rest. A bit that is 1 is good, so an answer of zeros from a broken device reads
as everything open. Every input register a can also be read as holding register
`MIRROR + a`, so that one FC 23 request writes the heartbeat and reads all inputs back.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

from firmware_protocol.map_file import shipped_map
from firmware_protocol.registers import RegisterSpace

DEVICE_ID = 0x5349
#: Map 1.1 has the laser-enable output.
MAP_MAJOR, MAP_MINOR = 1, 1
MIRROR_ADDRESS = 500
#: The deliberate word that closes an open watchdog relay and forgets the first-out code.
RELAY_RESET_KEY = 0xC105
#: Limits of RELAY_TIMEOUT.
LEAST_TIMEOUT_MS, GREATEST_TIMEOUT_MS = 50, 60_000


class SafetyInputBits(IntFlag):
    """INPUTS, input register 6: 1 is good."""

    ESTOP_CLOSED = 1 << 0
    DOOR_CLOSED = 1 << 1
    LASER_READY = 1 << 2
    LASER_HEALTHY = 1 << 3
    NO_BACK_REFLECTION = 1 << 4
    CHILLER_OK = 1 << 5
    SHIELD_GAS_OK = 1 << 6
    EXTRACTION_OK = 1 << 7
    OXYGEN_VALID = 1 << 8
    KEY_ON = 1 << 9


#: Every input, good.
ALL_INPUTS_OK = SafetyInputBits((1 << len(SafetyInputBits)) - 1)


class SafetyStatusBits(IntFlag):
    """STATUS, input register 7: of the device itself; 1 is good."""

    SELF_TEST_OK = 1 << 0
    RELAY_FITTED = 1 << 1
    RELAY_CLOSED = 1 << 2
    HEARTBEAT_FRESH = 1 << 3
    LASER_ENABLE_FITTED = 1 << 4
    LASER_ENABLED = 1 << 5  # the output itself, read back: not its command


SIO_MAP = shipped_map("sio").registers_of_unit(None)

_READINGS = tuple(row for row in SIO_MAP.rows if row.space is RegisterSpace.INPUT)

#: Everything the device reports; and the part of it that changes, read at every cycle.
FULL_BLOCK = SIO_MAP.contiguous_block(row.name for row in _READINGS)
CYCLIC_BLOCK = SIO_MAP.contiguous_block(
    row.name for row in _READINGS if row.address >= SIO_MAP["INPUTS"].address)


def mirror_address_of(address: int) -> int:
    """The holding register that shows an input register."""
    return MIRROR_ADDRESS + address


@dataclass(frozen=True)
class FirstOutCause:
    """What opened first, in plain words. remedy : what to do about it."""

    code: int
    text: str
    remedy: str


_WORDS = {
    SafetyInputBits.ESTOP_CLOSED: ("the emergency-stop chain is open",
                                   "release the emergency stop"),
    SafetyInputBits.DOOR_CLOSED: ("the door is open", "close the door"),
    SafetyInputBits.LASER_READY: ("the laser is not ready", "see the laser's own display"),
    SafetyInputBits.LASER_HEALTHY: ("the laser reports a fault", "see the laser's own display"),
    SafetyInputBits.NO_BACK_REFLECTION: (
        "the laser sees too much light coming back",
        "look at optics, standoff and the part's surface before going on",
    ),
    SafetyInputBits.CHILLER_OK: ("the chiller reports a fault",
                                 "check its water, filter and set-point"),
    SafetyInputBits.SHIELD_GAS_OK: ("too little shield gas", "check bottle, regulator and hose"),
    SafetyInputBits.EXTRACTION_OK: ("the extraction does not draw", "check fan, filter and flap"),
    SafetyInputBits.OXYGEN_VALID: (
        "the oxygen analyser gives no valid reading", "check its sensor, pump and calibration"
    ),
    SafetyInputBits.KEY_ON: ("the laser's key switch is off", "turn the key"),
}
_RELAY_WORDS = (
    "the watchdog relay opened: the host's heartbeat stopped", "find out why the host went silent"
)

#: FIRST_OUT codes: 101 and on for the inputs, in the order of their bits; 120 for the relay.
_FIRST_CODE = 101
RELAY_FIRST_OUT_CODE = 120


def first_out_code_of_input(one: SafetyInputBits) -> int:
    """FIRST_OUT code of one input: 101 for the e-stop chain, 102 for the door."""
    return _FIRST_CODE + int(one).bit_length() - 1


_FIRST_OUTS = {
    **{first_out_code_of_input(one): FirstOutCause(first_out_code_of_input(one), *words) for one,
       words in _WORDS.items()},
    RELAY_FIRST_OUT_CODE: FirstOutCause(RELAY_FIRST_OUT_CODE, *_RELAY_WORDS),
}


def describe_first_out(code: int) -> FirstOutCause:
    """A FIRST_OUT code in words; one the map does not list is named as such.

    >>> describe_first_out(102).text
    'the door is open'
    """
    unknown = f"safety code {code}, which its register map does not list"
    return _FIRST_OUTS.get(code) or FirstOutCause(code, unknown, "see the device's manual")
