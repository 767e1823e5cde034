"""Modbus TCP and RTU by pymodbus, which only this module and its messages know.

It asks once and never repeats by itself: a time-out leaves the outcome of a write unknown, so
whoever asked has to read before writing again (protocol.md 14). A lost TCP connection is made
again in the background; meanwhile every request fails at once.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Sequence
from typing import Any, Protocol

from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from firmware_protocol.registers import MOST_READ, MOST_WRITTEN
from lmctl.errors import MachineError
from lmctl.machine.modbus_endpoint import RtuEndpoint, TcpEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus_pdus import (
    ExchangeRequest,
    ExchangeResponse,
    WriteRequest,
    WriteResponse,
)

#: Most registers one exchange (FC 23) may write; it may read MOST_READ.
MOST_EXCHANGED = 121

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, FAILURE, BUSY = 1, 2, 3, 4, 6

_MEANINGS = {
    ILLEGAL_FUNCTION: "it does not know this function",
    ILLEGAL_ADDRESS: "it has no such register",
    ILLEGAL_VALUE: "a value is beyond its limits",
    FAILURE: "it cannot do this in its present state",
    BUSY: "it is busy",
    10: "the gateway has no path to it",
    11: "the gateway got no answer from it",
}

_RECONNECT_S = 0.1
_RECONNECT_MOST_S = 1.0
_LONGEST_FRAME = 256  # characters of an RTU frame

# pymodbus would otherwise print its findings on stderr; they come as errors of ours.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())


class NoAnswerError(MachineError):
    """The device did not answer; whether it acted is not known."""


class RefusedError(MachineError):
    """The device answered with a Modbus exception. code : which."""

    def __init__(self, endpoint: str, code: int) -> None:
        super().__init__(
            f"{_MEANINGS.get(code, 'it answers with an exception')} (Modbus exception {code:02d})",
            where=endpoint,
        )
        self.code = code


class _Client(Protocol):
    """What is used of pymodbus's two clients, whose types tell less."""

    async def connect(self) -> bool: ...
    def close(self) -> None: ...
    def read_input_registers(
        self, address: int, *, count: int, device_id: int
    ) -> Awaitable[ModbusPDU]: ...
    def read_holding_registers(
        self, address: int, *, count: int, device_id: int
    ) -> Awaitable[ModbusPDU]: ...
    def register(self, custom_response_class: type[ModbusPDU]) -> None: ...
    def execute(self, no_response_expected: bool, request: ModbusPDU) -> Awaitable[ModbusPDU]: ...


