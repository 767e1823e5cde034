"""Tap between a simulated device and its link: the only place where byte faults apply.

A server passes every chunk through the tap of its device. Without a fault, this costs one attribute
lookup.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

PassOn = Callable[[bytes], None]


class ByteFilter(Protocol):
    """Receives each chunk of one direction, and delivers what passes, at once or later."""

    def __call__(self, data: bytes, deliver: PassOn) -> None: ...


class HostTransport(Protocol):
    """One connection of a host, as asyncio's transports are."""

    def abort(self) -> None: ...
    def pause_reading(self) -> None: ...
    def resume_reading(self) -> None: ...


def drop_chunk(data: bytes, deliver: PassOn) -> None:
    """Drop every chunk."""


class LinkTap:
    """The traffic between one device and its host.

    to_device, to_host : filter of that direction, None without a fault
    is_open : links are accepted; is_rtu : frames on it are Modbus RTU
    host_came : set when the first host connects
    host_was_there : (time on the loop's clock, True on connect, False on disconnect)
    """

    def __init__(self) -> None:
        self.to_device: ByteFilter | None = None
        self.to_host: ByteFilter | None = None
        self.is_open = True
        self.is_rtu = False
        self.host_came = asyncio.Event()
        self.host_was_there: list[tuple[float, bool]] = []
        self._filters: dict[str, list[ByteFilter]] = {"to_device": [], "to_host": []}
        self._observers: list[ByteFilter] = []
        self._links: dict[HostTransport, PassOn] = {}
        self._reading = True
        self._loop = asyncio.get_running_loop()

    # --- for servers

    def host_connected(self, link: HostTransport, write: PassOn) -> PassOn:
        """Register a host connection; returns the function that sends bytes of the device."""
        self._links[link] = write
        self.host_was_there.append((self._loop.time(), True))
        self.host_came.set()
        if not self._reading:
            link.pause_reading()

        def send(data: bytes) -> None:
            if self.to_host is None:
                write(data)
            else:
                self.to_host(data, write)

        return send

    def host_disconnected(self, link: HostTransport) -> None:
        """Register that a host disconnected."""
        if self._links.pop(link, None) is not None:
            self.host_was_there.append((self._loop.time(), False))

    # --- for faults

    def add_filter(self, direction: str, one: ByteFilter) -> None:
        """Add a filter to a direction, after the existing ones."""
        self._filters[direction].append(one)
        self._set(direction)

    def remove_filter(self, direction: str, one: ByteFilter) -> None:
        """Remove a filter; no effect if it is already removed."""
        if one in self._filters[direction]:
            self._filters[direction].remove(one)
            self._set(direction)

    def add_observer(self, one: ByteFilter) -> Callable[[], None]:
        """Add an observer of the bytes that reach the host; returns the function to remove it."""
        self._observers.append(one)
        self._set("to_host")

        def forget() -> None:
            if one in self._observers:
                self._observers.remove(one)
                self._set("to_host")

        return forget

    def send_to_host(self, data: bytes) -> None:
        """Send bytes to the host that the device did not send."""
        for write in list(self._links.values()):
            if self._observers:
                _chain(tuple(self._observers))(data, write)
            else:
                write(data)

    def set_open(self, is_open: bool) -> None:
        """Closed: hosts are disconnected and refused; on a serial line no bytes pass."""
        if is_open == self.is_open:
            return
        self.is_open = is_open
        for direction in self._filters:
            if is_open:
                self.remove_filter(direction, drop_chunk)
            else:
                self.add_filter(direction, drop_chunk)
        if not is_open:
            for link in list(self._links):
                link.abort()

    def make_connections_half_open(self) -> Callable[[], None]:
        """Make open connections half open: their bytes are lost, and a new connection works.

        The returned function closes them.
        """
        forgotten = list(self._links)
        for link in forgotten:
            link.pause_reading()

        def close() -> None:
            for link in forgotten:
                link.abort()

        return close

    def set_reading_enabled(self, reading: bool) -> None:
        """Set whether bytes are read from the link; otherwise they queue at the host."""
        self._reading = reading
        for link in self._links:
            if reading:
                link.resume_reading()
            else:
                link.pause_reading()

    def _set(self, direction: str) -> None:
        filters = tuple(self._filters[direction])
        if direction == "to_host":
            filters += tuple(self._observers)
        setattr(self, direction, _chain(filters) if filters else None)


def _chain(filters: tuple[ByteFilter, ...]) -> ByteFilter:
    first, *rest = filters
    if not rest:
        return first
    behind = _chain(tuple(rest))
    return lambda data, deliver: first(data, lambda passed: behind(passed, deliver))
