"""Quirks of a simulated Modbus device: register numbering, and requests that it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, cast

from simulators.modbus_errors import (
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    ExceptionReplyError,
)


class ModbusRegisters(Protocol):
    """The registers of a device as seen from the link.

    Each method may raise ExceptionReplyError for an exception, RequestIgnoredError for no answer.
    """

    @property
    def device_id(self) -> int: ...
    def read_input(self, address: int, count: int) -> list[int]: ...
    def read_holding(self, address: int, count: int) -> list[int]: ...
    def write(self, address: int, words: Sequence[int]) -> None: ...


class ModbusBits(Protocol):
    """Coils and discrete inputs, of devices that have any."""

    def read_coils(self, address: int, count: int) -> list[int]: ...
    def read_discrete(self, address: int, count: int) -> list[int]: ...
    def write_coils(self, address: int, bits: Sequence[int]) -> None: ...


@dataclass(frozen=True)
class ModbusQuirks:
    """address_base : address of the first register on the link
    max_registers : most registers in one request
    function_codes : supported function codes
    """

    address_base: int = 0
    max_registers: int = 125
    function_codes: tuple[int, ...] = (3, 4, 6, 16, 22, 23)

    def check_function_code(self, code: int) -> None:
        """Raises ExceptionReplyError for a function it does not know."""
        if code not in self.function_codes:
            raise ExceptionReplyError(ILLEGAL_FUNCTION)


class RegistersWithQuirks:
    """The registers of a device with its quirks applied."""

    def __init__(self, device: ModbusRegisters, quirks: ModbusQuirks) -> None:
        self._device = device
        self._quirks = quirks

    @property
    def device_id(self) -> int:
        return self._device.device_id

    def read_input(self, address: int, count: int) -> list[int]:
        return self._device.read_input(self._own(address, count), count)

    def read_holding(self, address: int, count: int) -> list[int]:
        return self._device.read_holding(self._own(address, count), count)

    def write(self, address: int, words: Sequence[int]) -> None:
        self._device.write(self._own(address, len(words)), words)

    def read_coils(self, address: int, count: int) -> list[int]:
        return self._bits.read_coils(address - self._quirks.address_base, count)

    def read_discrete(self, address: int, count: int) -> list[int]:
        return self._bits.read_discrete(address - self._quirks.address_base, count)

    def write_coils(self, address: int, bits: Sequence[int]) -> None:
        self._bits.write_coils(address - self._quirks.address_base, bits)

    @property
    def _bits(self) -> ModbusBits:
        """The device's coils. Raises ExceptionReplyError where it has none."""
        if not hasattr(self._device, "read_coils"):
            raise ExceptionReplyError(ILLEGAL_FUNCTION)
        return cast(ModbusBits, self._device)

    def _own(self, address: int, count: int) -> int:
        """The device's own number of a register. Raises ExceptionReplyError."""
        if count > self._quirks.max_registers:
            raise ExceptionReplyError(ILLEGAL_VALUE)
        if address < self._quirks.address_base:
            raise ExceptionReplyError(ILLEGAL_ADDRESS)
        return address - self._quirks.address_base