class ModbusLink:
    """One device at the far end of its own connection or serial line; one request at a time.

    Requests raise NoAnswerError where nothing (or nonsense) comes back, RefusedError where the
    device answers with an exception.
    """

    def __init__(
        self, client: _Client, where: TcpEndpoint | RtuEndpoint, device_id: int, timeout_s: float
    ) -> None:
        self.endpoint = where.text
        self._client = client
        self._device_id = device_id
        self._timeout_s = timeout_s
        self._character_s = where.character_s if isinstance(where, RtuEndpoint) else None
        self._loop = asyncio.get_running_loop()
        self._one_at_a_time = asyncio.Lock()
        self._quiet_until_s = 0.0
        self._answered_s = self._loop.time()

    @classmethod
    async def open(cls, endpoint: str, device_id: int, *, timeout_s: float) -> ModbusLink:
        """Connect. timeout_s : for connecting, and for each answer.

        Raises ConfigError for text that is no endpoint, MachineError where it cannot be reached.
        """
        where = parse_modbus_endpoint(endpoint)
        client = _client(where, timeout_s)
        for answer in (WriteResponse, ExchangeResponse):
            client.register(answer)
        try:
            connected = await client.connect()
        except Exception as error:  # pyserial lets termios.error and others through
            connected, reason = False, str(error)
        else:
            reason = ""
        if not connected:
            client.close()
            raise _unreachable(where, reason)
        return cls(client, where, device_id, timeout_s)

    @property
    def age_s(self) -> float:
        """Time since the last good answer (since opening, before the first)."""
        return self._loop.time() - self._answered_s

    async def read_input(self, address: int, count: int) -> Sequence[int]:
        """FC 04."""
        _check_count(count, MOST_READ)
        answer = await self._ask(
            self._client.read_input_registers, address, count=count, device_id=self._device_id
        )
        return self._registers(answer, count)

    async def read_holding(self, address: int, count: int) -> Sequence[int]:
        """FC 03."""
        _check_count(count, MOST_READ)
        answer = await self._ask(
            self._client.read_holding_registers, address, count=count, device_id=self._device_id
        )
        return self._registers(answer, count)

    async def write(self, address: int, words: Sequence[int]) -> None:
        """FC 16, one register too."""
        _check_count(len(words), MOST_WRITTEN)
        request = WriteRequest(address=address, registers=words, dev_id=self._device_id)
        await self._ask(self._client.execute, False, request)

    async def exchange(
        self, write_address: int, words: Sequence[int], read_address: int, count: int
    ) -> Sequence[int]:
        """FC 23: write holding registers, then read holding registers, in one request."""
        _check_count(len(words), MOST_EXCHANGED)
        _check_count(count, MOST_READ)
        request = ExchangeRequest(read_address, count, write_address, words, self._device_id)
        answer = await self._ask(self._client.execute, False, request)
        return self._registers(answer, count)

    async def close(self) -> None:
        self._client.close()
        await asyncio.sleep(0)  # let the transport say goodbye

    async def _ask(self, request: Any, *args: Any, **settings: Any) -> ModbusPDU:
        async with self._one_at_a_time:
            if (wait_s := self._quiet_until_s - self._loop.time()) > 0:
                await asyncio.sleep(wait_s)
            asked_s = self._loop.time()
            asking = asyncio.current_task()
            cancelled_before = asking.cancelling() if asking else 0
            try:
                answer: ModbusPDU = await request(*args, **settings)
                # pymodbus waits by asyncio.wait_for, which before Python 3.12 swallows a cancel
                # that comes in the same turn of the loop as the answer (CPython gh-86296).
                if asking and asking.cancelling() > cancelled_before:
                    raise asyncio.CancelledError
            except asyncio.CancelledError:
                self._expect_late_answer(asked_s + self._timeout_s)
                raise
            except (ModbusException, OSError) as error:
                self._expect_late_answer(self._loop.time())
                raise NoAnswerError(
                    "it does not answer", where=self.endpoint,
                    hint="check power and cable, and that nobody else is connected to it",
                ) from error
            if answer.isError():
                raise RefusedError(self.endpoint, answer.exception_code)
            self._answered_s = self._loop.time()
            return answer

    def _expect_late_answer(self, sent_s: float) -> None:
        """Keep a serial line quiet until a late answer is surely over.

        RTU answers carry no number: the next request would take it for its own. On TCP pymodbus
        drops late answers by their transaction number.
        """
        if self._character_s is not None:
            self._quiet_until_s = sent_s + _LONGEST_FRAME * self._character_s

    def _registers(self, answer: ModbusPDU, count: int) -> Sequence[int]:
        if len(answer.registers) != count:
            raise NoAnswerError(
                f"it answers with {len(answer.registers)} registers where {count} were asked for",
                where=self.endpoint,
            )
        return answer.registers


def _client(where: TcpEndpoint | RtuEndpoint, timeout_s: float) -> _Client:
    if isinstance(where, TcpEndpoint):
        return AsyncModbusTcpClient(
            where.host, port=where.port, timeout=timeout_s, retries=0,
            reconnect_delay=_RECONNECT_S, reconnect_delay_max=_RECONNECT_MOST_S,
        )
    return AsyncModbusSerialClient(
        where.path, baudrate=where.baud, parity=where.parity, stopbits=where.stop_bits,
        timeout=timeout_s, retries=0, reconnect_delay=_RECONNECT_S,
        reconnect_delay_max=_RECONNECT_MOST_S,
    )


def _unreachable(where: TcpEndpoint | RtuEndpoint, reason: str) -> MachineError:
    if isinstance(where, TcpEndpoint):
        return MachineError(
            f"nothing answers at {where.host}, port {where.port}", where=where.text,
            hint="is the device on, is the network cable in, is the address right?",
        )
    return MachineError(
        f"cannot open the serial port {where.path}", where=[where.text, *([reason] * bool(reason))],
        hint="is the adapter plugged in, is the port free, and may you use it (group dialout)?",
    )


def _check_count(count: int, most: int) -> None:
    if not 1 <= count <= most:
        raise ValueError(f"one request moves 1 to {most} registers, not {count}")
