"""Serves the live page, and the other doors asked for, until it is interrupted."""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections.abc import Callable
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lmctl.errors import UsageError
from lmctl.web.access import AccessPolicy
from lmctl.web.rate_limit import RateLimit
from lmctl.web.run_catalogue import RunCatalogue

#: Connections at a time; more are answered 503.
_MOST_CONNECTIONS = 250

#: A run on the same computer goes first (see `nice`).
_NICENESS = 10


@dataclass(frozen=True)
class DashSettings:
    """Where a page listens. Port 0: any free one.

    tls_cert, tls_key : both, for https
    shdr_port, opcua_port : further doors on the same host, None for none
    """

    host: str = "127.0.0.1"
    port: int = 8440
    tls_cert: Path | None = None
    tls_key: Path | None = None
    shdr_port: int | None = None
    opcua_port: int | None = None


async def serve_dash(
    runs_dir: Path, settings: DashSettings, access: AccessPolicy,
    started: Callable[[dict[str, str]], None],
) -> None:
    """Serve until SIGINT or SIGTERM. started : called with the address of each door

    Raises UsageError where a port is taken, a certificate cannot be used, or an extra is missing.
    """
    try:
        import uvicorn

        from lmctl.web.application import dash_application
        from lmctl.web.protection import request_rate
    except ImportError as error:
        raise _not_installed("the live page", "web", error) from None
    async with AsyncExitStack() as stack:
        listening = stack.enter_context(listening_tcp(settings.host, settings.port))
        catalogue = await stack.enter_async_context(RunCatalogue(runs_dir))
        doors = {"page": _address(settings, listening)}
        if settings.shdr_port is not None:
            from lmctl.web.shdr import ShdrAdapter

            adapter = ShdrAdapter(catalogue.live_snapshots)
            doors["shdr"] = await stack.enter_async_context(
                adapter.serving(settings.host, settings.shdr_port))
        if settings.opcua_port is not None:
            try:
                from lmctl.web.opcua import OpcuaDoor
            except ImportError as error:
                raise _not_installed("OPC UA", "opcua", error) from None

            doors["opcua"] = await stack.enter_async_context(
                OpcuaDoor(catalogue.live_snapshots, settings.host, settings.opcua_port))
        rate = request_rate()
        server = uvicorn.Server(
            _config(dash_application(catalogue, access, rate), settings, rate))
        _give_way()
        started(doors)
        await server.serve(sockets=[listening])


def _give_way() -> None:
    """Let a run on the same computer go first: it is woken at once, and never waits for this
    process to be woken. What this process starts inherits both.
    """
    with suppress(OSError):  # only another user's limits can forbid that
        os.nice(_NICENESS)
    if sys.platform == "linux":
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def listening_tcp(host: str, port: int) -> socket.socket:
    """A listening TCP socket. Raises UsageError where the address cannot be used."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise UsageError(f"cannot listen on {host} port {port}",
                         where=str(error.strerror or error),
                         hint="--port names another port, 0 any free one") from None
    listening.setblocking(False)
    return listening


def _not_installed(what: str, extra: str, error: ImportError) -> UsageError:
    return UsageError(f"{what} is not installed", where=str(error),
                      hint=f"`pip install 'lmctl[{extra}]'`")


def _config(application: Any, settings: DashSettings, rate: RateLimit) -> Any:
    import uvicorn

    from lmctl.web.connections import BoundedConnection
    from lmctl.web.protection import flood_refusal

    connection: Any = partial(BoundedConnection, rate=rate, refusal=flood_refusal())
    config = uvicorn.Config(
        application, http=connection, ws="none", lifespan="off", loop="asyncio",
        log_level="critical", access_log=False, server_header=False, date_header=False,
        proxy_headers=False,
        limit_concurrency=_MOST_CONNECTIONS, timeout_keep_alive=5, timeout_graceful_shutdown=1,
        h11_max_incomplete_event_size=16_384,
        ssl_certfile=settings.tls_cert, ssl_keyfile=settings.tls_key)
    try:
        config.load()
    except (OSError, ValueError) as error:
        raise UsageError("the TLS certificate and key cannot be used", where=str(error),
                         hint="--tls-cert and --tls-key name PEM files that belong together"
                         ) from None
    return config


def _address(settings: DashSettings, listening: socket.socket) -> str:
    port = listening.getsockname()[1]
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    return f"{'http' if settings.tls_cert is None else 'https'}://{host}:{port}/"


def run_dash(
    runs_dir: Path, settings: DashSettings, access: AccessPolicy,
    started: Callable[[dict[str, str]], None],
) -> None:
    """`serve_dash` on a loop of its own."""
    asyncio.run(serve_dash(runs_dir, settings, access, started))
