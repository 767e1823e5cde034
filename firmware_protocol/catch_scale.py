"""The CSC register map of a catch scale under the nozzle, as a table.

The scale weighs the powder that leaves the nozzle with the beam off. MASS and STAMP belong to one
weighing of the scale's own cycle; NOW is the same clock as the reply is made, so that a host can
relate STAMP to its own time. Input registers can also be read as holding registers from
`MIRROR_ADDRESS` on.
"""

from __future__ import annotations

from enum import IntFlag

from firmware_protocol.registers import Register, RegisterMap, RegisterSpace, RegisterType

DEVICE_ID = 0x4353
MAP_MAJOR, MAP_MINOR = 1, 0
MIRROR_ADDRESS = 500
#: The word that makes the present load the zero of the display.
TARE_KEY = 0x7A12
#: Counts of MASS in a gram.
COUNTS_PER_GRAM = 100


class ScaleStatusBits(IntFlag):
    """STATUS, input register 6."""

    SELF_TEST_OK = 1 << 0
    STABLE = 1 << 1     # the display has not moved for a second
    OVERLOAD = 1 << 2   # the load is beyond the capacity: MASS stands at it
    UNDERLOAD = 1 << 3  # less than an empty pan: something lifts it
    TARED = 1 << 4      # since power-up


_I, _H = RegisterSpace.INPUT, RegisterSpace.HOLDING

_READINGS = (
    Register("DEVICE_ID", _I, 0, description="0x4353; anything else is no CSC scale"),
    Register("MAP_VERSION", _I, 1, description="high byte major, low byte minor"),
    Register("FW_VERSION", _I, 2, description="high byte major, low byte minor"),
    Register("RESOLUTION", _I, 3, unit="mg", description="step of the display"),
    Register("SERIAL", _I, 4, RegisterType.U32),
    Register("STATUS", _I, 6, RegisterType.BITS, description="see ScaleStatusBits"),
    Register("TARE_COUNT", _I, 7, description="modulo 65536: shows that a tare was carried out"),
    Register("MASS", _I, 8, RegisterType.I32, COUNTS_PER_GRAM, "g", may_be_unavailable=True),
    Register("STAMP", _I, 10, RegisterType.U32, unit="ms",
             description="when MASS was weighed, modulo 2^32"),
    Register("NOW", _I, 12, RegisterType.U32, unit="ms",
             description="the same clock as this reply is made"),
    Register("CAPACITY", _I, 14, RegisterType.U32, COUNTS_PER_GRAM, "g",
             description="greatest load, tared or not"),
    Register("UPTIME", _I, 16, RegisterType.U32, unit="s",
             description="goes back when the device restarts"),
)

_CONTROL = (
    Register("TARE", _H, 0, writable=True, description="0x7A12 tares; reads 0"),
)

CSC_MAP = RegisterMap(_READINGS + _CONTROL)

#: Everything the scale reports; and the part of it that changes.
FULL_BLOCK = CSC_MAP.contiguous_block(row.name for row in _READINGS)
CYCLIC_BLOCK = CSC_MAP.contiguous_block(("STATUS", "TARE_COUNT", "MASS", "STAMP", "NOW"))


def mirror_address_of(address: int) -> int:
    """The holding register that shows an input register."""
    return MIRROR_ADDRESS + address
