"""Modbus link of a simulated device: Modbus TCP, or Modbus RTU over a pty.

pymodbus does the framing. The device computes registers when the host reads them, and carries out
each write itself. The simulators use pymodbus only here and in `modbus_pdus`.

The pymodbus server is not used: it passes a request through a task, a thread-safe call into its own
loop and a table of registers, which took half of a round trip.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from typing import cast

from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsRequest,
    ReadCoilsResponse,
    ReadDiscreteInputsRequest,
    ReadDiscreteInputsResponse,
    WriteMultipleCoilsRequest,
    WriteMultipleCoilsResponse,
)
from pymodbus.pdu.register_message import (
    MaskWriteRegisterRequest,
    MaskWriteRegisterResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from simulators.faults.link_tap import LinkTap
from simulators.modbus_errors import (
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ExceptionReplyError,
    RequestIgnoredError,
)
from simulators.modbus_pdus import (
    REQUEST_PDU_CLASSES,
    ReadHoldingRequest,
    ReadInputRequest,
    RegistersReply,
    ServerExchangeRequest,
    ServerWriteRequest,
)
from simulators.modbus_quirks import ModbusQuirks, ModbusRegisters, RegistersWithQuirks
from simulators.pty_transport import PtyTransport

# What pymodbus would otherwise print on stderr; a program that wants it sets up logging.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

#: More than the longest request (Modbus TCP): limits how many invalid bytes are kept.
_MAX_UNREAD = 264


class ModbusServer:
    """A device on its link. `endpoint` is its address, in the spelling of the driver.

    units : other devices at the same endpoint, by their ids
    """

    def __init__(
        self, registers: ModbusRegisters, edge: LinkTap | None = None,
        quirks: ModbusQuirks | None = None, units: Mapping[int, ModbusRegisters] | None = None,
    ) -> None:
        self.endpoint = ""
        self.quirks = quirks or ModbusQuirks()
        self.registers = registers if quirks is None else RegistersWithQuirks(registers, quirks)
        self.units = {number: unit if quirks is None else RegistersWithQuirks(unit, quirks)
                      for number, unit in (units or {}).items()}
        self.edge = edge or LinkTap()
        self.open: set[_Connection] = set()
        self.listening: asyncio.Server | None = None

    def disconnect_hosts(self) -> None:
        """Close the connections of all hosts; they may reconnect."""
        for connection in list(self.open):
            connection.close()

    def go_offline(self) -> None:
        """Go offline: close all connections and accept no more."""
        if self.listening is not None:
            self.listening.close()
        self.disconnect_hosts()

    async def close(self) -> None:
        self.go_offline()
        await asyncio.sleep(0)  # let the transports close


class _Connection(asyncio.Protocol):
    """Connection of one host; every request is answered at once."""

    def __init__(self, server: ModbusServer, framer: type[FramerBase]) -> None:
        requests = DecodePDU(True)
        for request in REQUEST_PDU_CLASSES:
            requests.register(request)
        self._server = server
        self._framer = framer(requests)
        self._unread = b""
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        link = cast(asyncio.Transport, transport)
        if not self._server.edge.is_open:
            link.abort()
            return
        self._transport = link
        self._write = self._server.edge.host_connected(link, self._out)
        self._server.open.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport is not None:
            self._server.edge.host_disconnected(self._transport)
        self._transport = None
        self._server.open.discard(self)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def _out(self, data: bytes) -> None:
        """Send bytes; a host may have disconnected while a fault delayed them."""
        if self._transport is not None:
            self._transport.write(data)

    def data_received(self, data: bytes) -> None:
        to_device = self._server.edge.to_device
        if to_device is None:
            self._take(data)
        else:
            to_device(data, self._take)

    def _take(self, data: bytes) -> None:
        registers, framer = self._server.registers, self._framer
        unread = self._unread + data
        while unread:
            try:
                expected = 0 if self._server.units else registers.device_id  # 0 : any
                used, request = framer.handleFrame(unread, expected, 0)
            except ModbusIOException as nonsense:
                self._send(ExceptionResponse(0, ILLEGAL_FUNCTION), nonsense.transaction_id,
                           registers.device_id)
                unread = b""
                break
            unread = unread[used:]
            if request is None:
                break
            meant = (registers if request.dev_id == registers.device_id
                     else self._server.units.get(request.dev_id))
            answer = None if meant is None else _answer(self._server.quirks, meant, request)
            if answer is not None:
                self._send(answer, request.transaction_id, request.dev_id)
        self._unread = unread if len(unread) <= _MAX_UNREAD else b""

    def _send(self, answer: ModbusPDU, number: int, device_id: int) -> None:
        answer.dev_id, answer.transaction_id = device_id, number
        if self._transport is not None:
            self._write(self._framer.buildFrame(answer))


def _answer(
    quirks: ModbusQuirks, registers: ModbusRegisters, request: ModbusPDU
) -> ModbusPDU | None:
    try:
        quirks.check_function_code(request.function_code)
        return _carried_out(registers, request)
    except ExceptionReplyError as refused:
        return ExceptionResponse(request.function_code, refused.code)
    except RequestIgnoredError:
        return None


def _carried_out(registers: ModbusRegisters, request: ModbusPDU) -> ModbusPDU:
    """Carry out a request and return the reply. Raises ExceptionReplyError, RequestIgnoredError."""
    match request:
        case ServerExchangeRequest() if request.is_valid:
            registers.write(request.write_address, request.write_registers)
            return RegistersReply(request.function_code, registers.read_holding(
                request.read_address, request.read_count))
        case ServerWriteRequest() if request.is_valid:
            registers.write(request.address, request.registers)
            return WriteMultipleRegistersResponse(address=request.address, count=request.count)
        case ServerExchangeRequest() | ServerWriteRequest():
            raise ExceptionReplyError(ILLEGAL_VALUE)
        case ReadInputRequest():
            return RegistersReply(
                request.function_code, registers.read_input(request.address, request.count))
        case ReadHoldingRequest():
            return RegistersReply(
                request.function_code, registers.read_holding(request.address, request.count))
        case ReadDiscreteInputsRequest() if isinstance(registers, RegistersWithQuirks):
            return ReadDiscreteInputsResponse(bits=list(map(bool, registers.read_discrete(
                request.address, request.count))))
        case ReadCoilsRequest() if isinstance(registers, RegistersWithQuirks):
            return ReadCoilsResponse(bits=list(map(bool, registers.read_coils(
                request.address, request.count))))
        case WriteMultipleCoilsRequest() if isinstance(registers, RegistersWithQuirks):
            registers.write_coils(request.address, list(map(int, request.bits)))
            return WriteMultipleCoilsResponse(address=request.address, count=len(request.bits))
        case WriteSingleRegisterRequest():
            registers.write(request.address, request.registers)
            return WriteSingleRegisterResponse(
                address=request.address, registers=request.registers)
        case MaskWriteRegisterRequest():
            (word,) = registers.read_holding(request.address, 1)
            word = (word & request.and_mask) | (request.or_mask & ~request.and_mask)
            registers.write(request.address, [word])
            return MaskWriteRegisterResponse(request.address, request.and_mask, request.or_mask)
    raise ExceptionReplyError(ILLEGAL_FUNCTION)


async def serve_tcp(
    registers: ModbusRegisters, host: str = "127.0.0.1", port: int = 0, edge: LinkTap | None = None,
    quirks: ModbusQuirks | None = None, units: Mapping[int, ModbusRegisters] | None = None,
) -> ModbusServer:
    """Serve Modbus TCP; port 0 takes a free port. Raises OSError where it cannot listen.

    edge : where faults apply to its bytes
    """
    server = ModbusServer(registers, edge, quirks, units)
    server.listening = await asyncio.get_running_loop().create_server(
        lambda: _Connection(server, FramerSocket), host, port)
    server.endpoint = f"modbus-tcp://{host}:{server.listening.sockets[0].getsockname()[1]}"
    return server


async def serve_pty(
    registers: ModbusRegisters, edge: LinkTap | None = None, baud: int = 19_200,
    quirks: ModbusQuirks | None = None, checks_baud: bool = False,
    units: Mapping[int, ModbusRegisters] | None = None,
) -> ModbusServer:
    """Answer Modbus RTU on a new pty, without parity: Linux ptys carry none.

    edge : where faults apply to its bytes
    baud : rate given in the endpoint; a pty itself has no transmission time
    checks_baud : whether the server rejects bytes from a host at another rate
    """
    server = ModbusServer(registers, edge, quirks, units)
    server.edge.is_rtu = True
    connection = _Connection(server, FramerRTU)
    transport = PtyTransport(connection, baud if checks_baud else None)
    connection.connection_made(transport)
    server.endpoint = f"modbus-rtu://{transport.path}?baud={baud}&parity=N"
    return server
