"""The wire of a simulated feeder: Modbus TCP, or Modbus RTU over a pty.

pymodbus frames; registers are computed by the device when they are read, and a write is the
device's own act. All of pymodbus that the simulators use stands here and in `pdus`.

pymodbus's own server is left out: a request would go through a task, a thread-safe call into its
own loop and its table of registers, which is more than half of a whole round trip.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import cast

from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.register_message import (
    MaskWriteRegisterRequest,
    MaskWriteRegisterResponse,
    WriteMultipleRegistersResponse,
    WriteSingleRegisterRequest,
    WriteSingleRegisterResponse,
)

from simulators.feeder.device import PmxDevice
from simulators.feeder.holding import ILLEGAL_VALUE, RefusedError
from simulators.feeder.pdus import (
    REQUESTS,
    ExchangeRequest,
    ReadHoldingRequest,
    ReadInputRequest,
    RegistersAnswer,
    WriteRequest,
)
from simulators.feeder.pty_transport import PtyTransport
from simulators.feeder.readings import read_holding, read_input

# What pymodbus would otherwise print on stderr; a program that wants it sets up logging.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

ILLEGAL_FUNCTION = 1

#: No request is longer (RTU; Modbus TCP puts 6 bytes before it and leaves 2 out).
_LONGEST_FRAME = 260


class _Connection(asyncio.Protocol):
    """One host, answered at once: the registers never wait. among : where it stands while open"""

    def __init__(
        self, device: PmxDevice, framer: type[FramerBase], among: set[_Connection]
    ) -> None:
        requests = DecodePDU(True)
        for request in REQUESTS:
            requests.register(request)
        self._device = device
        self._framer = framer(requests)
        self._unread = b""
        self._among = among
        self._transport: asyncio.WriteTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.WriteTransport, transport)
        self._among.add(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self._among.discard(self)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()

    def data_received(self, data: bytes) -> None:
        unread = self._unread + data
        while unread:
            try:
                used, request = self._framer.handleFrame(unread, self._device.config.device_id, 0)
            except ModbusIOException as nonsense:
                self._send(ExceptionResponse(0, ILLEGAL_FUNCTION), nonsense.transaction_id)
                unread = b""
                break
            unread = unread[used:]
            if request is None:
                break
            self._send(self._answer(request), request.transaction_id)
        self._unread = unread if len(unread) <= _LONGEST_FRAME else b""

    def _answer(self, request: ModbusPDU) -> ModbusPDU:
        try:
            return carry_out(self._device, request)
        except RefusedError as refused:
            return ExceptionResponse(request.function_code, refused.code)

    def _send(self, answer: ModbusPDU, number: int) -> None:
        answer.dev_id, answer.transaction_id = self._device.config.device_id, number
        if self._transport is not None:
            self._transport.write(self._framer.buildFrame(answer))


def carry_out(device: PmxDevice, request: ModbusPDU) -> ModbusPDU:
    """Do what a request asks, and answer it. Raises RefusedError."""
    match request:
        case ExchangeRequest():
            _refuse_unsound(request.sound)
            device.write(request.write_address, request.write_registers)
            read = read_holding(device, request.read_address, request.read_count)
            return RegistersAnswer(request.function_code, read)
        case WriteRequest():
            _refuse_unsound(request.sound)
            device.write(request.address, request.registers)
            return WriteMultipleRegistersResponse(address=request.address, count=request.count)
        case ReadInputRequest():
            read = read_input(device, request.address, request.count)
            return RegistersAnswer(request.function_code, read)
        case ReadHoldingRequest():
            read = read_holding(device, request.address, request.count)
            return RegistersAnswer(request.function_code, read)
        case WriteSingleRegisterRequest():
            device.write(request.address, request.registers)
            return WriteSingleRegisterResponse(
                address=request.address, registers=request.registers)
        case MaskWriteRegisterRequest():
            (word,) = read_holding(device, request.address, 1)
            word = (word & request.and_mask) | (request.or_mask & ~request.and_mask)
            device.write(request.address, [word])
            return MaskWriteRegisterResponse(
                request.address, request.and_mask, request.or_mask)
    raise RefusedError(ILLEGAL_FUNCTION)


def _refuse_unsound(sound: bool) -> None:
    if not sound:
        raise RefusedError(ILLEGAL_VALUE)


class FeederServer:
    """A device on its wire. `endpoint` is where a host finds it, in the driver's own spelling."""

    def __init__(self, endpoint: str, close: Callable[[], None]) -> None:
        self.endpoint = endpoint
        self._close = close

    async def close(self) -> None:
        self._close()
        await asyncio.sleep(0)  # let the transports say goodbye


async def serve_tcp(device: PmxDevice, host: str = "127.0.0.1", port: int = 0) -> FeederServer:
    """Answer Modbus TCP; port 0 takes a free one. Raises OSError where it cannot listen."""
    open_: set[_Connection] = set()
    server = await asyncio.get_running_loop().create_server(
        lambda: _Connection(device, FramerSocket, open_), host, port)
    port = server.sockets[0].getsockname()[1]

    def close() -> None:
        server.close()
        for connection in list(open_):
            connection.close()

    return FeederServer(f"modbus-tcp://{host}:{port}", close)


async def serve_pty(device: PmxDevice) -> FeederServer:
    """Answer Modbus RTU on a new pty, without parity: Linux ptys carry none."""
    connection = _Connection(device, FramerRTU, set())
    transport = PtyTransport(connection)
    connection.connection_made(transport)
    return FeederServer(f"modbus-rtu://{transport.path}?baud=19200&parity=N", transport.close)
