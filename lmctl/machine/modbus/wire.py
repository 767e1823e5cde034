"""A connection to one Modbus device. pymodbus connects, connects again, and encodes messages.

Its client is left out: for each request it takes a lock, a task that waits (asyncio.wait_for, which
before Python 3.12 swallows a cancel that meets the answer, CPython gh-86296) and a turn of the loop
more. What a request needs is a frame out, a future and a timer. Its RTU framer is left out too: it
takes stray bytes and echoes for the beginning of an answer (see `framing`).
"""

from __future__ import annotations

import asyncio
import logging
from typing import NamedTuple, cast

from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.transport import CommParams, CommType, ModbusProtocol

from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint
from lmctl.machine.modbus.framing import Framing, RtuFraming, SentRequest, TcpFraming
from lmctl.machine.modbus.observation import WireObservation
from lmctl.machine.modbus.pdus import REPLY_PDU_CLASSES

#: Making a connection takes its own time, whatever a device's period or answer time is [s]: the
#: first packet of a connection is sent again only after one second.
CONNECT_TIMEOUT_S = 3.0

#: Waits between attempts to connect again: none before the first, then doubling [s]. Only an answer
#: ends the row, not a mere connection: a gateway takes connections for a device that is off.
_RECONNECT_S = 0.1
_RECONNECT_MOST_S = 1.0

_MAX_UNREAD = 1024

# pymodbus would otherwise print its findings on stderr; they come as errors of ours.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class _OpenRequest(NamedTuple):
    """A request on the wire. answer : its PDU."""

    sent: SentRequest
    answer: asyncio.Future[bytes]


