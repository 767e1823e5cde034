"""Serves a simulated controller on a TCP port, as a serial device server, or on a pty.

One client at a time; a second one is refused. Connecting and disconnecting reset nothing, as on
a controller whose port does not toggle DTR.
"""

from __future__ import annotations

import asyncio
import os
import socket
import tty
from typing import cast

from simulators.faults.link_tap import LinkTap
from simulators.motion.simulator import MotionSimulator

_READ_BYTES = 65536


class TcpServer:
    """Listens until closed. port : the listening port."""

    def __init__(self, server: asyncio.Server, clients: set[asyncio.Transport]) -> None:
        self._server = server
        self._clients = clients
        self.port: int = server.sockets[0].getsockname()[1]

    def close(self) -> None:
        """Stop listening and drop the client."""
        self._server.close()
        for client in list(self._clients):
            client.abort()


async def serve_tcp(
    sim: MotionSimulator, host: str = "127.0.0.1", port: int = 0, edge: LinkTap | None = None
) -> TcpServer:
    """Serve sim on host:port; port 0 takes a free one. raises: OSError when the port is in use

    edge : where link faults apply to its bytes
    """
    clients: set[asyncio.Transport] = set()
    loop = asyncio.get_running_loop()
    met = edge or LinkTap()
    server = await loop.create_server(lambda: _Client(sim, clients, met), host, port)
    return TcpServer(server, clients)


class _Client(asyncio.Protocol):
    def __init__(self, sim: MotionSimulator, clients: set[asyncio.Transport],
                 edge: LinkTap) -> None:
        self._sim = sim
        self._clients = clients
        self._edge = edge
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        client = cast(asyncio.Transport, transport)
        if self._clients or not self._edge.is_open:
            client.abort()
            return
        client.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._transport = client
        self._clients.add(client)
        self._sim.attach_client(self._edge.host_connected(client, client.write))

    def data_received(self, data: bytes) -> None:
        if self._transport is None:
            return
        if self._edge.to_device is None:
            self._sim.receive(data)
        else:
            self._edge.to_device(data, self._sim.receive)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport is not None:
            self._clients.discard(self._transport)
            self._edge.host_disconnected(self._transport)
            self._sim.detach_client()


class Pty:
    """A pseudo-terminal whose other end is at `path`. This object keeps the slave side open, so
    that a client may connect and disconnect.
    """

    def __init__(self, sim: MotionSimulator, loop: asyncio.AbstractEventLoop,
                 edge: LinkTap) -> None:
        self._sim = sim
        self._loop = loop
        self._edge = edge
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._unsent = b""
        self.resume_reading()
        sim.attach_client(edge.host_connected(self, self._write))

    def pause_reading(self) -> None:
        self._loop.remove_reader(self._master)

    def resume_reading(self) -> None:
        self._loop.add_reader(self._master, self._readable)

    def abort(self) -> None:
        """The cable was unplugged: a serial line has no connection to close."""

    def close(self) -> None:
        """Close the pseudo-terminal."""
        self._edge.host_disconnected(self)
        self._sim.detach_client()
        self._loop.remove_reader(self._master)
        self._loop.remove_writer(self._master)
        os.close(self._master)
        os.close(self._slave)

    def _readable(self) -> None:
        data = os.read(self._master, _READ_BYTES)
        if self._edge.to_device is None:
            self._sim.receive(data)
        else:
            self._edge.to_device(data, self._sim.receive)

    def _write(self, data: bytes) -> None:
        if self._unsent:
            self._unsent += data
            return
        rest = self._try(data)
        if rest:
            self._unsent = rest
            self._loop.add_writer(self._master, self._writable)

    def _writable(self) -> None:
        self._unsent = self._try(self._unsent)
        if not self._unsent:
            self._loop.remove_writer(self._master)

    def _try(self, data: bytes) -> bytes:
        """Write as much as possible. Returns the rest."""
        try:
            return data[os.write(self._master, data) :]
        except BlockingIOError:
            return data


def open_pty(sim: MotionSimulator, edge: LinkTap | None = None) -> Pty:
    """Serve sim on a pseudo-terminal until closed. edge : where link faults apply to its bytes"""
    return Pty(sim, asyncio.get_running_loop(), edge or LinkTap())
