"""A silent device on a serial line looked for at other rates and device ids.

Only reading requests are sent, and `?`. At another rate a device receives them as garbage, so this
is done when somebody asks for it, and not with a machine at work. The port is opened once: many
boards reset when it is.
"""

from __future__ import annotations

import asyncio
import re
import termios
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import serial

from lmctl.config.modbus_device import ModbusDevice
from lmctl.machine.modbus.endpoint import RtuEndpoint, parse_modbus_endpoint
from lmctl.machine.modbus.framing import RtuFraming, SentRequest
from lmctl.machine.motion.endpoint import MotionEndpoint

_MOTION_RATES = (115_200, 9_600, 250_000, 230_400, 57_600, 38_400, 19_200)
_MODBUS_RATES = (19_200, 9_600, 115_200, 38_400, 57_600)
_MOST_IDS = 16

_BOOT_S = 2.0  # of boards that reset when their port is opened
_ANSWER_S = 0.3
_REPORT = re.compile(rb"<[A-Z][A-Za-z]+(?::[0-9]+)?\|[ -~]*>")

#: One holding register, the first: function code, address, count. And how long its answer is.
_READ_FIRST, _ANSWER_BYTES = bytes((3, 0, 0, 0, 1)), 4


async def find_rate(where: MotionEndpoint, tried: int) -> int | None:
    """The rate at which a Grbl controller answers on a serial port, or None."""
    with _port(where.path, tried) as port:
        if port is None:
            return None
        await asyncio.sleep(_BOOT_S)
        for rate in (tried, *(rate for rate in _MOTION_RATES if rate != tried)):
            if await _answers(port, b"?", _REPORT.search, rate, "N"):
                return rate
    return None


async def find_device(device: ModbusDevice) -> tuple[str, str] | None:
    """Where something answers Modbus on the line of a silent device, and what to set then.

    Other ids at the line's rate first, then the device's own id at other rates and parities.
    Returns None where nothing does, and for a device that is on no serial line.
    """
    where = parse_modbus_endpoint(device.endpoint)
    if not isinstance(where, RtuEndpoint):
        return None
    with _port(where.path, where.baud, where.stop_bits) as port:
        if port is None:
            return None
        for device_id in range(1, _MOST_IDS + 1):
            if device_id != device.device_id and await _device_answers(
                port, device_id, where.baud, where.parity
            ):
                return (f"device id {device_id} answers there, and id {device.device_id} was "
                        "asked", f"set device_id = {device_id} if that is the device")
        for rate in (where.baud, *(rate for rate in _MODBUS_RATES if rate != where.baud)):
            for parity in ("E", "N", "O"):
                if (rate, parity) != (where.baud, where.parity) and await _device_answers(
                    port, device.device_id, rate, parity
                ):
                    text = (f"modbus-rtu://{where.path}?baud={rate}&parity={parity}"
                            f"&stop={where.stop_bits}")
                    return (f"it answers at {rate} baud, parity {parity}",
                            f'set endpoint = "{text}"')
    return None


@contextmanager
def _port(path: str, rate: int, stop_bits: int = 1) -> Iterator[serial.Serial | None]:
    """The open port, or None where it cannot be had."""
    port = None
    with suppress(OSError, ValueError):
        port = serial.Serial(path, rate, stopbits=stop_bits, timeout=0, write_timeout=0,
                             exclusive=True)
    try:
        yield port
    finally:
        if port is not None:
            port.close()


async def _device_answers(port: serial.Serial, device_id: int, rate: int, parity: str) -> bool:
    """Whether a device answers a reading request, be it by an exception."""
    framing = RtuFraming()
    frame = framing.encode(_READ_FIRST, device_id, 0)
    sent = SentRequest(frame, device_id, _READ_FIRST[0], 0, _ANSWER_BYTES)
    return await _answers(
        port, frame, lambda data: framing.find_answer(data, sent) is not None, rate, parity
    )


async def _answers(
    port: serial.Serial, request: bytes, is_answer: Callable[[bytes], object], rate: int,
    parity: str,
) -> bool:
    try:
        port.baudrate, port.parity = rate, parity
        port.reset_input_buffer()
        port.write(request)
        await asyncio.sleep(_ANSWER_S)
        return bool(is_answer(port.read(1000)))
    except (OSError, ValueError, termios.error):  # this adapter has no such rate or parity
        with suppress(OSError, ValueError, termios.error):
            port.parity = "N"  # or the next would be refused for the parity of this one
        return False
