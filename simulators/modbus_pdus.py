"""Messages of pymodbus that pack and unpack all registers at once.

pymodbus packs registers one by one, and formats every message for a log that is not used. Both
together take a quarter of a round trip. Its extension point (`register`) accepts these instead.
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

_MOST_READ, _MOST_WRITTEN, _MOST_EXCHANGED = 125, 123, 121

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


class ServerWriteRequest(WriteMultipleRegistersRequest):
    """FC 16. is_valid : whether the counts it names agree, and the protocol allows them."""

    def decode(self, data: bytes) -> None:
        self.address, self.count, byte_count = _WRITE.unpack_from(data)
        self.registers = _words(data, _WRITE.size)
        self.is_valid = 1 <= self.count <= _MOST_WRITTEN and (
            byte_count == 2 * self.count == len(data) - _WRITE.size
        )

    def __str__(self) -> str:
        return f"write {self.count} at {self.address}"


class ServerExchangeRequest(ReadWriteMultipleRegistersRequest):
    """FC 23. is_valid : as for a write; the read count is checked too."""

    def decode(self, data: bytes) -> None:
        (
            self.read_address, self.read_count, self.write_address, self.write_count, byte_count,
        ) = _EXCHANGE.unpack_from(data)
        self.write_registers = _words(data, _EXCHANGE.size)
        self.is_valid = 1 <= self.write_count <= _MOST_EXCHANGED and (
            byte_count == 2 * self.write_count == len(data) - _EXCHANGE.size
            and 1 <= self.read_count <= _MOST_READ
        )

    def __str__(self) -> str:
        return f"write {self.write_count} at {self.write_address}, read at {self.read_address}"


class RegistersReply(ModbusPDU):
    """Registers that were read, by any function code."""

    def __init__(self, function_code: int, registers: Sequence[int]) -> None:
        super().__init__(registers=registers)
        self.function_code = function_code

    def encode(self) -> bytes:
        count = len(self.registers)
        return struct.pack(f">B{count}H", 2 * count, *self.registers)


#: Classes to register with pymodbus's decoder.
REQUEST_PDU_CLASSES: tuple[type[ModbusPDU], ...] = (
    ReadHoldingRequest, ReadInputRequest, ServerWriteRequest, ServerExchangeRequest,
)


def _words(data: bytes, at: int) -> tuple[int, ...]:
    return struct.unpack_from(f">{(len(data) - at) // 2}H", data, at)
