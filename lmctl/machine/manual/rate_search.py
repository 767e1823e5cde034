"""Search for the baud rate of a silent motion controller on its serial port.

Only `?` is sent. At another rate a controller receives it as garbage, so the search runs only at
the operator's request, and not with a machine at work.
"""

from __future__ import annotations

import asyncio
import re

import serial

from lmctl.machine.motion.endpoint import MotionEndpoint

_RATES = (115_200, 9_600, 250_000, 230_400, 57_600, 38_400, 19_200)

_BOOT_S = 2.0  # of boards that reset when their port is opened
_ANSWER_S = 0.3
_REPORT = re.compile(rb"<[A-Z][A-Za-z]+(?::[0-9]+)?\|[ -~]*>")


async def find_baud_rate(where: MotionEndpoint, tried: int) -> int | None:
    """The rate at which a Grbl controller answers on a serial port, or None.

    The port stays open throughout, so that a board which resets with it does so once.
    """
    try:
        port = serial.Serial(where.path, tried, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError):
        return None
    try:
        await asyncio.sleep(_BOOT_S)
        for rate in (tried, *(rate for rate in _RATES if rate != tried)):
            if await _answers(port, rate):
                return rate
    finally:
        port.close()
    return None


async def _answers(port: serial.Serial, rate: int) -> bool:
    try:
        port.baudrate = rate
        port.reset_input_buffer()
        port.write(b"?")
        await asyncio.sleep(_ANSWER_S)
        return _REPORT.search(port.read(1000)) is not None
    except (OSError, ValueError):  # this adapter has no such rate, or was unplugged
        return False
