"""The address and the particulars of a Modbus device, as a machine profile states them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from lmctl.config.toml_file import ConfigModel

WordOrderName = Literal["ABCD", "CDAB", "BADC", "DCBA"]
FunctionCode = Literal[3, 4, 16, 23]

#: Without these no device can be driven: its stored settings are holding registers (3), and a
#: recipe is one write (16).
_NEEDED_CODES: tuple[FunctionCode, ...] = (3, 16)


class ModbusDevice(ConfigModel):
    """A device at the far end of its own connection or serial line.

    endpoint : "modbus-tcp://HOST[:PORT]" or "modbus-rtu:///dev/ttyUSB0?baud=19200&parity=E&stop=1"
    device_id : unit id, 1 to 247
    word_order : of 32-bit values, A being the most significant byte
    address_base : address of its first register on the wire: 0, or 1 for devices that count from 1
        there too
    max_registers : most registers that it moves in one request
    function_codes : those it, and a gateway before it, carry out. Without 23 a write and a reading
        are two requests; without 4 readings go through the holding registers
    timeout_s : how long an answer may take; None: as the device's cycle needs it
    """

    endpoint: str
    device_id: Annotated[int, Field(ge=1, le=247)] = 1
    word_order: WordOrderName = "ABCD"
    address_base: Annotated[int, Field(ge=0, le=1)] = 0
    max_registers: Annotated[int, Field(ge=1, le=125)] = 125
    function_codes: tuple[FunctionCode, ...] = (3, 4, 16, 23)
    timeout_s: Annotated[float, Field(ge=0.01, le=10)] | None = None

    @field_validator("function_codes")
    @classmethod
    def _enough(cls, value: tuple[FunctionCode, ...]) -> tuple[FunctionCode, ...]:
        missing = [str(code) for code in _NEEDED_CODES if code not in value]
        if missing:
            raise ValueError(f"a device cannot be driven without {' and '.join(missing)}")
        return value
