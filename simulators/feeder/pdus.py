"""Messages of pymodbus, with all their registers packed and unpacked at once.

pymodbus takes them one by one, and spells every message out for a log nobody reads; together
that is a quarter of a round trip.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

MOST_READ, MOST_WRITTEN, MOST_EXCHANGED = 125, 123, 121

_WRITE = struct.Struct(">HHB")
_EXCHANGE = struct.Struct(">HHHHB")


class ReadHoldingRequest(ReadHoldingRegistersRequest):
    """FC 03."""

    def __str__(self) -> str:
        return f"read {self.count} at {self.address}"


class ReadInputRequest(ReadInputRegistersRequest):
    """FC 04."""

    def __str__(self) -> str:
        return f"read {self.count} at {self.address}"


class WriteRequest(WriteMultipleRegistersRequest):
    """FC 16. sound : whether the counts it names agree, and are within the protocol's limits."""

    def decode(self, data: bytes) -> None:
        self.address, self.count, byte_count = _WRITE.unpack_from(data)
        self.registers, self.sound = _words(data, _WRITE.size, self.count, byte_count, MOST_WRITTEN)

    def __str__(self) -> str:
        return f"write {self.count} at {self.address}"


class ExchangeRequest(ReadWriteMultipleRegistersRequest):
    """FC 23. sound : as above, reading included."""

    def decode(self, data: bytes) -> None:
        (
            self.read_address, self.read_count, self.write_address, self.write_count, byte_count,
        ) = _EXCHANGE.unpack_from(data)
        self.write_registers, sound = _words(
            data, _EXCHANGE.size, self.write_count, byte_count, MOST_EXCHANGED)
        self.sound = sound and 1 <= self.read_count <= MOST_READ

    def __str__(self) -> str:
        return f"write {self.write_count} at {self.write_address}, read at {self.read_address}"


class RegistersAnswer(ModbusPDU):
    """Registers that were read, for any function that reads them."""

    def __init__(self, function_code: int, registers: Sequence[int]) -> None:
        super().__init__(registers=registers)
        self.function_code = function_code

    def encode(self) -> bytes:
        count = len(self.registers)
        return struct.pack(f">B{count}H", 2 * count, *self.registers)


REQUESTS: tuple[type[ModbusPDU], ...] = (
    ReadHoldingRequest, ReadInputRequest, WriteRequest, ExchangeRequest,
)


def _words(
    data: bytes, at: int, count: int, byte_count: int, most: int
) -> tuple[tuple[int, ...], bool]:
    """The words from `at` on, and whether they are as many as announced."""
    there = (len(data) - at) // 2
    sound = 1 <= count <= most and byte_count == 2 * count == len(data) - at
    return struct.unpack_from(f">{there}H", data, at), sound
