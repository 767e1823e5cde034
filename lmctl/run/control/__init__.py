"""Operator commands to a run from another terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lmctl.lazy_exports import exports_of

if TYPE_CHECKING:
    from lmctl.run.control.server import ControlCallbacks as ControlCallbacks
    from lmctl.run.control.server import ControlClient as ControlClient
    from lmctl.run.control.server import ControlSocket as ControlSocket
    from lmctl.run.control.server import listening_socket as listening_socket

#: Public names and the module that holds each; a module is imported on first use.
_HOMES = {
    "ControlCallbacks": "lmctl.run.control.server",
    "ControlClient": "lmctl.run.control.server",
    "ControlSocket": "lmctl.run.control.server",
    "listening_socket": "lmctl.run.control.server",
}

__all__ = list(_HOMES)

__getattr__ = exports_of(__name__, _HOMES)
