"""A connection to one Modbus device, by pymodbus: it connects, connects again and frames.

Its client is left out: for each request it takes a lock, a task that waits (asyncio.wait_for, which
before Python 3.12 swallows a cancel that meets the answer, CPython gh-86296) and a turn of the loop
more. What a request needs is a frame out, a future and a timer.
"""

from __future__ import annotations

import asyncio
import logging
from typing import cast

from pymodbus.exceptions import ModbusIOException
from pymodbus.framer import FramerBase, FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.transport import CommParams, CommType, ModbusProtocol

from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint
from lmctl.machine.modbus.pdus import ANSWERS

_RECONNECT_S = 0.1
_RECONNECT_MOST_S = 1.0

#: So many requests in a row without an answer, and a TCP connection is made anew.
_MOST_UNANSWERED = 4

# pymodbus would otherwise print its findings on stderr; they come as errors of ours.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class ModbusWire(ModbusProtocol):
    """One device on its own connection or serial line. One request at a time: see ModbusLink."""

    def __init__(self, where: TcpEndpoint | RtuEndpoint, timeout_s: float) -> None:
        super().__init__(_parameters(where, timeout_s), is_server=False)
        answers = DecodePDU(False)
        for answer in ANSWERS:
            answers.register(answer)
        framer = FramerSocket if isinstance(where, TcpEndpoint) else FramerRTU
        self._framer: FramerBase = framer(answers)
        self._timeout_s = timeout_s
        self._number = 0
        self._unanswered = 0
        self._reconnect_s = _RECONNECT_S
        self._asked: ModbusPDU | None = None
        self._answer: asyncio.Future[ModbusPDU] | None = None

    async def ask(self, request: ModbusPDU) -> ModbusPDU:
        """Send a request and return its answer, an exception of the device's included.

        Raises TimeoutError where none comes in time, ConnectionError where there is no connection.
        """
        if not self.is_active():
            raise ConnectionError("not connected")
        self._number = request.transaction_id = self._number % 0xFFFF + 1
        self._asked = request
        answer: asyncio.Future[ModbusPDU] = self.loop.create_future()
        self._answer = answer
        timer = self.loop.call_later(self._timeout_s, self._late, answer)
        self.recv_buffer = b""
        cast(asyncio.Transport, self.transport).write(self._framer.buildFrame(request))
        try:
            return await answer
        finally:
            timer.cancel()
            self._asked = self._answer = None

    def data_received(self, data: bytes) -> None:
        """As pymodbus has it, without the copy it keeps of every frame for its log."""
        unread = self.recv_buffer + data
        endless = len(unread) > self.max_buffer_size
        self.recv_buffer = b"" if endless else unread[self.callback_data(unread):]

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        """Bytes have come; returns how many are dealt with."""
        asked, answer = self._asked, self._answer
        if asked is None or answer is None or answer.done():
            return len(data)  # too late
        try:
            used, found = self._framer.handleFrame(data, asked.dev_id, asked.transaction_id)
        except ModbusIOException:
            return len(data)  # nonsense: the time-out will tell
        if found is not None and found.function_code & 0x7F == asked.function_code:
            self._unanswered = 0
            self._reconnect_s = _RECONNECT_S
            answer.set_result(found)
        return used

    def callback_new_connection(self) -> ModbusProtocol:
        """pymodbus asks this of those who listen; a host does not."""
        raise RuntimeError("a host takes no connections")

    def callback_connected(self) -> None:
        """The device is there (again)."""
        self._unanswered = 0

    def callback_disconnected(self, exc: Exception | None) -> None:
        """It is gone: nobody need wait for it."""
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(ConnectionError("the connection was lost"))

    async def do_reconnect(self) -> None:
        """As pymodbus has it, but only an answer shortens the wait again, not a mere connection.

        A gateway takes connections for a device that is off, and drops them: ten times a second.
        """
        try:
            connected = False
            while not connected:
                await asyncio.sleep(self._reconnect_s)
                self._reconnect_s = min(2 * self._reconnect_s, _RECONNECT_MOST_S)
                connected = await self.connect()
        except asyncio.CancelledError:
            pass
        self.reconnect_task = None

    def _late(self, answer: asyncio.Future[ModbusPDU]) -> None:
        if answer.done():
            return
        answer.set_exception(TimeoutError("no answer in time"))
        self._unanswered += 1
        if self._unanswered > _MOST_UNANSWERED and self.comm_params.comm_type is CommType.TCP:
            self.connection_lost(TimeoutError("nothing answers any more"))


def _parameters(where: TcpEndpoint | RtuEndpoint, timeout_s: float) -> CommParams:
    if isinstance(where, TcpEndpoint):
        return CommParams(
            comm_type=CommType.TCP, comm_name=where.text, host=where.host, port=where.port,
            timeout_connect=timeout_s, reconnect_delay=_RECONNECT_S,
            reconnect_delay_max=_RECONNECT_MOST_S,
        )
    return CommParams(
        comm_type=CommType.SERIAL, comm_name=where.text, host=where.path, baudrate=where.baud,
        bytesize=8, parity=where.parity, stopbits=where.stop_bits, timeout_connect=timeout_s,
        reconnect_delay=_RECONNECT_S, reconnect_delay_max=_RECONNECT_MOST_S,
    )
