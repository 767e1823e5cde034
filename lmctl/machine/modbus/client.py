"""Modbus TCP and RTU, over the connection in `wire`.

A request is sent once and never repeated here: a time-out leaves the outcome of a write unknown, so
the caller has to read before it writes again. A lost TCP connection is reopened in the background.
A request waits for a connection attempt under way, within its own time-out; between two attempts it
fails at once.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import (
    ReadCoilsRequest,
    ReadDiscreteInputsRequest,
    WriteMultipleCoilsRequest,
)
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from firmware_protocol.registers import MAX_BITS, MAX_READ_REGISTERS, MAX_WRITE_REGISTERS
from lmctl.config.modbus_device import ModbusDevice
from lmctl.errors import MachineError
from lmctl.machine.modbus.endpoint import RtuEndpoint, TcpEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus.observation import WireObservation
from lmctl.machine.modbus.pdus import ClientExchangeRequest, ClientWriteRequest
from lmctl.machine.modbus.wire import ModbusWire

#: Most registers one exchange (FC 23) may write; it may read MOST_READ.
MAX_EXCHANGE_WRITE_REGISTERS = 121

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, FAILURE = 1, 2, 3, 4

_MEANINGS = {
    ILLEGAL_FUNCTION: "it does not know this function",
    ILLEGAL_ADDRESS: "it has no such register",
    ILLEGAL_VALUE: "a value is beyond its limits",
    FAILURE: "it cannot do this in its present state",
}

#: Keys of the machine profile to correct after an exception.
_REMEDIES = {
    ILLEGAL_FUNCTION: "if it or a gateway before it lacks the function, write function_codes = "
                      "[3, 4, 16] for it into the machine profile",
    ILLEGAL_ADDRESS: "if it counts its registers from 1, write address_base = 1 for it into the "
                     "machine profile",
    ILLEGAL_VALUE: "if it moves fewer registers in one request, write max_registers for it into "
                   "the machine profile",
    FAILURE: "see its own display: a switch at LOCAL, an alarm or a trip keeps it from obeying",
}

#: Exceptions that pass by themselves: of busy devices, and of gateways that did not reach theirs.
#: Each counts as an answer that got lost (Modbus Application Protocol V1.1b3, 7).
_PASSING = {
    5: "it is still working on the request",
    6: "it is busy",
    10: "its gateway has no path to it",
    11: "its gateway got no answer from it",
}

_MAX_FRAME = 256  # characters of an RTU frame
_WRITE_ANSWER_BYTES = 5  # function code, address and count


#: Which holding register shows an input register.
Mirror = Callable[[int], int]


def _no_mirror(address: int) -> int:
    raise ValueError(f"input register {address} is shown by no holding register")


class NoReplyError(MachineError):
    """The device did not answer, or reported that it cannot now; whether it acted is not known.

    Its text describes what was received instead (see `observation`).
    """


class PassingExceptionError(NoReplyError):
    """The device is busy, or its gateway could not reach it: the same request may work later."""


class ModbusExceptionError(MachineError):
    """The device answered with a Modbus exception. code : which."""

    def __init__(self, endpoint: str, code: int) -> None:
        super().__init__(
            f"{_MEANINGS.get(code, 'it answers with an exception')} (Modbus exception {code:02d})",
            where=endpoint, hint=_REMEDIES.get(code, "see its own display"),
        )
        self.code = code


class ModbusLink:
    """One device at the far end of its own connection or serial line; one request at a time.

    Requests raise NoReplyError where nothing (or nonsense) comes back, or an exception that
    passes; ModbusExceptionError where the device answers with another exception.
    """

    def __init__(
        self, wire: ModbusWire, where: TcpEndpoint | RtuEndpoint, device: ModbusDevice,
        timeout_s: float, mirror: Mirror,
    ) -> None:
        self.endpoint = where.text
        self._wire = wire
        self._device_id = device.device_id
        self._base = device.address_base
        self._most = device.max_registers
        self._reads_input = 4 in device.function_codes
        self._exchanges = 23 in device.function_codes
        self._mirror = mirror
        self._timeout_s = timeout_s
        self._character_s = where.character_s if isinstance(where, RtuEndpoint) else None
        self._loop = asyncio.get_running_loop()
        self._one_at_a_time = asyncio.Lock()
        self._quiet_until_s = 0.0
        self._answered_s = self._loop.time()

    @classmethod
    async def open(
        cls, device: ModbusDevice, *, timeout_s: float, mirror: Mirror = _no_mirror
    ) -> ModbusLink:
        """Connect.

        timeout_s : for each answer, unless the device has its own; connecting takes up to
            CONNECT_TIMEOUT_S
        mirror : the holding register that shows an input register, for devices that only read
            those
        Raises ConfigError for text that is no endpoint, MachineError where it cannot be reached.
        """
        where = parse_modbus_endpoint(device.endpoint)
        timeout_s = device.timeout_s or timeout_s
        wire = ModbusWire(where, device.device_id, timeout_s)
        try:
            connected = await wire.connect()
        except Exception as error:  # pyserial lets termios.error and others through
            connected, reason = False, str(error)
        else:
            reason = ""
        if not connected:
            wire.close()
            raise _unreachable(where, reason)
        return cls(wire, where, device, timeout_s, mirror)

    @property
    def wire_observation(self) -> WireObservation:
        """What has come since the last good answer."""
        return self._wire.seen

    @property
    def answer_age_s(self) -> float:
        """Time since the last good answer (since opening, before the first)."""
        return self._loop.time() - self._answered_s

    async def read_input(
        self, address: int, count: int, unit: int | None = None
    ) -> Sequence[int]:
        """FC 04, or FC 03 in the mirror where the device has no other.

        unit : another unit id at the same endpoint; None: the device's own
        """
        if not self._reads_input:
            return await self.read_holding(self._mirror(address), count, unit)
        return await self._read_in_parts(ReadInputRegistersRequest, address, count, unit)

    async def read_holding(
        self, address: int, count: int, unit: int | None = None
    ) -> Sequence[int]:
        """FC 03."""
        return await self._read_in_parts(ReadHoldingRegistersRequest, address, count, unit)

    async def write(self, address: int, words: Sequence[int], unit: int | None = None) -> None:
        """FC 16, one register too. More than the device takes in one request raises ValueError."""
        _check_count(len(words), min(MAX_WRITE_REGISTERS, self._most))
        request = ClientWriteRequest(
            address=self._base + address, registers=words, dev_id=unit or self._device_id)
        await self._ask(request, _WRITE_ANSWER_BYTES)

    async def read_coils(
        self, address: int, count: int, unit: int | None = None
    ) -> Sequence[int]:
        """FC 01: 0 or 1 of each coil."""
        return await self._read_bits(ReadCoilsRequest, address, count, unit)

    async def read_discrete_inputs(
        self, address: int, count: int, unit: int | None = None
    ) -> Sequence[int]:
        """FC 02: 0 or 1 of each discrete input."""
        return await self._read_bits(ReadDiscreteInputsRequest, address, count, unit)

    async def write_coils(self, address: int, bits: Sequence[int], unit: int | None = None) -> None:
        """FC 15, one coil too."""
        _check_count(len(bits), MAX_BITS)
        await self._ask(WriteMultipleCoilsRequest(
            address=self._base + address, bits=[bool(bit) for bit in bits],
            dev_id=unit or self._device_id), _WRITE_ANSWER_BYTES)

    async def _read_bits(
        self, request: Callable[..., ModbusPDU], address: int, count: int, unit: int | None
    ) -> Sequence[int]:
        _check_count(count, MAX_BITS)
        answer_bytes = 2 + (count + 7) // 8
        answer = await self._ask(request(
            dev_id=unit or self._device_id, address=self._base + address, count=count),
            answer_bytes)
        return [int(bit) for bit in answer.bits[:count]]

    async def exchange(
        self, write_address: int, words: Sequence[int], read_address: int, count: int
    ) -> Sequence[int]:
        """FC 23: write holding registers, then read holding registers, in one request.

        Two where the device does not know the function, more where it moves fewer registers.
        """
        _check_count(len(words), min(MAX_EXCHANGE_WRITE_REGISTERS, self._most))
        _check_count(count, MAX_READ_REGISTERS)
        if not self._exchanges:
            await self.write(write_address, words)
            return await self.read_holding(read_address, count)
        first = min(count, self._most)
        request = ClientExchangeRequest(
            self._base + read_address, first, self._base + write_address, words, self._device_id)
        registers = await self._read(request, first)
        if first == count:
            return registers
        return (*registers, *await self.read_holding(read_address + first, count - first))

    async def _read_in_parts(
        self, request: Callable[..., ModbusPDU], address: int, count: int,
        unit: int | None = None,
    ) -> Sequence[int]:
        """Registers read one after the other, as many in a request as the device moves."""
        _check_count(count, MAX_READ_REGISTERS)
        found: Sequence[int] = ()
        while (at := len(found)) < count:
            part = min(self._most, count - at)
            registers = await self._read(request(
                dev_id=unit or self._device_id, address=self._base + address + at, count=part),
                part)
            found = registers if part == count else (*found, *registers)
        return found

    async def close(self) -> None:
        self._wire.close()
        await asyncio.sleep(0)  # let the transport close

    async def _read(self, request: ModbusPDU, count: int) -> Sequence[int]:
        answer = await self._ask(request, 2 + 2 * count)
        if len(answer.registers) != count:
            raise NoReplyError(
                f"it answers with {len(answer.registers)} registers where {count} were asked for",
                where=self.endpoint, hint="is it the device of the machine profile?",
            )
        return answer.registers

    async def _ask(self, request: ModbusPDU, answer_bytes: int) -> ModbusPDU:
        async with self._one_at_a_time:
            if (wait_s := self._quiet_until_s - self._loop.time()) > 0:
                await asyncio.sleep(wait_s)
            asked_s = self._loop.time()
            try:
                answer = await self._wire.send_request(request, answer_bytes)
            except asyncio.CancelledError:
                self._expect_late_answer(asked_s + self._timeout_s)
                raise
            except OSError as error:  # TimeoutError is one
                self._expect_late_answer(self._loop.time())
                seen = self._wire.seen
                raise NoReplyError(
                    f"it does not answer: {seen.description}", where=self.endpoint, hint=seen.hint
                ) from error
            if answer.isError():
                raise self._exception(answer.exception_code)
            self._answered_s = self._loop.time()
            self._wire.reset_observation()
            return answer

    def _exception(self, code: int) -> MachineError:
        if code not in _PASSING:
            return ModbusExceptionError(self.endpoint, code)
        seen, words = self._wire.seen, f"{_PASSING[code]} (Modbus exception {code:02d})"
        seen.passing_exception_counts[words] = seen.passing_exception_counts.get(words, 0) + 1
        return PassingExceptionError(words, where=self.endpoint, hint=seen.hint)

    def _expect_late_answer(self, sent_s: float) -> None:
        """Keep a serial line quiet until a late answer is surely over.

        RTU answers carry no number: the next request would take it for its own. On TCP late
        answers are dropped by their transaction number.
        """
        if self._character_s is not None:
            self._quiet_until_s = sent_s + _MAX_FRAME * self._character_s


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
        raise ValueError(f"one request moves 1 to {most} registers or bits, not {count}")
