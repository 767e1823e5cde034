"""The wire of a simulated device: Modbus TCP, or Modbus RTU over a pty, by pymodbus.

pymodbus frames and answers; registers are computed by the device when they are read, and a write
is the device's own act. All of pymodbus that the simulators use stands here and in its messages.
"""

from __future__ import annotations

import asyncio
import errno
import logging
from collections.abc import Callable, Sequence
from typing import Protocol

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import ModbusIOException, NoSuchIdException
from pymodbus.framer import FramerType
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.base import ModbusBaseServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice
from pymodbus.simulator.simcore import SimCore

from simulators.modbus_pdus import ExchangeRequest, WriteRequest
from simulators.modbus_refusal import RefusedError, SilentError
from simulators.pty_transport import PtyTransport

# What pymodbus would otherwise print on stderr; a program that wants it sets up logging.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_READ_INPUT = 4
_WITH_REGISTERS = {3, 4, 6, 16, 22, 23}

#: pymodbus wants a register to begin with; the device's own take its place.
_NOTHING = SimDevice(id=1, simdata=SimData(0, datatype=DataType.REGISTERS))

_PDUS: list[type[ModbusPDU]] = [WriteRequest, ExchangeRequest]


class Registers(Protocol):
    """A device as its wire sees it.

    Each of its methods may raise RefusedError for an exception, SilentError for no answer.
    """

    @property
    def device_id(self) -> int: ...
    def read_input(self, address: int, count: int) -> list[int]: ...
    def read_holding(self, address: int, count: int) -> list[int]: ...
    def write(self, address: int, words: Sequence[int]) -> None: ...


class _Core(SimCore):
    """The device in the place of pymodbus's table of registers."""

    def __init__(self, registers: Registers) -> None:
        super().__init__(_NOTHING)
        self._registers = registers

    def device_ids(self) -> list[int]:
        return [self._registers.device_id]

    async def async_getValues(
        self, device_id: int, func_code: int, address: int, count: int = 1
    ) -> list[int] | list[bool] | ExcCodes:
        self._check(device_id)
        if func_code not in _WITH_REGISTERS:
            return ExcCodes.ILLEGAL_FUNCTION
        registers = self._registers
        read = registers.read_input if func_code == _READ_INPUT else registers.read_holding
        try:
            return read(address, count)
        except RefusedError as refused:
            return ExcCodes(refused.code)
        except SilentError:
            raise _unanswered(device_id) from None

    async def async_setValues(
        self, device_id: int, func_code: int, address: int, values: list[int] | list[bool]
    ) -> ExcCodes | None:
        self._check(device_id)
        if func_code not in _WITH_REGISTERS:
            return ExcCodes.ILLEGAL_FUNCTION
        try:
            self._registers.write(address, values)
        except RefusedError as refused:
            return ExcCodes(refused.code)
        except SilentError:
            raise _unanswered(device_id) from None
        return None

    def _check(self, device_id: int) -> None:
        if device_id != self._registers.device_id:
            raise _unanswered(device_id)


def _unanswered(device_id: int) -> NoSuchIdException:
    """What makes pymodbus say nothing, as it does for a device that is not on the line."""
    return NoSuchIdException(f"there is no device {device_id} on this line")


class _Handler(ServerRequestHandler):
    """One connection, answering at once.

    The registers never wait, so a request is carried through as it arrives. pymodbus's own way
    (by a thread-safe call into its own loop) costs a third of the whole round trip.
    """

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        try:
            used = super(ServerRequestHandler, self).callback_data(data, addr)
        except ModbusIOException:
            return super().callback_data(data, addr)  # answers it with an exception
        if self.last_pdu:
            self._answer()
        return used

    def _answer(self) -> None:
        answering = self.handle_request()
        try:
            answering.send(None)
        except StopIteration:
            return
        raise RuntimeError("a simulated register waited for something")


class _TcpServer(ModbusTcpServer):
    def callback_new_connection(self) -> ServerRequestHandler:
        return _handler(self)


class _RtuServer(ModbusSerialServer):
    def callback_new_connection(self) -> ServerRequestHandler:
        return _handler(self)


def _handler(server: ModbusBaseServer) -> _Handler:
    return _Handler(server, server.trace_packet, server.trace_pdu, server.trace_connect)


class ModbusServer:
    """A device on its wire. `endpoint` is where a host finds it, in the driver's own spelling."""

    def __init__(self, endpoint: str, close: Callable[[], None]) -> None:
        self.endpoint = endpoint
        self._close = close

    async def close(self) -> None:
        self._close()
        await asyncio.sleep(0)  # let the transports say goodbye


async def serve_tcp(
    registers: Registers, host: str = "127.0.0.1", port: int = 0
) -> ModbusServer:
    """Answer Modbus TCP; port 0 takes a free one. Raises OSError where it cannot listen."""
    server = _TcpServer(_NOTHING, address=(host, port), ignore_missing_devices=True,
                        custom_pdu=_PDUS)
    server.context = _Core(registers)
    if not await server.listen():
        raise OSError(errno.EADDRINUSE, f"port {port} is taken or not allowed")
    assert isinstance(server.transport, asyncio.Server)
    port = server.transport.sockets[0].getsockname()[1]
    return ModbusServer(f"modbus-tcp://{host}:{port}", server.close)


async def serve_pty(registers: Registers) -> ModbusServer:
    """Answer Modbus RTU on a new pty, without parity: Linux ptys carry none."""
    server = _RtuServer(_NOTHING, framer=FramerType.RTU, ignore_missing_devices=True,
                        custom_pdu=_PDUS)
    server.context = _Core(registers)
    connection = server.callback_new_connection()
    transport = PtyTransport(connection)
    connection.connection_made(transport)
    return ModbusServer(f"modbus-rtu://{transport.path}?baud=19200&parity=N", transport.close)