class ModbusWire(ModbusProtocol):
    """One device on its own connection or serial line. One request at a time: see ModbusLink.

    timeout_s : for each answer
    reopens : a network connection is made anew where answers do not come
    seen : what has come since the last good answer
    """

    def __init__(
        self, where: TcpEndpoint | RtuEndpoint, device_id: int, timeout_s: float, *,
        reopens: bool = True,
    ) -> None:
        super().__init__(_parameters(where), is_server=False)
        self._decoder = DecodePDU(False)
        for answer in REPLY_PDU_CLASSES:
            self._decoder.register(answer)
        self._is_tcp = isinstance(where, TcpEndpoint)
        self._framing: Framing = TcpFraming() if self._is_tcp else RtuFraming()
        self._reopens = reopens and self._is_tcp
        self._timeout_s = timeout_s
        self._device_id = device_id
        self._number = 0
        self._unanswered = 0
        self._reopen_after = 1  # unanswered requests in a row before the connection is made anew
        self._reconnect_s = 0.0
        self._open: _OpenRequest | None = None
        self._last: SentRequest | None = None  # whose answer may still come
        self._connecting: asyncio.Event | None = None  # set as the attempt under way ends
        self.seen = self._fresh_observation()

    def reset_observation(self) -> None:
        """The last answer was a good one: what came before it matters no longer."""
        if self.seen.has_anomalies:
            self.seen = self._fresh_observation()

    async def send_request(self, request: ModbusPDU, answer_bytes: int) -> ModbusPDU:
        """Send a request and return its answer, an exception of the device's included.

        answer_bytes : length of the regular answer's PDU, function code included
        Raises TimeoutError where none comes in time, ConnectionError where there is no connection.
        """
        deadline_s = self.loop.time() + self._timeout_s
        self._look_at_unread()
        if not self.is_active() and self._connecting is not None:
            await self._connection(deadline_s)
        if not self.is_active():
            self.seen.unconnected_request_count += 1
            raise ConnectionError("not connected")
        self._number = self._number % 0xFFFF + 1
        pdu = request.function_code.to_bytes(1, "big") + request.encode()
        frame = self._framing.encode(pdu, request.dev_id, self._number)
        sent = SentRequest(
            frame, request.dev_id, request.function_code, self._number, answer_bytes
        )
        answer: asyncio.Future[bytes] = self.loop.create_future()
        self._open, self._last = _OpenRequest(sent, answer), sent
        timer = self.loop.call_at(deadline_s, self._late, answer)
        self.recv_buffer = b""
        cast(asyncio.Transport, self.transport).write(frame)
        try:
            found = self._decoder.decode(await answer)
            self._unanswered, self._reopen_after, self._reconnect_s = 0, 1, 0.0
            if found is None:
                self.seen.damaged_frame_count += 1
                raise TimeoutError("the answer makes no sense")
            return found
        finally:
            timer.cancel()
            self._open = None

    async def _connection(self, deadline_s: float) -> None:
        """Wait for the attempt to connect that is under way, but no longer than an answer."""
        connecting = self._connecting
        assert connecting is not None
        try:
            async with asyncio.timeout_at(deadline_s):
                await connecting.wait()
        except TimeoutError:
            pass  # still not connected: the caller gets that error

    def data_received(self, data: bytes) -> None:
        """Bytes have come: the answer to the open request, or something else."""
        self.recv_buffer = (self.recv_buffer + data)[-_MAX_UNREAD:]
        if self._open is None or self._open.answer.done():
            return  # too late: looked at before the next request
        pdu = self._framing.find_answer(self.recv_buffer, self._open.sent)
        if pdu is not None:
            self.recv_buffer = b""
            self._open.answer.set_result(pdu)

    def callback_data(self, data: bytes, addr: tuple[str, int] | None = None) -> int:
        """Required by pymodbus; called only by its own `data_received`."""
        return len(data)

    def callback_new_connection(self) -> ModbusProtocol:
        """Required by pymodbus for servers; a host does not listen."""
        raise RuntimeError("a host takes no connections")

    def callback_connected(self) -> None:
        """The device is there (again)."""

    def callback_disconnected(self, exc: Exception | None) -> None:
        """The connection is gone: end the open request."""
        if self._open is not None and not self._open.answer.done():
            self._open.answer.set_exception(ConnectionError("the connection was lost"))

    async def do_reconnect(self) -> None:
        """Connect again, at once and then ever more rarely."""
        try:
            connected = False
            while not connected:
                wait_s = self._reconnect_s
                self._reconnect_s = min(max(_RECONNECT_S, 2 * wait_s), _RECONNECT_MOST_S)
                if wait_s:
                    await asyncio.sleep(wait_s)
                self._connecting = self._connecting or asyncio.Event()
                try:
                    connected = await self.connect()
                finally:
                    self._connecting.set()
                    self._connecting = None
        except asyncio.CancelledError:
            pass
        self.reconnect_task = None

    def _late(self, answer: asyncio.Future[bytes]) -> None:
        if answer.done():
            return
        answer.set_exception(TimeoutError("no answer in time"))
        self.seen.unanswered_request_count += 1
        self._look_at_unread()
        self._unanswered += 1
        if self._reopens and self._unanswered >= self._reopen_after:
            self._reopen()

    def _reopen(self) -> None:
        """The connection may be half open: the far end has forgotten it. Make it anew.

        A device counts as silent after three periods, and its time-out is one period at most. So
        the first missing answer already makes the next request use a new connection. A device that
        is merely slow does not have to reconnect each time.
        """
        self._unanswered, self._reopen_after = 0, 2 * self._reopen_after
        transport = cast(asyncio.Transport, self.transport)
        if transport is None:
            return
        transport.abort()  # a device with few connections gets this one back
        self.connection_lost(TimeoutError("nothing answers any more"))
        if self.reconnect_task is not None and not self._reconnect_s:
            self._connecting = asyncio.Event()  # it connects at once, and requests wait for it

    def _look_at_unread(self) -> None:
        """Count what has come and was no answer."""
        unread, self.recv_buffer = self.recv_buffer, b""
        if unread and self._last is not None:
            self.seen.bytes_received += len(unread)
            self._framing.count_unexpected_bytes(unread, self._last, self.seen)

    def _fresh_observation(self) -> WireObservation:
        return WireObservation(self._device_id, not self._is_tcp, self._timeout_s)


def _parameters(where: TcpEndpoint | RtuEndpoint) -> CommParams:
    if isinstance(where, TcpEndpoint):
        return CommParams(
            comm_type=CommType.TCP, comm_name=where.text, host=where.host, port=where.port,
            timeout_connect=CONNECT_TIMEOUT_S, reconnect_delay=_RECONNECT_S,
            reconnect_delay_max=_RECONNECT_MOST_S,
        )
    return CommParams(
        comm_type=CommType.SERIAL, comm_name=where.text, host=where.path, baudrate=where.baud,
        bytesize=8, parity=where.parity, stopbits=where.stop_bits,
        timeout_connect=CONNECT_TIMEOUT_S, reconnect_delay=_RECONNECT_S,
        reconnect_delay_max=_RECONNECT_MOST_S,
    )
