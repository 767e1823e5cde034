"""Modbus TCP and RTU, over a `modbus_wire`.

It asks once and never repeats by itself: a time-out leaves the outcome of a write unknown, so
whoever asked has to read before writing again (protocol.md 14). A lost TCP connection is made
again in the background; meanwhile every request fails at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Sequence

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from firmware_protocol.registers import MOST_READ, MOST_WRITTEN
from lmctl.errors import MachineError
from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus.pdus import ExchangeRequest, WriteRequest
from lmctl.machine.modbus.wire import ModbusWire

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

_LONGEST_FRAME = 256  # characters of an RTU frame


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


class ModbusLink:
    """One device at the far end of its own connection or serial line; one request at a time.

    Requests raise NoAnswerError where nothing (or nonsense) comes back, RefusedError where the
    device answers with an exception.
    """

    def __init__(
        self, wire: ModbusWire, where: TcpEndpoint | RtuEndpoint, device_id: int, timeout_s: float
    ) -> None:
        self.endpoint = where.text
        self._wire = wire
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
        wire = ModbusWire(where, timeout_s)
        try:
            connected = await wire.connect()
        except Exception as error:  # pyserial lets termios.error and others through
            connected, reason = False, str(error)
        else:
            reason = ""
        if not connected:
            wire.close()
            raise _unreachable(where, reason)
        return cls(wire, where, device_id, timeout_s)

    @property
    def age_s(self) -> float:
        """Time since the last good answer (since opening, before the first)."""
        return self._loop.time() - self._answered_s

    async def read_input(self, address: int, count: int) -> Sequence[int]:
        """FC 04."""
        _check_count(count, MOST_READ)
        request = ReadInputRegistersRequest(
            dev_id=self._device_id, address=address, count=count)
        return self._registers(await self._ask(request), count)

    async def read_holding(self, address: int, count: int) -> Sequence[int]:
        """FC 03."""
        _check_count(count, MOST_READ)
        request = ReadHoldingRegistersRequest(
            dev_id=self._device_id, address=address, count=count)
        return self._registers(await self._ask(request), count)

    async def write(self, address: int, words: Sequence[int]) -> None:
        """FC 16, one register too."""
        _check_count(len(words), MOST_WRITTEN)
        await self._ask(WriteRequest(address=address, registers=words, dev_id=self._device_id))

    async def exchange(
        self, write_address: int, words: Sequence[int], read_address: int, count: int
    ) -> Sequence[int]:
        """FC 23: write holding registers, then read holding registers, in one request."""
        _check_count(len(words), MOST_EXCHANGED)
        _check_count(count, MOST_READ)
        request = ExchangeRequest(read_address, count, write_address, words, self._device_id)
        return self._registers(await self._ask(request), count)

    async def close(self) -> None:
        self._wire.close()
        await asyncio.sleep(0)  # let the transport say goodbye

    async def _ask(self, request: ModbusPDU) -> ModbusPDU:
        async with self._one_at_a_time:
            if (wait_s := self._quiet_until_s - self._loop.time()) > 0:
                await asyncio.sleep(wait_s)
            asked_s = self._loop.time()
            try:
                answer = await self._wire.ask(request)
            except asyncio.CancelledError:
                self._expect_late_answer(asked_s + self._timeout_s)
                raise
            except OSError as error:  # TimeoutError is one
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

        RTU answers carry no number: the next request would take it for its own. On TCP late
        answers are dropped by their transaction number.
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
