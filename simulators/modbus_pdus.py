"""Messages of pymodbus, with all their registers packed at once, for its `custom_pdu`.

pymodbus packs them one by one, and spells every message out for a log nobody reads; together
that is a quarter of a round trip.
"""

from __future__ import annotations

import struct

from pymodbus.datastore import ModbusServerContext
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersRequest,
)

_WRITE = struct.Struct(">HHB")
_EXCHANGE = struct.Struct(">HHHHB")


class WriteRequest(WriteMultipleRegistersRequest):
    """FC 16. What is amiss between the counts it names is judged by `datastore_update`."""

    def decode(self, data: bytes) -> None:
        self.address, self.count, self.byte_count = _WRITE.unpack_from(data)
        self._payload_byte_count = len(data) - _WRITE.size
        self.registers = _words(data, _WRITE.size, self.byte_count)

    def __str__(self) -> str:
        return f"write {self.count} at {self.address}"


class ExchangeRequest(ReadWriteMultipleRegistersRequest):
    """FC 23."""

    def decode(self, data: bytes) -> None:
        (
            self.read_address, self.read_count, self.write_address, self.write_count,
            self.write_byte_count,
        ) = _EXCHANGE.unpack_from(data)
        self._payload_byte_count = len(data) - _EXCHANGE.size
        self.write_registers = _words(data, _EXCHANGE.size, self.write_byte_count)

    async def datastore_update(self, context: ModbusServerContext, device_id: int) -> ModbusPDU:
        answer = await super().datastore_update(context, device_id)
        if answer.isError():
            return answer
        return _ExchangeResponse(
            registers=answer.registers, dev_id=device_id, transaction_id=self.transaction_id
        )

    def __str__(self) -> str:
        return f"write {self.write_count} at {self.write_address}, read at {self.read_address}"


class _ExchangeResponse(ReadWriteMultipleRegistersResponse):
    def encode(self) -> bytes:
        count = len(self.registers)
        return struct.pack(f">B{count}H", 2 * count, *self.registers)


def _words(data: bytes, at: int, byte_count: int) -> list[int]:
    count = min(len(data) - at, byte_count) // 2
    return list(struct.unpack_from(f">{count}H", data, at))
