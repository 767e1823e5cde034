"""Byte links to a motion controller: TCP, serial port, pty. The one place that opens them.

The loop watches the descriptor; there is no thread. What has not been written yet waits here, not
in the operating system: a real-time byte goes out before it, and on a line with a baud rate only
a few milliseconds of bytes are ever handed over ahead of the wire, so a hold is not stuck behind
a full receive window of lines (86 ms were measured for 1,024 bytes at 115,200 baud).
"""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import serial
from serial.tools import list_ports

from lmctl.errors import MachineError
from lmctl.machine.motion.endpoint import MotionEndpoint, parse_motion_endpoint

_AHEAD_S = 0.005  # of bytes handed to the port and not yet on the wire: 57 bytes at 115,200 baud
_REFILL_AT = 0.7  # of it: what is left outlasts a late timer, and the loop wakes 650 times a second
_RATE_TRUSTED = 0.995  # of the nominal rate: two clocks differ, and what is ahead must not pile up
_MIN_AHEAD = 16  # bytes, so that a slow line does not wake the loop for every byte
_BITS_PER_BYTE = 10  # 8N1
_USB_NATIVE = ("ttyACM", "cu.usbmodem", "tty.usbmodem")  # its baud rate has no effect
_READ_BYTES = 65_536


class ByteLink:
    """An open descriptor, watched by the running loop.

    rate_bytes_s : bytes a second to hand over; None on an unpaced link
    on_data : called with the bytes of each arrival
    on_lost : called once with the reason when the far end is gone; never after `close`
    """

    def __init__(
        self,
        endpoint: str,
        device: socket.socket | serial.Serial,
        rate_bytes_s: float | None,
        on_data: Callable[[bytes], None],
        on_lost: Callable[[str], None],
    ) -> None:
        self.endpoint = endpoint
        self._device = device
        self._fd = device.fileno()
        self._loop = asyncio.get_running_loop()
        self._on_data = on_data
        self._on_lost = on_lost
        self._rate = rate_bytes_s
        self._most_ahead = max(_MIN_AHEAD, (rate_bytes_s or 0.0) * _AHEAD_S)
        self._unsent = bytearray()
        self._urgent = bytearray()  # real-time bytes, for the moments the descriptor takes none
        self._wire_free_s = 0.0  # when the last byte handed over will have left the wire
        self._timer: asyncio.TimerHandle | None = None
        self._blocked = False
        self._open = True
        self._loop.add_reader(self._fd, self._readable)

    @property
    def is_paced(self) -> bool:
        """Whether the wire is slow enough that bytes are handed over a few at a time."""
        return self._rate is not None

    @property
    def unsent_bytes(self) -> int:
        """Bytes written and still held here."""
        return len(self._unsent)

    def write(self, data: bytes) -> None:
        """Send after everything written before. A lost link takes bytes and drops them."""
        if self._open:
            self._unsent += data
            self._pump()

    def write_realtime(self, data: bytes) -> None:
        """Send before everything still held here, regardless of pacing."""
        if self._open:
            self._urgent += data
            self._pump()

    def discard_unsent(self) -> None:
        """Forget what is still held here; the controller may be left with part of a line."""
        self._unsent.clear()

    def close(self) -> None:
        """Stop watching and close; a second call does nothing."""
        if not self._open:
            return
        self._open = False
        self._loop.remove_reader(self._fd)
        if self._blocked:
            self._loop.remove_writer(self._fd)
        if self._timer is not None:
            self._timer.cancel()
        self._unsent.clear()
        self._urgent.clear()
        self._device.close()

    def _pump(self) -> None:
        if self._urgent and not self._blocked:
            self._send(self._urgent, len(self._urgent))
        if not self._unsent or self._blocked or self._timer is not None:
            return
        if self._rate is None:
            self._send(self._unsent, len(self._unsent))
            return
        ahead = max(0.0, self._wire_free_s - self._loop.time()) * self._rate
        room = int(self._most_ahead - ahead)
        if room > 0:
            self._send(self._unsent, min(room, len(self._unsent)))
        if self._unsent and not self._blocked:
            # Come back early: timers are late by a millisecond, on a busy computer by several.
            at_s = self._wire_free_s - _REFILL_AT * self._most_ahead / self._rate
            self._timer = self._loop.call_at(at_s, self._timed)

    def _timed(self) -> None:
        self._timer = None
        self._pump()

    def _send(self, waiting: bytearray, count: int) -> None:
        try:
            sent = os.write(self._fd, waiting[:count])
        except (BlockingIOError, InterruptedError):
            sent = 0
        except OSError as error:
            self._lose(error)
            return
        del waiting[:sent]
        if self._rate is not None:
            start_s = max(self._wire_free_s, self._loop.time())
            self._wire_free_s = start_s + sent / self._rate
        if sent < count:
            self._blocked = True
            self._loop.add_writer(self._fd, self._writable)

    def _writable(self) -> None:
        self._loop.remove_writer(self._fd)
        self._blocked = False
        self._pump()

    def _readable(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._lose(error)
            return
        if data:
            self._on_data(data)
        else:
            self._lose(None)

    def _lose(self, error: OSError | None) -> None:
        why = "the far end closed it" if error is None else (error.strerror or str(error)).lower()
        self.close()
        # Not from inside a write: a caller that is writing need not expect a callback.
        self._loop.call_soon(self._on_lost, f"the link {self.endpoint} was lost: {why}")


async def open_link(
    endpoint: str,
    baud: int,
    on_data: Callable[[bytes], None],
    on_lost: Callable[[str], None],
    timeout_s: float = 5.0,
) -> ByteLink:
    """Open a link to `endpoint`; `baud` counts on serial ports only.

    raises : ConfigError for text that is no endpoint; MachineError where the port is absent, busy,
        refused, forbidden or not a port
    """
    where = parse_motion_endpoint(endpoint)
    if where.kind == "tcp":
        return ByteLink(endpoint, await _connect(where, timeout_s), None, on_data, on_lost)
    port = _open_port(where, baud)
    paced = where.kind == "serial" and not _is_usb_native(where.path)
    rate_bytes_s = _RATE_TRUSTED * baud / _BITS_PER_BYTE if paced else None
    return ByteLink(endpoint, port, rate_bytes_s, on_data, on_lost)


async def _connect(where: MotionEndpoint, timeout_s: float) -> socket.socket:
    loop = asyncio.get_running_loop()
    connection: socket.socket | None = None
    try:
        async with asyncio.timeout(timeout_s):
            family, kind, protocol, _, address = await _resolve(where)
            connection = socket.socket(family, kind, protocol)
            connection.setblocking(False)
            await loop.sock_connect(connection, address)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    except BaseException as error:
        if connection is not None:
            connection.close()
        if isinstance(error, OSError):  # TimeoutError is one
            raise _unreachable(where, timeout_s, error) from None
        raise
    return connection


async def _resolve(where: MotionEndpoint) -> tuple[int, int, int, str, tuple[Any, ...]]:
    try:  # an address needs no resolver, and so no thread
        return socket.getaddrinfo(
            where.host, where.port, type=socket.SOCK_STREAM, flags=socket.AI_NUMERICHOST
        )[0]
    except socket.gaierror:
        loop = asyncio.get_running_loop()
        return (await loop.getaddrinfo(where.host, where.port, type=socket.SOCK_STREAM))[0]


def _unreachable(where: MotionEndpoint, timeout_s: float, error: OSError) -> MachineError:
    place = f"motion controller at {where.text}"
    if isinstance(error, ConnectionRefusedError):
        return MachineError(
            "nothing listens where the motion controller should",
            where=place,
            hint="switch the controller on (or start the bench), and compare motion.endpoint in "
            "the machine profile with its address and port",
        )
    if isinstance(error, TimeoutError):
        return MachineError(
            f"the motion controller did not accept a connection within {timeout_s:g} s",
            where=place,
            hint="check cable, power and address",
        )
    if isinstance(error, socket.gaierror):
        return MachineError(
            f"the name {where.host!r} is not known",
            where=place,
            hint="write the controller's IP address into motion.endpoint",
        )
    return MachineError(
        f"the motion controller cannot be reached: {(error.strerror or str(error)).lower()}",
        where=place,
        hint="check network, cable and address",
    )


def _is_usb_native(path: str) -> bool:
    return Path(path).resolve().name.startswith(_USB_NATIVE)


def _open_port(where: MotionEndpoint, baud: int) -> serial.Serial:
    try:
        return serial.Serial(where.path, baud, timeout=0, write_timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise _refused(where, error) from None
    except (ValueError, OSError) as error:
        raise MachineError(
            f"the port cannot be set up: {error}",
            where=f"motion controller at {where.text}, {baud} baud",
            hint="check motion.baud and motion.endpoint in the machine profile",
        ) from None


def _refused(where: MotionEndpoint, error: serial.SerialException) -> MachineError:
    place = f"motion controller at {where.text}"
    if error.errno in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        there = sorted(port.device for port in list_ports.comports())
        seen = f"ports on this computer: {', '.join(there)}" if there else "no port is plugged in"
        return MachineError(
            f"the port {where.path} does not exist", where=place,
            hint=f"plug the controller in or correct motion.endpoint; {seen}",
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return MachineError(
            f"no permission to open the port {where.path}", where=place,
            hint="add yourself to the group that owns the port (often dialout), log in again",
        )
    if error.errno in (errno.EBUSY, errno.EAGAIN) or "lock" in str(error):
        return MachineError(
            f"the port {where.path} is in use by another program", where=place,
            hint="close the other program (another lmctl run, a sender, a terminal)",
        )
    return MachineError(
        f"{where.path} is not a serial port that can be used", where=(place, str(error)),
        hint="check motion.endpoint in the machine profile",
    )
