"""The control socket of a run: takes operator commands from another terminal.

A Unix stream socket, `control.sock` in the run's folder, which only the user who runs it can open
(mode 0600, and the peer's user is looked at too). Requests are JSON objects, one a line of at most
1,024 bytes; each is answered by one line, in order:

    {"do": "status"}                        the state of the run
    {"do": "hold"}                          stop on the path, beam off
    {"do": "resume"}                        end a hold
    {"do": "stop"}                          end the run; a second one skips the post-flow
    {"do": "refill", "hopper": "A"}         end the path, then make a hopper ready to be opened
    {"do": "refill", "hopper": "A", "lot": "L7", "mass_g": 2000}    it is filled and closed
    {"do": "height", "height_mm": 8.1}      of the part, in a run held for it; null: not measured
    {"do": "override", "percent": 80}       scale speed, beam and powder together
    {"do": "hold", "operator": "Ada"}       any request may name the operator
    {"do": "watch", "every_s": 1.0}         status repeatedly until the run ends; the last
                                            line shows how it ended. Nothing more is read then

    -> {"ok": true, "run": "run-0001", "state": "depositing", ...}
    -> {"ok": false, "error": "cannot resume now: ...", "where": [...], "hint": "..."}

An act (hold, resume, stop, override, refill, height) is accepted when it is possible in the present
state; `state` shows when it has taken effect. Each one that arrives is journaled: from whom, and
why it was refused if it was. The keys of a status are those of `RunExecutor.snapshot`.

No client may disturb the run: its requests are read a few kilobytes at a time and no faster than
50 requests a second. A client is dropped after an invalid request, or when it does not read its
answers. With too many clients, the one silent for longest is dropped.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lmctl.errors import LmctlError, UsageError
from lmctl.run.control import socket_path as control_path

MAX_REQUEST_BYTES = 1024
MAX_CLIENTS = 16
_READ_BYTES = 4096
_PAUSE_S = 0.02  # after each answer
_SLOW_S = 5.0  # an answer not taken for so long drops the client
_LEAST_EVERY_S, _MOST_EVERY_S = 0.1, 3600.0
_ACCEPT_PAUSE_S = 0.5  # after a connection could not be taken

ACTIONS = ("hold", "resume", "stop", "override", "refill", "height")
_KEYS = {
    "watch": {"do", "every_s"}, "override": {"do", "percent", "operator"},
    "height": {"do", "height_mm", "operator"},
    "refill": {"do", "hopper", "lot", "mass_g", "operator"},
    **{act: {"do", "operator"} for act in ("hold", "resume", "stop")},
}
_LONGEST_NAME, _MOST_MASS_G, _MOST_HEIGHT_MM = 200, 1_000_000.0, 10_000.0


@dataclass(frozen=True)
class ControlClient:
    """The connected client, by user and process number; None where the system gives none."""

    uid: int | None
    pid: int | None


@dataclass(frozen=True)
class ControlCallbacks:
    """What the socket lets its clients do.

    status : the state of the run, as JSON values
    perform_act : carries out one of ACTIONS, with the values of its request. Raises UsageError
    on_act : called for every act: what, by whom (the name given, ""), and why it was refused (""
        where it was not). Must not raise
    """

    status: Callable[[], dict[str, Any]]
    perform_act: Callable[[str, Mapping[str, Any]], None]
    on_act: Callable[[str, str, ControlClient, str], None]


class ControlSocket:
    """Serves a listening socket from `start` to `close`, on the running loop."""

    def __init__(self, listening: socket.socket, controls: ControlCallbacks) -> None:
        self._listening = listening
        self._controls = controls
        self._loop = asyncio.get_running_loop()
        self._clients: dict[socket.socket, asyncio.Task[None]] = {}  # longest silent first
        self._watchers: set[socket.socket] = set()
        self._accepting: asyncio.Task[None] | None = None

    def start(self) -> None:
        self._accepting = asyncio.create_task(self._accept(), name="control socket")

    async def close(self) -> None:
        """Send the final status to the watching clients, and close all connections."""
        tasks = [*self._clients.values(), *([self._accepting] if self._accepting else [])]
        for watcher in self._watchers:
            with suppress(OSError):  # it is gone, or was not reading
                watcher.send(_line({"ok": True, **self._controls.status()}))
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for client in self._clients:
            client.close()

    async def _accept(self) -> None:
        while True:
            try:
                client, _ = await self._loop.sock_accept(self._listening)
            except OSError:  # out of descriptors, say: what is open must go on
                await asyncio.sleep(_ACCEPT_PAUSE_S)
                continue
            if len(self._clients) >= MAX_CLIENTS:
                next(iter(self._clients.values())).cancel()
            client.setblocking(False)
            self._clients[client] = asyncio.create_task(self._serve(client))
            await asyncio.sleep(0)  # however many more wait, the run has its turn

    async def _serve(self, client: socket.socket) -> None:
        try:
            peer = _peer(client)
            if peer.uid is None or peer.uid in (0, os.geteuid()):
                await self._converse(client, peer)
        except OSError:
            pass  # it went away, or takes no answers
        finally:
            self._clients.pop(client, None)
            self._watchers.discard(client)
            client.close()

    async def _converse(self, client: socket.socket, peer: ControlClient) -> None:
        unread = bytearray()
        while data := await self._loop.sock_recv(client, _READ_BYTES):
            unread += data
            while (end := unread.find(b"\n")) >= 0:
                request = bytes(unread[:end])
                del unread[: end + 1]
                if not await self._answer(client, peer, request):
                    return
                await asyncio.sleep(_PAUSE_S)
            if len(unread) > MAX_REQUEST_BYTES:
                await self._answer(client, peer, bytes(unread))
                return

    async def _answer(self, client: socket.socket, peer: ControlClient, line: bytes) -> bool:
        """Carry out one request line; returns whether to keep reading from this client."""
        self._clients[client] = self._clients.pop(client)  # now the last one to send a request
        try:
            request = parse_request(line)
        except UsageError as error:
            await self._send(client, _refusal(error))
            return False
        do = request["do"]
        if do == "watch":
            await self._watch(client, request.get("every_s", 1.0))
            return False
        refused: UsageError | None = None
        if do in ACTIONS:
            try:
                self._controls.perform_act(do, request)
            except UsageError as error:
                refused = error
            reason = refused.what if refused else ""
            self._controls.on_act(_in_words(request), request.get("operator", ""), peer, reason)
        await self._send(
            client, _refusal(refused) if refused else {"ok": True, **self._controls.status()}
        )
        return True

    async def _watch(self, client: socket.socket, every_s: float) -> None:
        self._watchers.add(client)
        while True:
            await self._send(client, {"ok": True, **self._controls.status()})
            await asyncio.sleep(every_s)

    async def _send(self, client: socket.socket, answer: dict[str, Any]) -> None:
        """Raises OSError (TimeoutError is one) where the client does not take it."""
        async with asyncio.timeout(_SLOW_S):
            await self._loop.sock_sendall(client, _line(answer))


@contextmanager
def listening_socket(folder: Path) -> Iterator[socket.socket]:
    """The control socket of the run in `folder`, to be served; removed afterwards.

    Raises JournalError where a living process already has one there.
    """
    made = control_path.open_listening_socket(folder)
    try:
        yield made
    finally:
        made.close()
        control_path.remove_socket(folder)


def parse_request(line: bytes) -> dict[str, Any]:
    """Parse one request line. Raises UsageError where it is no request."""
    if len(line) > MAX_REQUEST_BYTES:
        raise UsageError(f"a request is at most {MAX_REQUEST_BYTES} bytes long")
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        raise UsageError("a request is one JSON object on a line") from None
    do = request.get("do") if isinstance(request, dict) else None
    if not isinstance(do, str) or do not in ("status", "watch", *ACTIONS):
        raise UsageError("a request is an object whose \"do\" is one of status, watch, "
                         + ", ".join(ACTIONS))
    if unknown := sorted(request.keys() - _KEYS.get(do, {"do"})):
        raise UsageError(f"{do} does not know {', '.join(map(repr, unknown))}")
    _check_values(do, request)
    found: dict[str, Any] = request
    return found


def _check_values(do: str, request: Mapping[str, Any]) -> None:
    if do == "refill":
        _check_refill(request)
    height_mm = request.get("height_mm", "")
    if do == "height" and height_mm is not None and (
        type(height_mm) not in (int, float) or not 0.0 < height_mm <= _MOST_HEIGHT_MM
    ):
        raise UsageError(f"\"height_mm\" is from 0 to {_MOST_HEIGHT_MM:,.0f} mm, or null where it "
                         "was not measured")
    percent, every_s = request.get("percent"), request.get("every_s", 1.0)
    if do == "override" and (type(percent) is not int or abs(percent) > 1_000_000):
        raise UsageError("\"percent\" of an override is a whole number")
    operator = request.get("operator", "")
    if not isinstance(operator, str) or len(operator) > _LONGEST_NAME:
        raise UsageError(f"\"operator\" is a name of at most {_LONGEST_NAME} letters")
    if type(every_s) not in (int, float) or not _LEAST_EVERY_S <= every_s <= _MOST_EVERY_S:
        raise UsageError(f"\"every_s\" is from {_LEAST_EVERY_S} to {_MOST_EVERY_S:.0f} s")


def _check_refill(request: Mapping[str, Any]) -> None:
    hopper, lot, mass_g = request.get("hopper"), request.get("lot"), request.get("mass_g")
    for name, text in (("hopper", hopper), ("lot", lot)):
        if name == "lot" and lot is None:
            continue
        if not isinstance(text, str) or not text.isprintable() or not (
            1 <= len(text) <= _LONGEST_NAME
        ):
            raise UsageError(f"\"{name}\" of a refill is a name of 1 to {_LONGEST_NAME} characters")
    if (lot is None) != (mass_g is None):
        raise UsageError("a refill has both \"lot\" and \"mass_g\", or neither")
    if mass_g is not None and (
        type(mass_g) not in (int, float) or not 0.0 < mass_g <= _MOST_MASS_G
    ):
        raise UsageError(f"\"mass_g\" of a refill is from 0 to {_MOST_MASS_G:,.0f} g")


def _in_words(request: Mapping[str, Any]) -> str:
    """An act as journals carry it."""
    do = str(request["do"])
    if do == "override":
        return f"{do} {request['percent']} %"
    if do == "refill":
        filled = f" with lot {request['lot']}, {request['mass_g']:g} g" if "lot" in request else ""
        return f"{do} {request['hopper']}{filled}"
    if do == "height":
        height_mm = request["height_mm"]
        return f"{do} {'not measured' if height_mm is None else f'{height_mm:g} mm'}"
    return do


def _line(answer: dict[str, Any]) -> bytes:
    return json.dumps(answer, allow_nan=False).encode("ascii") + b"\n"


def _refusal(error: LmctlError) -> dict[str, Any]:
    return {"ok": False, "error": error.what, "where": list(error.where), "hint": error.hint}


def _peer(client: socket.socket) -> ControlClient:
    option = getattr(socket, "SO_PEERCRED", None)
    if option is None:
        return ControlClient(None, None)
    pid, uid, _ = struct.unpack("3i", client.getsockopt(socket.SOL_SOCKET, option, 12))
    return ControlClient(uid, pid)
