"""The edge of a simulated device, where its bytes meet its link: the one place of byte faults.

A server hands every chunk through its device's edge. As long as nothing is wrong there, that is
one look at an attribute.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

PassOn = Callable[[bytes], None]


class ByteFilter(Protocol):
    """Takes each chunk of one direction, and passes on what gets through, when it does."""

    def __call__(self, data: bytes, deliver: PassOn) -> None: ...


class HostTransport(Protocol):
    """One connection of a host, as asyncio's transports are."""

    def abort(self) -> None: ...
    def pause_reading(self) -> None: ...
    def resume_reading(self) -> None: ...


def drop_chunk(data: bytes, deliver: PassOn) -> None:
    """Every chunk is lost."""


class LinkTap:
    """What passes between one device and its host.

    to_device, to_host : what chunks go through, None while all is well
    is_open : links are accepted; is_rtu : frames on it are Modbus RTU
    host_came : set as the first host comes
    host_was_there : (time on the loop's clock, True as it came, False as it went)
    """

    def __init__(self) -> None:
        self.to_device: ByteFilter | None = None
        self.to_host: ByteFilter | None = None
        self.is_open = True
        self.is_rtu = False
        self.host_came = asyncio.Event()
        self.host_was_there: list[tuple[float, bool]] = []
        self._filters: dict[str, list[ByteFilter]] = {"to_device": [], "to_host": []}
        self._witnesses: list[ByteFilter] = []
        self._links: dict[HostTransport, PassOn] = {}
        self._reading = True
        self._loop = asyncio.get_running_loop()

    # --- for servers

    def host_connected(self, link: HostTransport, write: PassOn) -> PassOn:
        """A host has come; what the device sends goes to what is returned here."""
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
        """A host has gone."""
        if self._links.pop(link, None) is not None:
            self.host_was_there.append((self._loop.time(), False))

    # --- for faults

    def add_filter(self, direction: str, one: ByteFilter) -> None:
        """Let chunks of a direction go through one more filter, behind those that are there."""
        self._filters[direction].append(one)
        self._set(direction)

    def remove_filter(self, direction: str, one: ByteFilter) -> None:
        """Take a filter away again; without effect where it is gone."""
        if one in self._filters[direction]:
            self._filters[direction].remove(one)
            self._set(direction)

    def add_observer(self, one: ByteFilter) -> Callable[[], None]:
        """Let what really gets to the host pass one more filter; what takes it away again."""
        self._witnesses.append(one)
        self._set("to_host")

        def forget() -> None:
            if one in self._witnesses:
                self._witnesses.remove(one)
                self._set("to_host")

        return forget

    def send_to_host(self, data: bytes) -> None:
        """Bytes to the host that the device did not send."""
        for write in list(self._links.values()):
            if self._witnesses:
                _chain(tuple(self._witnesses))(data, write)
            else:
                write(data)

    def set_open(self, is_open: bool) -> None:
        """Closed, hosts are thrown out, and turned away; on a serial line nothing passes."""
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
        """Links that are open are half open from now on: what comes over them is lost, and a new
        link works. What is returned closes them."""
        forgotten = list(self._links)
        for link in forgotten:
            link.pause_reading()

        def close() -> None:
            for link in forgotten:
                link.abort()

        return close

    def set_reading_enabled(self, reading: bool) -> None:
        """Whether bytes are taken off the link; else they pile up on the host's side."""
        self._reading = reading
        for link in self._links:
            if reading:
                link.resume_reading()
            else:
                link.pause_reading()

    def _set(self, direction: str) -> None:
        filters = tuple(self._filters[direction])
        if direction == "to_host":
            filters += tuple(self._witnesses)
        setattr(self, direction, _chain(filters) if filters else None)


def _chain(filters: tuple[ByteFilter, ...]) -> ByteFilter:
    first, *rest = filters
    if not rest:
        return first
    behind = _chain(tuple(rest))
    return lambda data, deliver: first(data, lambda passed: behind(passed, deliver))
