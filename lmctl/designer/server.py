"""Serves the designer's page on this machine until it is interrupted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import uvicorn

from lmctl.config.machine import MachineProfile
from lmctl.designer.application import designer_application
from lmctl.designer.design_session import DesignSession
from lmctl.web.access import AccessPolicy, new_token
from lmctl.web.server import listening_tcp

_HOST = "127.0.0.1"


def run_designer(
    path: Path, profile: MachineProfile, port: int, started: Callable[[str], None]
) -> None:
    """Serve one part file. port : 0 for any free one; started : called with the page's address

    Raises ConfigError, MissingFileError, InputError of the part; UsageError of the port.
    """
    session = DesignSession(path, profile)
    token = new_token()
    with listening_tcp(_HOST, port) as listening:
        server = uvicorn.Server(uvicorn.Config(
            designer_application(session, AccessPolicy(token)), http="h11", ws="none",
            lifespan="off", loop="asyncio", log_level="critical", access_log=False,
            server_header=False, date_header=False, proxy_headers=False,
            timeout_graceful_shutdown=1))
        started(f"http://{_HOST}:{listening.getsockname()[1]}/#token={token}")
        server.run(sockets=[listening])
