"""The device's end of a pty as an asyncio transport; the host opens the other end by its path."""

from __future__ import annotations

import asyncio
import os
import termios
import tty
from typing import Protocol


class DataReceiver(Protocol):
    def data_received(self, data: bytes) -> None: ...


class PtyTransport(asyncio.Transport):
    """path : what the host opens. Both ends stay open until `close`, so hosts may reconnect.

    baud : of the device; bytes of a host that has set another rate are framing errors, which it
        drops. None: any rate is accepted. (A pty has no transmission time and no parity.)
    """

    def __init__(self, receiver: DataReceiver, baud: int | None = None) -> None:
        super().__init__()
        self._receiver = receiver
        self._loop = asyncio.get_running_loop()
        self._device, self._host = os.openpty()
        tty.setraw(self._host)
        os.set_blocking(self._device, False)
        self.path = os.ttyname(self._host)
        self._speed = None if baud is None else getattr(termios, f"B{baud}", None)
        self._unsent = b""
        self.resume_reading()

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self._unsent += bytes(data)
        self._writable()

    def pause_reading(self) -> None:
        self._loop.remove_reader(self._device)

    def resume_reading(self) -> None:
        self._loop.add_reader(self._device, self._readable)

    def abort(self) -> None:
        """A cable was pulled: a serial line has nothing to hang up."""

    def close(self) -> None:
        if self._device < 0:
            return
        self._loop.remove_reader(self._device)
        self._loop.remove_writer(self._device)
        os.close(self._device)
        os.close(self._host)
        self._device = -1

    def is_closing(self) -> bool:
        return self._device < 0

    def _readable(self) -> None:
        try:
            data = os.read(self._device, 4096)
        except BlockingIOError:
            return
        if self._speed is None or termios.tcgetattr(self._host)[5] == self._speed:
            self._receiver.data_received(data)

    def _writable(self) -> None:
        try:
            sent = os.write(self._device, self._unsent)
        except BlockingIOError:
            sent = 0
        self._unsent = self._unsent[sent:]
        if self._unsent:
            self._loop.add_writer(self._device, self._writable)
        else:
            self._loop.remove_writer(self._device)
